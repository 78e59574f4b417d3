"""Effects on the moments by which the rotors share the thrust out."""
