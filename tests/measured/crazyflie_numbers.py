"""What was found on the real flights, as numbers beside those quoted."""

from __future__ import annotations

from dataclasses import dataclass

from tests.measured.crazyflie_errors import ThrustLeft
from tests.measured.crazyflie_loop import Loop, speed_errors
from tests.measured.findings import Aim, Number
from tests.measured.swing_check import SwingCheck
from tests.measured.thrust_check import CommandCheck, PlainCheck
from thrustmargin.models.checks.motor_order import MotorOrder

GRAMS = 1e3
EXTRA_MASS, SLUNG_MASS = 7.4, 4.7  # g, by the masses that the source states
#: name, label, value found, unit, value quoted, how the two have to compare
_Row = tuple[str, str, float, str, float, Aim]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Flown:
    """Everything worked out on the flights."""

    put_aside: tuple[str, ...]  # flights that were not used, and why
    order: MotorOrder
    plain: PlainCheck  # the flights that the loop used
    plain_of_all: PlainCheck  # every flight
    command: CommandCheck
    mass_ratio: float
    lift_ratio: float
    loops: tuple[Loop, ...]  # without payload, one for each third that was left out
    curve: ThrustLeft  # T = a N² against mass times felt force, rows of the plain regression
    after: ThrustLeft  # the model with the effects found, on the same rows
    after_felt: ThrustLeft  # its thrust against mass times felt force
    on_cable: Loop
    swing: SwingCheck


def numbers_of(flown: Flown) -> tuple[Number, ...]:
    """Everything as numbers; first those that an independent check or a weighing has too."""
    plain, cable = flown.plain, flown.on_cable
    curve, after, felt = flown.curve, flown.after, flown.after_felt
    before_rpm, after_rpm = speed_errors(flown.loops)
    share = "% of weight"
    effect = {
        name: flown.loops[0].parameter(name, parameter)[0]
        for name, parameter in (("climb_inflow", "slope"), ("translational_lift", "gain"))
    }
    loaded = {
        name: cable.parameter(*place)[0]
        for name, place in (
            ("extra_mass", ("extra_mass", "mass")),
            ("slung_mass", ("slung_load", "mass")),
            ("cable_length", ("slung_load", "cable")),
        )
    }
    fast, raw = "over 1.5 m/s", "against the raw accelerometer"
    by = "rotor speed by command"
    voltage = plain.voltage_correlation
    checked: tuple[_Row, ...] = (
        ("loop_curve", "thrust, curve alone", curve.all, share, 1.65, ""),
        ("loop_after", "thrust, effects found", after.all, share, 1.17, "at most"),
        ("loop_after_felt", f"the same {raw}", felt.all, share, 1.17, "at most"),
        ("loop_curve_fast", f"thrust {fast}, curve alone", curve.in_fast, share, 3.43, ""),
        ("loop_after_fast", f"thrust {fast}, effects found", after.in_fast, share, 1.82, "at most"),
        ("loop_after_fast_felt", f"the same {raw}", felt.in_fast, share, 1.82, "at most"),
        ("plain_before", "plain regression, curve alone", plain.before, share, 1.65, "like"),
        ("plain_after", "plain regression", plain.after, share, 1.17, "at most"),
        ("plain_before_fast", f"its curve {fast}", plain.before_fast, share, 3.43, ""),
        ("plain_after_fast", f"plain regression {fast}", plain.after_fast, share, 1.82, "at most"),
        ("voltage_correlation", "voltage with thrust at a rotor speed, r", voltage, "1", 0.04, ""),
        ("speed_by_command", by, flown.command.command, "rpm", 253.0, ""),
        (
            "speed_by_command_and_voltage",
            f"{by} and voltage",
            flown.command.voltage,
            "rpm",
            134.0,
            "at most",
        ),
        (
            "speed_by_command_voltage_and_delay",
            "the same after the motor's delay",
            flown.command.delayed,
            "rpm",
            134.0,
            "at most",
        ),
        (
            "hover_lift_ratio",
            "sum of N² in hover, with load over without",
            flown.lift_ratio,
            "1",
            1.171,
            "like",
        ),
        ("mass_ratio", "mass, with load over without", flown.mass_ratio, "1", 1.2, "like"),
    )
    carried, slung = GRAMS * loaded["extra_mass"], GRAMS * loaded["slung_mass"]
    weighed: tuple[_Row, ...] = (
        ("extra_mass", "extra mass found", carried, "g", EXTRA_MASS, "like"),
        ("slung_mass", "swinging mass found", slung, "g", SLUNG_MASS, "like"),
    )
    rest = {
        "loop_rmse_before": (before_rpm, "rpm"),
        "loop_rmse_after": (after_rpm, "rpm"),
        "loop_r2_after": (flown.loops[0].found.after.r2, "1"),
        "loop_floor": (flown.loops[0].found.floor_rpm, "rpm"),
        "climb_inflow_slope": (effect["climb_inflow"], "1"),
        "translational_lift_gain": (effect["translational_lift"], "1"),
        "hover_coefficient": (plain.coefficient, "N/rpm^2"),
        "motor_delay": (flown.command.delay, "s"),
        "plain_before_all_flights": (flown.plain_of_all.before, share),
        "plain_after_all_flights": (flown.plain_of_all.after, share),
        "cable_rmse_before": (cable.found.before.rmse_rpm, "rpm"),
        "cable_rmse_after": (cable.found.after.rmse_rpm, "rpm"),
        "cable_thrust_curve": (cable.curve.all, share),
        "cable_thrust_before": (cable.before.all, share),
        "cable_thrust_after": (cable.after.all, share),
        "cable_length": (loaded["cable_length"], "m"),
        "load_distance": (flown.swing.distance, "m"),
        "slung_mass_by_regression": (GRAMS * flown.swing.mass, "g"),
        "slung_mass_by_regression_on_capture": (GRAMS * flown.swing.mass_by_capture, "g"),
        "swing_apart": (flown.swing.apart, "deg"),
        "swing_apart_if_hanging": (flown.swing.apart_if_hanging, "deg"),
        "swing_largest": (flown.swing.swing_largest, "deg"),
    }
    for third, other in enumerate(flown.loops, start=1):
        rest |= {
            f"third_{third}_curve": (other.curve.all, share),
            f"third_{third}_after": (other.after.all, share),
            f"third_{third}_curve_fast": (other.curve.in_fast, share),
            f"third_{third}_after_fast": (other.after.in_fast, share),
        }
    return (
        *(
            Number(name, value, unit, quoted, aim, label)
            for name, label, value, unit, quoted, aim in (*checked, *weighed)
        ),
        *(Number(name, value, unit) for name, (value, unit) in rest.items()),
    )
