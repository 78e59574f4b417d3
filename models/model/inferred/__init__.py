"""What a flight shows where nothing reports it: load, rotor speeds, how well both are known."""
