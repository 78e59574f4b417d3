"""Flights in RotorPy, a multirotor simulator that others wrote, with the F16's mass and curve.

RotorPy integrates the rigid body, the motors' lag and its own aerodynamics (parasite drag, rotor
drag, translational lift, axial inflow) under its own geometric controller (SE3), which knows the
sound aircraft and the gauge only: what is changed is met by feedback. Only the mission, the air
and the instruments' noise come from here. Its world is x forward, y left, z up: signs of y and z
turn to NED and FRD.

Its rotor: T = k_eta w² + k_h V² - k_z w v_z with w in rad/s, V along the disc. The inflow term is
the same as 1 - k J with k = 2 pi D k_z / (3600 a); parasite drag is c_D V² with
c_D = rho CdA / 2, alike along all axes, for a body that differed would lift as a tilted plate does.
All of these go with air density.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from rotorpy.controllers.quadrotor_control import (  # pyright: ignore[reportMissingImports]
    SE3Control,
)
from rotorpy.vehicles.multirotor import Multirotor  # pyright: ignore[reportMissingImports]
from scipy.integrate import OdeSolver
from scipy.spatial.transform import Rotation

from tests.lab.undeclared.conditions import Condition
from tests.lab.undeclared.crafts import CRAFTS, SEA_LEVEL_DENSITY
from tests.lab.undeclared.days import Day, surroundings
from tests.lab.undeclared.missions import FINE_STEP, Motion, Style, motion_of
from tests.lab.undeclared.rotor_aero import Array
from tests.made_sources import sent
from thrustmargin.models.flight import FlightTrack

QUAD = CRAFTS[0]
TORQUE_RATIO = QUAD.radius * float(
    QUAD.hover_coefficients[1][0] / QUAD.hover_coefficients[0][0]
)  # m
FLIP = np.array([1.0, -1.0, -1.0])
RPM_PER_RAD_S = 60.0 / (2.0 * np.pi)
EVERY = 5  # fine steps to a row
SETTLED = 4.0  # s after the start at which the controller holds the aircraft and the log begins
SEASON_START = 1.78e9  # s, Unix time of the season's clock


@dataclass(frozen=True, kw_only=True)
class Airframe:
    """The simulated F16, sound unless changed: RotorPy's numbers, loading and gauge."""

    thrust_coefficient: float = QUAD.thrust_coefficient  # N/rpm²
    drag_area: float = 0.0  # m²
    inflow_slope: float = 0.0  # loss of thrust for each unit of advance ratio in climb
    hidden_mass: float = 0.0  # kg
    gauge_gain: float = 1.0  # liquid in the tank over what the gauge shows
    balance: tuple[float, float] = (0.0, 0.0)  # m, centre of gravity forward, right
    rotor_loss: float = 0.0  # share of one rotor's thrust and torque lost at a speed
    lossy_rotor: int = 0
    loss_from_clock: float = -np.inf  # s on the season's clock
    fouling_rate: float = 0.0  # 1/s share of all rotors' thrust lost with flight time
    blind_to_wind: bool = False  # reported airspeed is ground speed
    lift: float = 0.06  # N/(m/s)² that a rotor gains from air along its disc
    rotor_drag: float = 1.0e-3  # N/(m/s)/(rad/s)
    inertia: tuple[float, float, float] = (2.2, 2.2, 4.5)
    aerodynamics: bool = True

    def parameters(self, mass: float, density: float = SEA_LEVEL_DENSITY) -> dict[str, Any]:
        """RotorPy's dictionary; rotor places are about the true centre of gravity."""
        thick = density / SEA_LEVEL_DENSITY
        curve = thick * self.thrust_coefficient * RPM_PER_RAD_S**2
        inflow = self.inflow_slope * 3600.0 * self.thrust_coefficient
        inflow *= thick / (2.0 * np.pi * 2.0 * QUAD.radius)
        places = QUAD.position - np.array(self.balance)
        return {
            "mass": mass,
            **dict(zip(("Ixx", "Iyy", "Izz"), self.inertia, strict=True)),
            **dict.fromkeys(("Ixy", "Iyz", "Ixz"), 0.0),
            "num_rotors": QUAD.rotors,
            "rotor_pos": {f"r{i}": np.array([x, -y, 0.0]) for i, (x, y) in enumerate(places, 1)},
            "rotor_directions": -QUAD.spin,  # moment about the up axis; CCW turns the body CW
            "rotor_speed_min": 0.0,
            "rotor_speed_max": QUAD.max_rpm / RPM_PER_RAD_S,
            "k_eta": curve,
            "k_m": TORQUE_RATIO * curve,
            **dict.fromkeys(("c_Dx", "c_Dy", "c_Dz"), 0.5 * density * self.drag_area),
            "k_d": thick * self.rotor_drag,
            "k_z": inflow,
            "k_h": thick * self.lift,
            "k_flap": 0.0,
            "tau_m": 0.05,
            "kp_att": 100.0,
            "kd_att": 18.0,
        }


class Midpoint(OdeSolver):
    """One explicit midpoint step over the whole span: a step here is short beside every lag."""

    def __init__(self, fun: Any, t0: float, y0: Any, t_bound: float, vectorized: bool, **_: Any):
        super().__init__(fun, t0, y0, t_bound, vectorized)

    def _step_impl(self) -> tuple[bool, None]:
        span = self.t_bound - self.t
        middle = self.y + 0.5 * span * self.fun(self.t, self.y)
        self.y = self.y + span * self.fun(self.t + 0.5 * span, middle)
        self.t = self.t_bound
        return True, None


class Sprayer(Multirotor):
    """RotorPy's multirotor with a mass that falls, rotors that may be worn, and pushes of gusts."""

    kept = np.ones(QUAD.rotors)  # share of a rotor's thrust and torque at a speed
    push = np.zeros(4)  # N up and N m about RotorPy's axes, from outside

    def load(self, mass: float) -> None:
        self.mass = mass
        self.weight = np.array([0.0, 0.0, -mass * self.g])

    def compute_body_wrench(self, body_rates: Any, rotor_speeds: Any, body_airspeed_vector: Any):
        force, moment = super().compute_body_wrench(
            body_rates, rotor_speeds * np.sqrt(self.kept), body_airspeed_vector
        )
        return force + np.array([0.0, 0.0, self.push[0]]), moment + self.push[1:]


def kept_thrust(airframe: Airframe, time: Array, clock_start: float) -> Array:
    """(T, R) share of the thrust at a speed that each rotor still makes."""
    kept = np.repeat(1.0 - airframe.fouling_rate * time[:, None], QUAD.rotors, axis=1)
    gone = clock_start + time >= airframe.loss_from_clock
    kept[gone, airframe.lossy_rotor] *= 1.0 - airframe.rotor_loss
    return kept


def wanted(motion: Motion, i: int) -> dict[str, Any]:
    """RotorPy's flat outputs at a step of the mission."""
    ahead = min(i + 1, motion.time.size - 1)
    return {
        "x": FLIP * motion.position[i],
        "x_dot": FLIP * motion.velocity[i],
        "x_ddot": FLIP * motion.acceleration[i],
        "yaw": -motion.heading[i],
        "yaw_dot": -(motion.heading[ahead] - motion.heading[i]) / FINE_STEP,
    }


def fly_rotorpy(
    airframe: Airframe, style: Style, day: Day, rng: np.random.Generator, name: str
) -> FlightTrack:
    """Fly a mission in closed loop, and log it at 10 Hz."""
    motion = motion_of(style, rng)
    loaded = Condition(hidden_mass=airframe.hidden_mass, gauge_gain=airframe.gauge_gain)
    around = surroundings(QUAD, loaded, motion, day, rng)
    mass = QUAD.empty_mass + airframe.hidden_mass + around.tank
    gauge = around.tank / airframe.gauge_gain
    hover = np.sqrt(mass[0] * 9.81 / QUAD.rotors / airframe.thrust_coefficient)
    state: dict[str, Array] = {
        "x": FLIP * motion.position[0],
        "v": FLIP * motion.velocity[0],
        "q": Rotation.from_euler("z", -motion.heading[0]).as_quat(),
        "w": np.zeros(3),
        "wind": FLIP * around.air_velocity[0],
        "rotor_speeds": np.full(QUAD.rotors, hover / RPM_PER_RAD_S),
    }
    vehicle = Sprayer(
        airframe.parameters(float(mass[0]), day.density),
        state,
        control_abstraction="cmd_motor_speeds",
        aero=airframe.aerodynamics,
        integrator_kwargs={"method": Midpoint},
    )
    pilot = SE3Control(Airframe().parameters(QUAD.empty_mass))
    kept = kept_thrust(airframe, motion.time, around.clock_start)
    push = around.push * np.array([1.0, *FLIP])
    logged: dict[str, list[Array]] = {k: [] for k in (*state, "vdot")}
    for i in range(motion.time.size):
        vehicle.load(float(mass[i]))
        vehicle.kept, vehicle.push = kept[i], push[i]
        pilot.mass = QUAD.empty_mass + gauge[i]
        state["wind"] = FLIP * around.air_velocity[i]
        control = pilot.update(motion.time[i], state, wanted(motion, i))
        if i % EVERY == 0:
            logged["vdot"].append(vehicle.statedot(state, control, FINE_STEP)["vdot"])
            for key, value in state.items():
                logged[key].append(np.array(value))
        state = vehicle.step(state, control, FINE_STEP)
    log = {k: np.array(v) for k, v in logged.items()}
    return track_of(log, airframe, motion, gauge, day, rng, name)


def track_of(
    log: dict[str, Array],
    airframe: Airframe,
    motion: Motion,
    gauge: Array,
    day: Day,
    rng: np.random.Generator,
    name: str,
) -> FlightTrack:
    """The table of a RotorPy log, with its instruments' noise."""
    rows = slice(round(SETTLED / FINE_STEP / EVERY), None)
    time = motion.time[::EVERY][rows]

    def noise(size: float, columns: int = 0) -> Array:
        return size * rng.standard_normal((time.size, columns) if columns else time.size)

    body = Rotation.from_quat(log["q"][rows])
    yaw, pitch, roll = body.as_euler("ZYX").T
    force = body.inv().apply(log["vdot"][rows] + np.array([0.0, 0.0, 9.81]))
    velocity, wind = FLIP * log["v"][rows], FLIP * log["wind"][rows]
    position = FLIP * log["x"][rows]
    speed = log["rotor_speeds"][rows] * RPM_PER_RAD_S
    through = velocity if airframe.blind_to_wind else velocity - wind
    told = np.nan if airframe.blind_to_wind or not day.wind_reported else 0.0
    return FlightTrack.of(
        name=name,
        time_s=time - time[0],
        rotor_count=QUAD.rotors,
        rotor_speed_rpm=np.round(
            speed + day.noise * QUAD.hover_rpm * rng.standard_normal(speed.shape)
        ),
        position_ned=position,
        velocity_ned=velocity + noise(0.03, 3),
        attitude=np.stack([roll, -pitch, -yaw], axis=1) + noise(0.002, 3),
        angular_rate_frd=FLIP * log["w"][rows] + noise(0.002, 3),
        specific_force_frd=FLIP * force + noise(0.05, 3),
        airspeed=np.maximum(np.linalg.norm(through, axis=1) + noise(0.1), 0.0),
        wind_ned=wind + noise(0.1, 3) + told,
        tank_kg=np.maximum(
            gauge[::EVERY][rows] * day.gauge_gain
            + QUAD.tank_litres * day.gauge_offset
            + noise(0.02),
            0.0,
        ),
        pressure=day.pressure + 12.0 * position[:, 2] + noise(4.0),
        temperature=day.temperature + day.board_heat + noise(0.05),
        altitude=day.altitude - position[:, 2] + noise(0.05),
        height_agl=motion.height[::EVERY][rows],
        spraying=motion.spraying[::EVERY][rows],
        sources={"rotor_speed_rpm": sent("RotorPy")},
        start_unix_s=SEASON_START + day.clock_start + float(time[0]),
    )
