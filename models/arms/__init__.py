"""Distinguish propeller, motor, ESC, lead and sensor of each arm by what the arm reports."""
