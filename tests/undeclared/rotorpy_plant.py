"""Flights in RotorPy, a multirotor simulator that others wrote, with the F16's mass and curve.

RotorPy integrates the rigid body, the motors' lag and its own aerodynamics (parasite drag, rotor
drag, translational lift, axial inflow) under its own attitude controller; only the way to fly and
the wind come from here. Its world is x forward, y left, z up: signs of y and z turn to NED and FRD.

Its rotor: T = k_eta w² + k_h V² - k_z w v_z with w in rad/s. The inflow term is the same as
1 - k J with k = 2 pi D k_z / (3600 a).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from models.flight import FlightTrack
from tests.undeclared.days import Day, surroundings
from tests.undeclared.missions import FINE_STEP, Style, motion_of
from tests.undeclared.physics import FIRST_ROW, QUAD, Array, Physics

FLIP = np.array([1.0, -1.0, -1.0])
RPM_PER_RAD_S = 60.0 / (2.0 * np.pi)
EVERY = 5  # fine steps to a row


@dataclass(frozen=True, kw_only=True)
class Airframe:
    """The simulated F16 and what is changed about it."""

    physics: Physics
    inflow_slope: float = 0.0
    inertia: tuple[float, float, float] = (2.2, 2.2, 4.5)
    aerodynamics: bool = True


def parameters(airframe: Airframe, mass: float) -> dict[str, Any]:
    """RotorPy's dictionary of an aircraft; rotor places are about the true centre of gravity."""
    physics = airframe.physics
    curve = physics.thrust_coefficient * RPM_PER_RAD_S**2
    k_z = airframe.inflow_slope * 3600.0 * physics.thrust_coefficient
    k_z /= 2.0 * np.pi * physics.propeller_diameter
    places = QUAD.position - np.array(physics.balance)
    return {
        "mass": mass,
        **dict(zip(("Ixx", "Iyy", "Izz"), airframe.inertia, strict=True)),
        **dict.fromkeys(("Ixy", "Iyz", "Ixz"), 0.0),
        "num_rotors": QUAD.rotors,
        "rotor_pos": {f"r{i}": np.array([x, -y, 0.0]) for i, (x, y) in enumerate(places, 1)},
        "rotor_directions": -QUAD.spin,  # moment about the up axis; a CCW rotor turns the body CW
        "rotor_speed_min": 0.0,
        "rotor_speed_max": 3000.0 / RPM_PER_RAD_S,
        "k_eta": curve,
        "k_m": QUAD.torque_ratio * curve,
        "c_Dx": 0.05,
        "c_Dy": 0.05,
        "c_Dz": 0.05,
        "k_d": 1.0e-3,
        "k_z": k_z,
        "k_h": 5.0e-3,
        "tau_m": 0.05,
        "kp_att": 40.0,
        "kd_att": 9.0,
    }


def simulator(airframe: Airframe, state: dict[str, Array], mass: float) -> Any:
    """A RotorPy multirotor of which one rotor may be worn."""
    from rotorpy.vehicles.multirotor import (  # pyright: ignore[reportMissingImports]
        Multirotor,
    )

    kept = np.ones(QUAD.rotors)
    kept[airframe.physics.lossy_rotor] -= airframe.physics.rotor_loss

    class WornMultirotor(Multirotor):
        def compute_body_wrench(
            self, body_rates: Any, rotor_speeds: Any, body_airspeed_vector: Any
        ):
            return super().compute_body_wrench(
                body_rates, rotor_speeds * np.sqrt(kept), body_airspeed_vector
            )

    return WornMultirotor(
        parameters(airframe, mass),
        state,
        control_abstraction="cmd_acc",
        aero=airframe.aerodynamics,
        integrator_kwargs={"method": "RK23", "first_step": FINE_STEP, "rtol": 1e-2, "atol": 1e-3},
    )


def fly_rotorpy(
    airframe: Airframe, style: Style, day: Day, rng: np.random.Generator, name: str
) -> FlightTrack:
    """Fly a mission with the heading kept north, and log it at 10 Hz. Needs rotorpy."""
    motion = motion_of(style, rng)
    around = surroundings(airframe.physics, motion, day, rng)
    mass = airframe.physics.empty_mass + airframe.physics.hidden_mass + around.tank
    hover = np.sqrt(mass[0] * 9.81 / QUAD.rotors / airframe.physics.thrust_coefficient)
    state: dict[str, Array] = {
        "x": FLIP * motion.position[0],
        "v": FLIP * motion.velocity[0],
        "q": np.array([0.0, 0.0, 0.0, 1.0]),
        "w": np.zeros(3),
        "wind": FLIP * around.air_velocity[0],
        "rotor_speeds": np.full(QUAD.rotors, hover / RPM_PER_RAD_S),
    }
    vehicle = simulator(airframe, state, float(mass[0]))
    logged: dict[str, list[Array]] = {k: [] for k in (*state, "vdot")}
    for i in range(motion.time.size):
        vehicle.mass = float(mass[i])
        vehicle.weight = np.array([0.0, 0.0, -mass[i] * vehicle.g])
        state["wind"] = FLIP * around.air_velocity[i]
        wanted = motion.acceleration[i] + 1.6 * (motion.velocity[i] - FLIP * state["v"])
        wanted = wanted + 0.8 * (motion.position[i] - FLIP * state["x"])
        control = {"cmd_acc": FLIP * wanted + np.array([0.0, 0.0, vehicle.g])}
        if i % EVERY == 0:
            logged["vdot"].append(vehicle.statedot(state, control, FINE_STEP)["vdot"])
            for key, value in state.items():
                logged[key].append(np.array(value))
        state = vehicle.step(state, control, FINE_STEP)
    return track_of(
        {k: np.array(v) for k, v in logged.items()}, motion, around.tank, day, rng, name
    )


def track_of(
    log: dict[str, Array], motion: Any, tank: Array, day: Day, rng: np.random.Generator, name: str
) -> FlightTrack:
    """The table of a RotorPy log, with its instruments' noise."""
    time, rows = motion.time[::EVERY], slice(int(FIRST_ROW / FINE_STEP / EVERY), None)
    count = time[rows].size

    def noise(size: float, columns: int = 0) -> Array:
        return size * rng.standard_normal((count, columns) if columns else count)

    body = Rotation.from_quat(log["q"][rows])
    yaw, pitch, roll = body.as_euler("ZYX").T
    force = body.inv().apply(log["vdot"][rows] + np.array([0.0, 0.0, 9.81]))
    velocity = FLIP * log["v"][rows]
    wind = FLIP * log["wind"][rows]
    position = FLIP * log["x"][rows]
    speed = log["rotor_speeds"][rows] * RPM_PER_RAD_S
    return FlightTrack.of(
        name=name,
        time_s=time[rows] - time[rows][0],
        rotor_count=QUAD.rotors,
        rotor_speed_rpm=np.round(speed + day.rotor_noise_rpm * rng.standard_normal(speed.shape)),
        position_ned=position,
        velocity_ned=velocity + noise(0.03, 3),
        attitude=np.stack([roll, -pitch, -yaw], axis=1) + noise(0.002, 3),
        angular_rate_frd=FLIP * log["w"][rows] + noise(0.002, 3),
        specific_force_frd=FLIP * force + noise(0.05, 3),
        airspeed=np.linalg.norm(velocity - wind, axis=1) + noise(0.1),
        wind_ned=wind + noise(0.1, 3),
        tank_kg=np.maximum(tank[::EVERY][rows] + noise(0.02), 0.0),
        pressure=np.full(count, day.pressure),
        temperature=np.full(count, day.temperature + day.board_heat),
        altitude=day.altitude - position[:, 2],
        height_agl=motion.height[::EVERY][rows],
        spraying=motion.spraying[::EVERY][rows],
        sources={"rotor_speed_rpm": "RotorPy"},
        start_unix_s=day.clock_start,
    )
