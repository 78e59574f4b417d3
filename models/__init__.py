"""Physics and learning of rotor speed and thrust margin: arrays in, arrays out.

Symbols: N rotor speed [rpm], T thrust [N], rho air density [kg/m³], a thrust coefficient [N/rpm²],
e effectiveness of a rotor in another's wash, V airspeed [m/s], U battery voltage [V], m mass [kg],
W weight [N], u utilisation, R rotors, i a rotor, k a lost rotor.

    thrust           T_i = a e_i (rho/rho_ref) N_i²                            thrust.py, Eq. 1, 4
    density          rho = p/(R_air T_air), standard atmosphere                atmosphere.py
    prediction       N_i = f_i(V, m_tank) sqrt(rho_ref/rho): the network       predict.py
    ceiling          N_max = N_max,ref min(U/U_ref, 1)^n                       margin.py
    utilisation      u_i = T_i/T_max,i = (N_i/N_max)², margin 1 - u_i          margin.py
    redundancy       max collective without rotor k, level / W                 margin.py
    quad             one rotor lost, yaw uncontrolled: 1/(2u); yaw kept: 0

Frames: `_ned` north, east, down from the flight's origin; `_frd` forward, right, down of the body.
Thrust is positive up, moments are about frd axes: roll = -sum y T, pitch = sum x T, yaw = sum s k T
with s = +1 for a rotor that turns counter-clockwise seen from above.
Units: a bare name is SI, anything else wears its unit (`_rpm`, `_l`, `_deg`); rotor speed is in rpm
everywhere. Rotors are in the autopilot's motor order, numbered from 1 on screens and in files.
Shapes: (T,) a row a time, (T, R) a column a rotor. NaN is unknown, and stays NaN.

This package knows no MAVLink, files of logs, sockets, clocks or screens. Importing it is light:
torch is loaded only inside the functions that train or fit.
"""
