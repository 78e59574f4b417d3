"""Read from an autopilot's parameters how fast a vehicle flies a mission: speed, acceleration,
jerk, yaw.

Names and defaults are those of ArduPilot's Copter 4.7 (older names: `parameter_names`) and of PX4
1.16. A missing parameter takes its default, and `assumed` lists it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from thrustmargin.mission.forecast.yaw_response import YawLoop, yaw_authority
from thrustmargin.mission.plan_check import parameter
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.rotor_model import RotorModel


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightLimits:
    """The limits of motion that an autopilot keeps in a mission."""

    speed: float  # m/s over ground where the plan orders none
    climb_speed: float  # m/s
    descent_speed: float
    acceleration: float  # m/s², horizontal
    corner_acceleration: float  # m/s² in the middle of a corner
    climb_acceleration: float  # m/s²
    jerk: float  # m/s³
    climb_jerk: float  # m/s³ of take-off
    snap: float  # m/s⁴
    radius: float  # m from a place within which its corner is cut
    land_speed: float  # m/s near the ground
    land_below: float  # m above home
    fast_landing: float  # m/s down to `land_below` in a landing
    return_height: float  # m above home
    return_climb: float  # m that a return climbs at least
    return_cone: float  # times the distance from home, above which it does not climb; inf: none
    return_speed: float  # m/s over ground
    return_wait_s: float  # s over home before it lands, at least
    return_turns_early: bool  # it turns home before its climb has ended
    yaw_rate: float  # rad/s
    yaw_acceleration: float  # rad/s²
    yaw_time: float  # s in which a small error of heading is turned away
    yaw_loop: YawLoop  # by which the yaw follows its target
    nose_ahead: bool  # the nose points along the path flown
    nose_home: bool  # also on the return
    turns_back: bool  # over home it turns as it was before take-off, and lands then
    sprays_by_speed: bool  # the pump's flow follows the speed over ground
    spray_speed: float = 0.0  # m/s below which the pump rests
    assumed: tuple[str, ...] = ()  # parameters that were not known

    def return_top(self, height: Floats, away: Floats) -> Floats:
        """Return the height (N,), m above home, to which a return climbs.

        It begins at `height` (N,), m above home, `away` (N,) m from it.
        """
        wanted = np.minimum(self.return_height, self.return_cone * away)
        return np.maximum(height + self.return_climb, wanted)


#: field of FlightLimits -> parameter, and its default.
_ARDUPILOT: Mapping[str, tuple[str, float]] = {
    "speed": ("WP_SPD", 10.0),
    "climb_speed": ("WP_SPD_UP", 2.5),
    "descent_speed": ("WP_SPD_DN", 1.5),
    "acceleration": ("WP_ACC", 2.5),
    "corner_acceleration": ("WP_ACC_CNR", 0.0),
    "climb_acceleration": ("WP_ACC_Z", 1.0),
    "jerk": ("WP_JERK", 1.0),
    "climb_jerk": ("PSC_D_JERK", 5.0),
    "radius": ("WP_RADIUS_M", 2.0),
    "land_speed": ("LAND_SPD_MS", 0.5),
    "land_below": ("LAND_ALT_LOW_M", 10.0),
    "fast_landing": ("LAND_SPD_HIGH_MS", 0.0),  # 0: the descent speed
    "return_height": ("RTL_ALT_M", 15.0),
    "return_climb": ("RTL_CLIMB_MIN_M", 0.0),
    "return_cone": ("RTL_CONE_SLOPE", 3.0),
    "return_speed": ("RTL_SPEED_MS", 0.0),  # 0: the speed of a mission
    "wait_ms": ("RTL_LOIT_TIME", 5000.0),
    "slew_deg": ("ATC_RATE_WPY_MAX", 60.0),
    "yaw_rate_deg": ("ATC_RATE_Y_MAX", 0.0),
    "yaw_acceleration_deg": ("ATC_ACC_Y_MAX", 270.0),
    "yaw_time": ("ATC_INPUT_TC", 0.15),
    "angle_gain": ("ATC_ANG_YAW_P", 4.5),
    "rate_gain": ("ATC_RAT_YAW_P", 0.18),
    "rate_integral": ("ATC_RAT_YAW_I", 0.018),
    "rate_filter_hz": ("ATC_RAT_YAW_FLTE", 2.5),
    "yaw_behaviour": ("WP_YAW_BEHAVIOR", 2.0),
    "spray_cm_s": ("SPRAY_SPEED_MIN", 100.0),
}
_PX4: Mapping[str, tuple[str, float]] = {
    "speed": ("MPC_XY_CRUISE", 5.0),
    "climb_speed": ("MPC_Z_V_AUTO_UP", 3.0),
    "descent_speed": ("MPC_Z_V_AUTO_DN", 1.5),
    "acceleration": ("MPC_ACC_HOR", 3.0),
    "climb_acceleration": ("MPC_ACC_UP_MAX", 4.0),
    "jerk": ("MPC_JERK_AUTO", 4.0),
    "climb_jerk": ("MPC_JERK_AUTO", 4.0),
    "radius": ("NAV_ACC_RAD", 10.0),
    "land_speed": ("MPC_LAND_SPEED", 0.7),
    "land_below": ("MPC_LAND_ALT2", 5.0),
    "return_height": ("RTL_RETURN_ALT", 60.0),
    "yaw_rate_deg": ("MPC_YAWRAUTO_MAX", 60.0),
    "yaw_acceleration_deg": ("MPC_YAWRAUTO_ACC", 20.0),
    "angle_gain": ("MC_YAW_P", 2.8),
    "yaw_behaviour": ("MPC_YAW_MODE", 0.0),
}
LEAST_CONE = 0.5  # RTL_CONE_SLOPE below which there is no cone (RTL_MIN_CONE_SLOPE)
PX4_CONE, PX4_WAIT_S = 3.0, 5.0  # taken as with ArduPilot
#: rad/s² with which the angle loop brakes a yaw error, at least and at most (AC_AttitudeControl)
LEAST_BRAKING, MOST_BRAKING = math.radians(10.0), math.radians(120.0)
PX4_YAW_TIME = 0.25  # s, about what its attitude loop takes


def _values(
    table: Mapping[str, tuple[str, float]], parameters: Mapping[str, float]
) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return the value of each field of `table`, and texts on the parameters that are missing.

    `table` maps a field to the name of an autopilot parameter and its default, which is used where
    `parameters` lacks the name. Each text is a missing parameter's name and default: "WPNAV_SPEED
    10".
    """
    stated = {name: parameter(parameters, name) for name, _ in table.values()}
    unknown = [
        (name, default) for name, default in table.values() if not math.isfinite(stated[name])
    ]
    values = {key: stated[n] if math.isfinite(stated[n]) else d for key, (n, d) in table.items()}
    return values, tuple(f"{name} {default:g}" for name, default in unknown)


def flight_limits(
    parameters: Mapping[str, float], *, px4: bool = False, model: RotorModel | None = None
) -> FlightLimits:
    """Return the motion limits, SI, that a vehicle's parameters, by name, set.

    Missing parameters take the autopilot's defaults. The yaw moment of the rotors is computed from
    `model`; with None it is unknown.
    """
    limits = (_px4 if px4 else _ardupilot)(parameters)
    if model is None:
        return limits
    authority, damping = yaw_authority(model)
    return replace(limits, yaw_loop=replace(limits.yaw_loop, authority=authority, damping=damping))


def _ardupilot(parameters: Mapping[str, float]) -> FlightLimits:
    """Return the limits, in SI units, that the ArduPilot `parameters` (by name) set.

    A parameter that is missing has its default, and is listed in `assumed`.
    """
    values, assumed = _values(_ARDUPILOT, parameters)
    slew = math.radians(values.pop("slew_deg"))
    rate = math.radians(values.pop("yaw_rate_deg"))
    behaviour = values.pop("yaw_behaviour")
    spray, wait_ms = 0.01 * values.pop("spray_cm_s"), values.pop("wait_ms")
    turning = math.radians(values.pop("yaw_acceleration_deg"))
    values["corner_acceleration"] = values["corner_acceleration"] or 2.0 * values["acceleration"]
    values["fast_landing"] = values["fast_landing"] or values["descent_speed"]
    values["return_speed"] = values["return_speed"] or values["speed"]
    if values["return_cone"] < LEAST_CONE:
        values["return_cone"] = math.inf
    filtered = 2.0 * math.pi * values.pop("rate_filter_hz")  # 0 Hz is no filter
    loop = YawLoop(
        **{name: values.pop(name) for name in ("angle_gain", "rate_gain", "rate_integral")},
        braking=min(max(0.5 * turning, LEAST_BRAKING), MOST_BRAKING),
        rate_filter=filtered if filtered > 0.0 else math.inf,
    )
    return FlightLimits(
        **values,
        return_wait_s=1e-3 * wait_ms,
        return_turns_early=True,
        spray_speed=spray,
        # Half of what leaning takes in the time of the attitude controller (AC_WPNav).
        snap=values["jerk"] * math.pi / (4.0 * max(values["yaw_time"], 0.1)),
        yaw_rate=min(slew, rate) if rate > 0.0 else slew,
        yaw_acceleration=turning,
        yaw_loop=loop,
        nose_ahead=behaviour in (1.0, 2.0, 3.0),
        nose_home=behaviour in (1.0, 3.0),
        turns_back=behaviour in (1.0, 3.0),
        sprays_by_speed=parameters.get("SPRAY_ENABLE", 1.0) > 0.0,
        assumed=assumed,
    )


def _px4(parameters: Mapping[str, float]) -> FlightLimits:
    """Return the limits, in SI units, that the PX4 `parameters` (by name) set.

    A parameter that is missing has its default, and is listed in `assumed`.
    """
    values, assumed = _values(_PX4, parameters)
    loop = YawLoop(angle_gain=values.pop("angle_gain"))
    behaviour = values.pop("yaw_behaviour")
    rate, turning = (
        math.radians(values.pop(name)) for name in ("yaw_rate_deg", "yaw_acceleration_deg")
    )
    return FlightLimits(
        **values,
        corner_acceleration=values["acceleration"],
        fast_landing=values["descent_speed"],
        return_climb=0.0,
        return_cone=PX4_CONE,
        return_speed=values["speed"],
        return_wait_s=PX4_WAIT_S,
        return_turns_early=False,
        snap=values["jerk"] * math.pi / (4.0 * PX4_YAW_TIME),
        yaw_rate=rate,
        yaw_acceleration=turning,
        yaw_time=PX4_YAW_TIME,
        yaw_loop=loop,
        nose_ahead=behaviour in (0.0, 3.0),
        nose_home=behaviour in (0.0, 3.0),
        turns_back=False,
        sprays_by_speed=False,
        assumed=assumed,
    )
