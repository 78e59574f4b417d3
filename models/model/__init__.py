"""RotorModel: base model and effects in one file, and a flight through it."""
