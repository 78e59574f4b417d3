"""Effects on the thrust that all rotors together must make."""
