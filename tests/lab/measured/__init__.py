"""Measured data: a reader for each data set, and what the project's own code finds on it.

The data stay in the user's folder; nothing of them is in this repository. Each subfolder is one
data set, and each module here states where it comes from, its licence as found, its columns and
units:

| folder | module | what is asked of it |
|---|---|---|
| imrc_crazyflie_rpm | crazyflie, crazyflie_find, *_check, speed_regression | identify itself |
| crazypad_flights, cut_propeller_quad | damaged_rotors | identify itself |
| vendor_bench_tmotor_kde | vendor_bench | thrust curves of large propellers |
| uiuc_propeller_db | uiuc | thrust in axial flow |
| aerostack2_thrust_vs_voltage | aerostack2 | thrust at a command against voltage |
| strawson_static_thrust | strawson | wrong runs and a robust fit |
| crazypad_damaged_rotor | crazypad | a cut propeller in the share of commands |
| px4_ulog | px4_log | the .ulg reader |
"""
