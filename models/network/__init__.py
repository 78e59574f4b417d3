"""The network from airspeed and tank level to rotor speeds: training rows, fit and validity."""
