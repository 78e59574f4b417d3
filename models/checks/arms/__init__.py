"""Distinguish propeller, motor, ESC, lead and sensor of each arm by what the arm reports.

arm_figures.py    one flight to figures of each arm: thrust, power, output, lead, heat, vibration
arm_law.py        what each figure is on a sound aircraft, and how far a flight is from it
arm_causes.py     what can be wrong with an arm, and what it does to the figures
arm_posterior.py  one posterior over arms, causes and sizes
desync.py         falls of a rotor's speed that its output does not explain
spool_up.py       a motor before lift-off against itself on earlier flights
arm_watch.py      in a flight: parts that pass their temperature's limit, leads that lose power
arm_trend.py      an arm that needs more and more power, over all flights of an aircraft

The caller makes `arm_figures.ArmReadings` of a flight and calls `arm_posterior.arm_answer`.
"""
