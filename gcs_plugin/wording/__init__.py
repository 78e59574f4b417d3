"""How numbers, effects and colours are put before people: one place for every screen."""
