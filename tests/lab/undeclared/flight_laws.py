"""What the rotors must make in a given motion, and the controls and speeds that make it.

Frames: NED for the world, forward-right-down for the body. Rotor thrust points up (-z of the body).

    F = m (a - g) - D,   b = -F / |F|,   sum T_i = |F|
    M = I dw/dt + w x I w + cg x thrust + drag of bodies below,   M_yaw late by the rotors' inertia
    M_roll = -sum y_i T_i,  M_pitch = sum x_i T_i,  M_yaw = sum s_i Q_i   (s = +1 CCW from above)
    N_i² = N_hover² (M c)_i,  with T_i, Q_i of N_i by `rotor_aero`: c solved for F and M

The mixer shares a demand over all rotors as the autopilot does, also with more rotors than modes.
Bodies saturate: D = rho A V²/2 / (1 + V/12); a bluff body more: / sqrt(1 + (V/9)²).
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from tests.lab.undeclared.conditions import Condition
from tests.lab.undeclared.crafts import GRAVITY, RPM, SEA_LEVEL_DENSITY, WASH, Craft
from tests.lab.undeclared.days import Surroundings
from tests.lab.undeclared.missions import FINE_STEP, Motion
from tests.lab.undeclared.rotor_aero import Array, forces_of, ground_relief

ITERATIONS = 7
SLOSH_PERIOD, SLOSH_DAMPING = 3.0, 0.08
SWING_DAMPING = 0.3


class Attitude(NamedTuple):
    """Attitude that the motion asks for."""

    euler: Array  # (T, 3) rad roll, pitch, yaw
    rate: Array  # (T, 3) rad/s, body axes
    rotation: Array  # (T, 3, 3) body to NED
    thrust: Array  # (T,) N
    drag: Array  # (T, 3) N NED


def drag_of(craft: Craft, condition: Condition, density: float, air: Array) -> Array:
    """(T, 3) N on bodies and rotors of an aircraft that moves at `air` m/s through it."""
    speed = np.linalg.norm(air, axis=1, keepdims=True)
    area = craft.drag_area / (1.0 + speed / 12.0)
    area = area + condition.drag_area / np.sqrt(1.0 + (speed / 9.0) ** 2)
    forces = forces_of(craft.blade)
    slope = float(forces.at(forces.in_plane, np.array([0.1]), np.zeros(1))[0]) / 0.1
    tip = craft.hover_rpm / RPM * craft.radius
    rotors = density * craft.disc * craft.rotors * tip * slope
    return -(0.5 * density * area * speed + rotors * np.array([1.0, 1.0, 0.0])) * air


def attitude_for(
    craft: Craft, condition: Condition, motion: Motion, around: Surroundings, mass: Array
) -> Attitude:
    """Attitude and collective thrust that make the motion, body axis along the thrust."""
    drag = drag_of(craft, condition, around.density, motion.velocity - around.air_velocity)
    force = mass[:, None] * (motion.acceleration - [0.0, 0.0, GRAVITY]) - drag
    thrust = np.linalg.norm(force, axis=1)
    down = -force / thrust[:, None]
    ahead = np.stack(
        [np.cos(motion.heading), np.sin(motion.heading), np.zeros_like(motion.heading)], axis=1
    )
    # The nose points along the heading and is square to the thrust: that fixes pitch, then roll.
    pitch = np.arctan2(np.sum(ahead * down, axis=1), down[:, 2])
    forward = ahead * np.cos(pitch)[:, None]
    forward[:, 2] = -np.sin(pitch)
    right = np.cross(down, forward)
    roll = np.arctan2(right[:, 2], down[:, 2])
    d_roll, d_pitch, d_yaw = (np.gradient(a, FINE_STEP) for a in (roll, pitch, motion.heading))
    rate = np.stack(
        [
            d_roll - d_yaw * np.sin(pitch),
            d_pitch * np.cos(roll) + d_yaw * np.sin(roll) * np.cos(pitch),
            -d_pitch * np.sin(roll) + d_yaw * np.cos(roll) * np.cos(pitch),
        ],
        axis=1,
    )
    euler = np.stack([roll, pitch, motion.heading], axis=1)
    return Attitude(euler, rate, np.stack([forward, right, down], axis=2), thrust, drag)


def needed_wrench(
    craft: Craft, condition: Condition, attitude: Attitude, motion: Motion, around: Surroundings
) -> Array:
    """(T, 4) thrust and roll, pitch, yaw moment that the rotors must make."""
    filled = around.tank / craft.tank_litres
    inertia = craft.inertia * condition.inertia_scale * (0.85 + 0.25 * filled)[:, None]
    spin_up = np.gradient(attitude.rate, FINE_STEP, axis=0)
    moment = inertia * spin_up + np.cross(attitude.rate, inertia * attitude.rate)
    cg = np.array(condition.cg) + np.array(condition.cg_full) * filled[:, None]
    moment[:, 0] -= cg[:, 1] * attitude.thrust
    moment[:, 1] += cg[:, 0] * attitude.thrust
    # Legs, tank and booms hang below the rotors: their drag turns the aircraft.
    body_drag = np.einsum("tji,tj->ti", attitude.rotation, attitude.drag)
    moment[:, 0] += 0.15 * craft.arm * body_drag[:, 1]
    moment[:, 1] -= 0.15 * craft.arm * body_drag[:, 0]
    unit = craft.typical_mass * GRAVITY * craft.arm
    moment[:, 0] += condition.jet * unit * motion.spraying
    roll, pitch = condition.recoil
    moment[:, 0] += roll * unit * motion.spraying
    moment[:, 1] += pitch * unit * motion.spraying
    if condition.hung:
        ahead, aside = craft.position[condition.rotor]
        mass = craft.empty_mass + condition.hidden_mass + condition.hung + around.tank
        pull = condition.hung * attitude.thrust / mass
        moment[:, 0] -= aside * pull
        moment[:, 1] += ahead * pull
    if condition.swing:
        # Forward and right of the heading, by a damped pendulum that hangs from the body.
        turned = np.column_stack([np.cos(motion.heading), np.sin(motion.heading)])
        ahead = np.sum(motion.acceleration[:, :2] * turned, axis=1)
        aside = motion.acceleration[:, 1] * turned[:, 0] - motion.acceleration[:, 0] * turned[:, 1]
        for axis, pushed, sign in ((1, ahead, -1.0), (0, aside, 1.0)):
            shift = condition.swing * pendulum(pushed, np.sqrt(GRAVITY / condition.swing)) / GRAVITY
            moment[:, axis] += sign * shift * around.tank * GRAVITY
    if condition.flap:
        speed = np.linalg.norm(motion.velocity - around.air_velocity, axis=1)
        moment[:, 1] += condition.flap * unit / (1.0 + np.exp((4.5 - speed) / 0.3))
    if condition.sail:
        air = np.einsum("tji,tj->ti", attitude.rotation, motion.velocity - around.air_velocity)[
            :, 1
        ]
        moment[:, 0] += condition.sail * unit * np.abs(air) * air / 25.0
    if condition.slosh:
        w = 2 * np.pi / SLOSH_PERIOD * FINE_STEP
        a = [1.0, 2.0 * SLOSH_DAMPING * w + w**2 - 2.0, 1.0 - 2.0 * SLOSH_DAMPING * w]
        swing = lfilter([FINE_STEP**2], a, spin_up[:, 1])
        moment[:, 1] += condition.slosh * 0.3 * craft.arm * GRAVITY * around.tank * swing
    wrench = np.column_stack([attitude.thrust, moment]) + around.push
    # Rotors that spin up push back in yaw first: the yaw control is a low pass of the demand.
    keep = np.exp(-FINE_STEP / yaw_time(craft))
    start = wrench[:1, 3] * keep
    wrench[:, 3] = lfilter([1.0 - keep], [1.0, -keep], wrench[:, 3], zi=start)[0]
    return wrench


def pendulum(pushed: Array, natural: float) -> Array:
    """A push after a damped oscillator of natural frequency rad/s, of the same mean."""
    w = natural * FINE_STEP
    a = [1.0, 2.0 * SWING_DAMPING * w + w**2 - 2.0, 1.0 - 2.0 * SWING_DAMPING * w]
    return np.asarray(lfilter([w**2], a, pushed))


def yaw_time(craft: Craft) -> float:
    """s: rotor inertia times speed over twice the torque, blades of 0.15 kg/m² of disc."""
    inertia = 0.15 * craft.disc * craft.radius**2 / 3.0
    thrust = craft.typical_mass * GRAVITY / craft.rotors
    ratio = craft.hover_coefficients[1][0] / craft.hover_coefficients[0][0]
    return float(inertia * craft.hover_rpm / RPM / (2.0 * thrust * craft.radius * ratio))


class Flow(NamedTuple):
    """What the rotors meet, T rows and R rotors, m/s."""

    axial: Array  # (T, R) up through the disc, body rates included
    edge: Array  # (T, 2) of the aircraft through the air in the plane of the discs
    relief: Array  # (T, 1) share of the induced speed that the ground takes


def flow_of(
    craft: Craft, condition: Condition, attitude: Attitude, motion: Motion, around: Surroundings
) -> Flow:
    """The air that the rotors meet; its vertical part and the ground can be left out."""
    air = motion.velocity - around.air_velocity
    if condition.level_air:
        air = air * [1.0, 1.0, 0.0]
    body = np.einsum("tji,tj->ti", attitude.rotation, air)
    x, y = craft.position.T
    p, q = attitude.rate[:, 0, None], attitude.rate[:, 1, None]
    height = np.maximum(motion.height, 0.0) + 0.35 * craft.arm
    return Flow(
        -body[:, 2, None] + q * x - p * y,
        body[:, :2],
        ground_relief(height / (2.0 * craft.radius))[:, None] * (not condition.no_ground),
    )


def wake_inflow(craft: Craft, flow: Flow, own: Array, mu: Array, climb: Array) -> Array:
    """(T, R) inflow ratio that rotors downstream meet in the skewed wakes of those upstream."""
    speed = np.linalg.norm(flow.edge, axis=1)
    back = -flow.edge / np.maximum(speed, 0.1)[:, None]
    met = np.zeros_like(own)
    for front in range(craft.rotors):
        d = craft.position - craft.position[front]
        along = back @ d.T
        aside = back[:, :1] * d[:, 1] - back[:, 1:] * d[:, 0]
        fall = (climb + own)[:, front, None] / np.maximum(mu[:, front, None], 1e-3)
        depth = np.maximum(along, 0.0) * fall
        part = np.exp(-((depth / (1.5 * craft.radius)) ** 2) - (aside / craft.radius) ** 2)
        met += np.where(along > craft.radius, part, 0.0) * 2.0 * own[:, front, None]
    return met


def rotor_forces(
    craft: Craft, condition: Condition, omega: Array, flow: Flow, seconds: Array, clock: Array
) -> tuple[Array, Array]:
    """(T, R) N and N m that the rotors make at `omega` rad/s in air of sea level."""
    tip = omega * craft.radius
    forces = forces_of(craft.blade)
    mu = np.linalg.norm(flow.edge, axis=1)[:, None] / tip
    climb = flow.axial / tip
    own = forces.at(forces.inflow, mu, climb)
    if craft.upper is not None:
        wash = own[:, craft.upper] * tip[:, craft.upper]
        climb = np.concatenate([climb[:, :4], climb[:, 4:] + WASH * wash / tip[:, 4:]], axis=1)
        own = forces.at(forces.inflow, mu, climb)
    if condition.wake:
        climb = climb + condition.wake * wake_inflow(craft, flow, own, mu, climb)
    climb = climb - flow.relief * own
    thrust, torque = forces.at(forces.thrust, mu, climb), forces.at(forces.torque, mu, climb)
    j = condition.rotor
    if condition.cut:
        rows = (clock >= condition.cut_from) & (clock < condition.cut_until)
        short = forces_of(replace(craft.blade, cut=condition.cut))
        thrust[rows, j] = short.at(short.thrust, mu[rows, j], climb[rows, j])
        torque[rows, j] = short.at(short.torque, mu[rows, j], climb[rows, j])
    grown = condition.fouling * (1.0 - np.exp(-seconds / 200.0)) / (1.0 - np.exp(-1.5))
    icy = condition.shed * ((seconds / 70.0) % 1.0)
    thrust *= (1.0 - grown - icy)[:, None]
    torque *= (1.0 + grown)[:, None]
    unit = SEA_LEVEL_DENSITY * craft.disc * tip**2
    thrust, torque = unit * thrust, unit * craft.radius * torque
    if condition.flex:
        load = thrust[:, j] * craft.rotors / (craft.typical_mass * GRAVITY)
        thrust[:, j] *= 1.0 - condition.flex * np.maximum(load - 0.5, 0.0)
    if condition.worn:
        speed = np.linalg.norm(flow.edge, axis=1) / 6.0
        for k in (j, (j + 1) % craft.rotors):
            thrust[:, k] *= 1.0 - condition.worn * np.minimum(speed**2, 2.0)
    if condition.band:
        off = (omega[:, j] * RPM / craft.hover_rpm - 1.03) / 0.03
        thrust[:, j] *= 1.0 - condition.band * np.exp(-(off**2))
    return thrust, torque


def rotor_speeds(
    craft: Craft,
    condition: Condition,
    motion: Motion,
    around: Surroundings,
    mass: Array,
    every: int,
) -> tuple[Array, Attitude]:
    """(T/every, R) rpm that the rotors turn at, each `every` steps, and the attitude (T)."""
    attitude = attitude_for(craft, condition, motion, around, mass)
    wrench = needed_wrench(craft, condition, attitude, motion, around)[::every]
    flow = Flow(*(v[::every] for v in flow_of(craft, condition, attitude, motion, around)))
    seconds = motion.time[::every]
    clock = around.clock_start + seconds
    x, y = craft.position.T
    mixer, hover = craft.mixer, craft.hover_rpm / RPM
    dense = around.density / SEA_LEVEL_DENSITY
    control = np.zeros_like(wrench)
    control[:, 0] = wrench[:, 0] / (craft.typical_mass * GRAVITY * dense)
    lean = np.zeros(craft.rotors)
    lean[condition.tilted] = craft.arm * np.sin(condition.tilt)
    upright = np.ones(craft.rotors)
    upright[condition.tilted] = np.cos(condition.tilt)
    for _ in range(ITERATIONS):
        share = np.maximum(control @ mixer.T, 0.02)
        thrust, torque = rotor_forces(
            craft, condition, hover * np.sqrt(share), flow, seconds, clock
        )
        turning = dense * (torque * craft.spin + thrust * lean)
        thrust = dense * thrust * upright
        rows = np.stack([thrust, -y * thrust, x * thrust, turning], axis=1)
        slope = (rows / share[:, None, :]) @ mixer
        control += np.linalg.solve(slope, (wrench - rows.sum(axis=2))[..., None])[..., 0]
    share = np.maximum(control @ mixer.T, 0.02)
    speed = craft.hover_rpm * np.sqrt(share)
    return np.where(motion.flying[::every, None], speed, 0.35 * craft.hover_rpm), attitude
