"""The aircraft of the tests' own: how fast its rotors must turn in a given motion.

Nothing here comes from `models`: the laws are written a second time, from the textbook side, so
that a mistake in one is not repeated in the other.

Frames: NED for the world, forward-right-down for the body. Rotor thrust points up (-z of the body).
Symbols: F needed thrust force [N], b unit vector of the body's down axis, M needed rotor moment.

    F = m (a - g) - D,   D = -1/2 rho S |v_air| v_air,   b = -F / |F|
    sum T_i = |F|
    M = I dw/dt + w x I w + c w + c_of_g x thrust + trim,   M_roll = -sum y_i T_i,
    M_pitch = sum x_i T_i,   M_yaw = q sum s_i T_i        (s = +1 for a rotor CCW from above)
    T_i = a (rho/rho0) k_i N_i^2 (1 - k J_i),   J_i = w_axial 60 / (N_i D)

`Physics` holds every number of these; a changed aircraft is a `Physics` with other numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

GRAVITY = 9.80665  # m/s²
SEA_LEVEL_DENSITY = 1.225  # kg/m³
FIRST_ROW = 0.5  # s of a mission at which its track begins
AIR_GAS_CONSTANT = 287.053  # J/(kg K)


@dataclass(frozen=True, kw_only=True, eq=False)
class Layout:
    """Where the rotors sit and which way they turn, in motor order."""

    name: str
    position: Array  # (R, 2) m forward and right of the designed centre of gravity
    spin: Array  # (R,) +1 counter-clockwise seen from above
    torque_ratio: float = 0.049  # m, rotor torque over rotor thrust

    @property
    def rotors(self) -> int:
        return self.spin.size

    @property
    def mixing(self) -> Array:
        """(4, R) from rotor thrusts to collective thrust and roll, pitch, yaw moment."""
        x, y = self.position.T
        return np.stack([np.ones_like(x), -y, x, self.torque_ratio * self.spin])


ARM = 0.6785  # m, both ways, of the quad
QUAD = Layout(
    name="quad",
    position=ARM * np.array([[1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]]),
    spin=np.array([1.0, 1.0, -1.0, -1.0]),
)


def hexa(rng: np.random.Generator) -> Layout:
    """A hexacopter of random arm length, rotors in a random order, neighbours turning apart."""
    around = np.deg2rad(30.0 + 60.0 * np.arange(6))
    arm = rng.uniform(0.75, 1.05)
    order = rng.permutation(6)
    place = arm * np.stack([np.cos(around), np.sin(around)], axis=1)
    return Layout(
        name="hexa",
        position=place[order],
        spin=np.where(np.arange(6) % 2 == 0, 1.0, -1.0)[order],
        torque_ratio=float(rng.uniform(0.04, 0.06)),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Physics:
    """Every number of the aircraft. The defaults are a healthy, bare one."""

    layout: Layout = QUAD
    empty_mass: float = 21.1  # kg
    tank_capacity: float = 16.0  # kg
    thrust_coefficient: float = 2.011e-5  # N/rpm² at 1.225 kg/m³
    propeller_diameter: float = 0.914  # m
    full_voltage: float = 58.8  # V
    drag_area: float = 0.0  # m²
    lift_gain: float = 0.0  # thrust gained in fast forward flight at one rotor speed
    extra_lift_gain: float = 0.0  # the same, of a changed propeller, on top
    inflow_slope: float = 0.0  # loss of thrust for each unit of advance ratio in climb
    cushion: float = 0.0  # ground: k of 1/(1 - k (R/z)²)
    inertia: tuple[float, float, float] = (0.0, 0.0, 0.0)  # kg m²
    damping: tuple[float, float, float] = (0.0, 0.0, 0.0)  # N m s
    hidden_mass: float = 0.0  # kg
    gauge_gain: float = 1.0  # liquid in the tank over what the gauge shows
    rotor_loss: float = 0.0  # share of one rotor's thrust lost at a speed
    lossy_rotor: int = 0
    loss_from_clock: float = -np.inf  # s on the season's clock: lost from then on
    loss_from_flight_time: float = -np.inf  # s after each start
    fouling_rate: float = 0.0  # 1/s share of all rotors' thrust lost with flight time
    pack_exponent: float = 0.0  # thrust at a reported speed goes with (V/full)^this
    balance: tuple[float, float] = (0.0, 0.0)  # m, centre of gravity forward, right
    balance_full_tank: tuple[float, float] = (0.0, 0.0)  # m at a full tank, in proportion to it
    yaw_trim: float = 0.0  # N m that the rotors must hold
    reporting_delay: float = 0.0  # s by which rotor speed reports are late
    blind_to_wind: bool = False  # reported airspeed is ground speed
    thin_air: bool = False  # flown away from the calibration field: density is not its density


class Motion(NamedTuple):
    """What the aircraft does, on a fine time base; T rows."""

    time: Array  # (T,) s
    position: Array  # (T, 3) m NED
    velocity: Array  # (T, 3) m/s NED
    acceleration: Array  # (T, 3) m/s² NED
    heading: Array  # (T,) rad
    height: Array  # (T,) m above ground
    spraying: Array  # (T,) 0 or 1
    flying: NDArray[np.bool_]  # (T,)


class Surroundings(NamedTuple):
    """What the aircraft meets: arrays of T rows and the day's numbers."""

    air_velocity: Array  # (T, 3) m/s NED, wind with its turbulence
    density: float  # kg/m³
    tank: Array  # (T,) kg really in the tank
    voltage: Array  # (T,) V
    clock_start: float  # s of take-off on the season's clock
    push: Array  # (T, 4) N and N m beyond all laws here: collective, roll, pitch, yaw


class Attitude(NamedTuple):
    """Attitude that the motion asks for."""

    euler: Array  # (T, 3) rad roll, pitch, yaw
    rate: Array  # (T, 3) rad/s, body axes
    rotation: Array  # (T, 3, 3) body to NED
    thrust: Array  # (T,) N


def air_density(pressure: float, temperature: float) -> float:
    """kg/m³ of dry air from Pa and K."""
    return pressure / (AIR_GAS_CONSTANT * temperature)


def standard_air(altitude: float) -> tuple[float, float]:
    """Pa and K of the standard troposphere at m above the sea."""
    temperature = 288.15 - 0.0065 * altitude
    return 101325.0 * (temperature / 288.15) ** (GRAVITY / (0.0065 * AIR_GAS_CONSTANT)), temperature


def attitude_for(physics: Physics, motion: Motion, around: Surroundings, mass: Array) -> Attitude:
    """Attitude and collective thrust that make the motion, body axis along the thrust."""
    air = motion.velocity - around.air_velocity
    speed = np.linalg.norm(air, axis=1, keepdims=True)
    drag = -0.5 * around.density * physics.drag_area * speed * air
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
    yaw = motion.heading
    d_roll, d_pitch, d_yaw = (np.gradient(angle, motion.time) for angle in (roll, pitch, yaw))
    rate = np.stack(
        [
            d_roll - d_yaw * np.sin(pitch),
            d_pitch * np.cos(roll) + d_yaw * np.sin(roll) * np.cos(pitch),
            -d_pitch * np.sin(roll) + d_yaw * np.cos(roll) * np.cos(pitch),
        ],
        axis=1,
    )
    return Attitude(
        np.stack([roll, pitch, yaw], axis=1), rate, np.stack([forward, right, down], axis=2), thrust
    )


def needed_wrench(
    physics: Physics, attitude: Attitude, motion: Motion, around: Surroundings
) -> Array:
    """(T, 4) collective thrust and roll, pitch, yaw moment that the rotors must make."""
    inertia, damping = np.array(physics.inertia), np.array(physics.damping)
    spin_up = np.gradient(attitude.rate, motion.time, axis=0)
    moment = inertia * spin_up + np.cross(attitude.rate, inertia * attitude.rate)
    moment += damping * attitude.rate
    filled = around.tank / physics.tank_capacity
    ahead = physics.balance[0] + physics.balance_full_tank[0] * filled
    aside = physics.balance[1] + physics.balance_full_tank[1] * filled
    moment += np.stack(
        [-aside * attitude.thrust, ahead * attitude.thrust, np.full_like(filled, physics.yaw_trim)],
        axis=1,
    )
    return np.column_stack([attitude.thrust, moment]) + around.push


def effectiveness(physics: Physics, motion: Motion, around: Surroundings, mass: Array) -> Array:
    """(T, R) thrust at a rotor speed over that of the calm bench at sea-level density."""
    rotors, rows = physics.layout.rotors, motion.time.size
    disc = np.pi * physics.propeller_diameter**2 / 4.0
    air = motion.velocity - around.air_velocity
    along = np.hypot(air[:, 0], air[:, 1])
    hover_inflow = np.sqrt(mass * GRAVITY / rotors / (2.0 * around.density * disc))
    lifted = 1.0 - 1.0 / np.sqrt(1.0 + (along / hover_inflow) ** 2)
    gain = (1.0 + physics.lift_gain * lifted) * (1.0 + physics.extra_lift_gain * lifted)
    gain *= around.density / SEA_LEVEL_DENSITY
    reach = physics.propeller_diameter / 2.0 / np.maximum(motion.height, 0.4)
    gain /= 1.0 - physics.cushion * reach**2
    gain *= 1.0 - physics.fouling_rate * motion.time
    gain *= (around.voltage / physics.full_voltage) ** physics.pack_exponent
    share = np.ones((rows, rotors))
    gone = (around.clock_start + motion.time >= physics.loss_from_clock) & (
        motion.time >= physics.loss_from_flight_time
    )
    share[gone, physics.lossy_rotor] -= physics.rotor_loss
    return gain[:, None] * share


def rotor_speeds(
    physics: Physics, motion: Motion, around: Surroundings
) -> tuple[Array, Attitude, Array]:
    """(T, R) rpm that the rotors turn at, the attitude, and the mass (T,) in kg.

    On the ground the rotors idle.
    """
    mass = physics.empty_mass + physics.hidden_mass + around.tank
    attitude = attitude_for(physics, motion, around, mass)
    wrench = needed_wrench(physics, attitude, motion, around)
    share = np.linalg.pinv(physics.layout.mixing)
    thrust = np.maximum(wrench @ share.T, 1.0)
    strength = physics.thrust_coefficient * effectiveness(physics, motion, around, mass)
    axial = -np.sum((motion.velocity - around.air_velocity) * attitude.rotation[:, :, 2], axis=1)
    # T = s N² - s k (60 w/D) N is quadratic in N; its positive root is the speed.
    half = 0.5 * physics.inflow_slope * 60.0 * axial[:, None] / physics.propeller_diameter
    speed = half + np.sqrt(half**2 + thrust / strength)
    idle = 700.0
    return np.where(motion.flying[:, None], speed, idle), attitude, mass
