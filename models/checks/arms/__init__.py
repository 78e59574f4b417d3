"""Distinguish propeller, motor, ESC, lead and sensor of each arm by what the arm reports.

figures.py    one flight to figures of each arm: thrust, power, output, lead, heat, vibration
law.py        what each figure is on a sound aircraft, by earlier flights, and the departure from it
causes.py     what can be wrong with an arm, and what it does to the figures
posterior.py  one posterior over arms, causes and sizes

The caller makes `figures.ArmReadings` of a flight and calls `posterior.arm_answer`.
"""
