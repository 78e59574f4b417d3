"""The recording of a flight while it is heard: frames, samples, events."""
