"""Effects on the thrust that a rotor makes at a speed."""
