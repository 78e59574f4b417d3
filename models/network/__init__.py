"""The network from airspeed and tank level to rotor speeds: rows to learn from, fit, validity."""
