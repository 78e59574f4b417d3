"""Physics of rotors and aircraft: air, thrust, forward flight, mixer, margin, load matching."""
