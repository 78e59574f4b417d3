"""What was found on the real flights, in sentences and as numbers beside those quoted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from gcs_plugin.measured.crazyflie import MeasuredFlight
from gcs_plugin.measured.crazyflie_loop import Loop, ThrustLeft
from gcs_plugin.measured.findings import Number
from gcs_plugin.measured.swing_check import SwingCheck
from gcs_plugin.measured.thrust_check import PlainCheck
from models.motor_order import MotorOrder

QUOTED = "independent check"
GRAMS = 1e3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Flown:
    """Everything worked out on the flights."""

    free: Sequence[MeasuredFlight]
    cable: Sequence[MeasuredFlight]
    order: MotorOrder
    plain: PlainCheck  # every third left out in turn
    plain_third: PlainCheck  # the first third left out
    command: tuple[float, float]
    mass_ratio: float
    lift_ratio: float
    loops: tuple[Loop, ...]  # without payload, one for each third that was left out
    finer: tuple[ThrustLeft, ThrustLeft, ThrustLeft]  # curve, after, after felt on 0.1 s rows
    on_cable: Loop
    swing: SwingCheck


def answer_of(flown: Flown) -> tuple[str, ...]:
    loop, cable = flown.loops[0], flown.on_cable
    curve, after, felt = flown.finer
    names = ", ".join(_names(loop))
    slope, lift = (
        loop.parameter("climb_inflow", "slope"),
        loop.parameter("translational_lift", "gain"),
    )
    extra, load = cable.parameter("extra_mass", "mass"), cable.parameter("slung_load", "mass")
    length = cable.parameter("slung_load", "cable")
    return (
        "No log of a large multirotor with the speed of each rotor was obtainable: these are "
        f"flights of a 37 g quad, {len(flown.free)} without payload and {len(flown.cable)} with "
        "4.7 g on a cable.",
        f"Motor order: {flown.order.words}.",
        f"Plain regression, flights left out: T = a N² fitted in hover leaves "
        f"{flown.plain_third.before:.2f} % of the weight, with climb and in-plane speed "
        f"{flown.plain_third.after:.2f} %; faster than 1.5 m/s {flown.plain_third.before_fast:.2f} "
        f"and {flown.plain_third.after_fast:.2f} %.",
        f"The loop, from weight and thrust curve alone, names {names}; rotor speed error on "
        f"{len(loop.held_out)} flights left out {loop.found.before.rmse_rpm:.0f} -> "
        f"{loop.found.after.rmse_rpm:.0f} rpm.",
        f"Of thrust it leaves {after.all:.2f} % of the weight where the curve leaves "
        f"{curve.all:.2f} % (flights and rows of the plain regression), {after.in_fast:.2f} "
        f"against {curve.in_fast:.2f} % when fast; {felt.all:.2f} and {felt.in_fast:.2f} % against "
        "the raw accelerometer, whose delay and scale the model has found too.",
        f"Axial inflow: thrust falls with the climb by {_ends(slope)} x J; translational lift: "
        f"{_ends(lift)} of what the induced velocity loses.",
        f"Battery voltage does not explain thrust at a rotor speed (r = "
        f"{flown.plain.voltage_correlation:.2f}), but rotor speed at a command: error "
        f"{flown.command[0]:.0f} -> {flown.command[1]:.0f} rpm.",
        f"With the load, judged against the model of the flights without: names "
        f"{', '.join(_names(cable))}; {cable.found.before.rmse_rpm:.0f} -> "
        f"{cable.found.after.rmse_rpm:.0f} rpm on {len(cable.held_out)} flights left out, thrust "
        f"{cable.before.all:.1f} -> {cable.after.all:.1f} % of the weight.",
        f"It finds {_ends(extra, GRAMS)} g more mass (weighed: 7.4), of which {_ends(load, GRAMS)} "
        f"g (weighed: 4.7) swing on {_ends(length)} m of cable (aircraft to load by motion "
        f"capture: {flown.swing.distance:.2f} m).",
        f"The swing it works out from the aircraft's own accelerometer is {flown.swing.apart:.0f} "
        f"deg off the load's measured direction; a load that did not swing would be "
        f"{flown.swing.apart_if_hanging:.0f} deg off, and it swings up to "
        f"{flown.swing.swing_largest:.0f} deg.",
        f"In hover the sum of squared rotor speeds is {flown.lift_ratio:.3f} times that without "
        f"load, at the same load factor, where the masses say {flown.mass_ratio:.3f}.",
    )


def numbers_of(flown: Flown) -> tuple[Number, ...]:
    plain, loop, cable = flown.plain_third, flown.loops[0], flown.on_cable
    curve, after, felt = flown.finer

    def number(name: str, value: float, unit: str = "1", quoted: float | None = None) -> Number:
        return Number(
            name=name,
            value=value,
            unit=unit,
            quoted=quoted,
            quoted_from=QUOTED if quoted is not None else "",
        )

    weighed = {"quoted_from": "PROVENANCE"}
    made = [
        number("plain_before", plain.before, "% of weight", 1.65),
        number("plain_after", plain.after, "% of weight", 1.17),
        number("plain_before_fast", plain.before_fast, "% of weight", 3.43),
        number("plain_after_fast", plain.after_fast, "% of weight", 1.82),
        number("plain_before_all_thirds", flown.plain.before, "% of weight"),
        number("plain_after_all_thirds", flown.plain.after, "% of weight"),
        number("loop_curve", curve.all, "% of weight", 1.65),
        number("loop_after", after.all, "% of weight", 1.17),
        number("loop_after_felt", felt.all, "% of weight"),
        number("loop_curve_fast", curve.in_fast, "% of weight", 3.43),
        number("loop_after_fast", after.in_fast, "% of weight", 1.82),
        number("loop_after_fast_felt", felt.in_fast, "% of weight"),
        number("loop_rmse_before", loop.found.before.rmse_rpm, "rpm"),
        number("loop_rmse_after", loop.found.after.rmse_rpm, "rpm"),
        number("loop_r2_after", loop.found.after.r2),
        number("loop_floor", loop.found.floor_rpm, "rpm"),
        number("climb_inflow_slope", loop.parameter("climb_inflow", "slope")[0]),
        number("translational_lift_gain", loop.parameter("translational_lift", "gain")[0]),
        number("hover_coefficient", flown.plain.coefficient, "N/rpm^2"),
        number("voltage_correlation", flown.plain.voltage_correlation, "1", 0.04),
        number("speed_by_command", flown.command[0], "rpm", 253.0),
        number("speed_by_command_and_voltage", flown.command[1], "rpm", 134.0),
        number("hover_lift_ratio", flown.lift_ratio, "1", 1.171),
        number("mass_ratio", flown.mass_ratio, "1", 1.2),
        number("cable_rmse_before", cable.found.before.rmse_rpm, "rpm"),
        number("cable_rmse_after", cable.found.after.rmse_rpm, "rpm"),
        number("cable_thrust_before", cable.before.all, "% of weight"),
        number("cable_thrust_after", cable.after.all, "% of weight"),
        Number(
            name="extra_mass",
            value=GRAMS * cable.parameter("extra_mass", "mass")[0],
            unit="g",
            quoted=7.4,
            **weighed,
        ),
        Number(
            name="slung_mass",
            value=GRAMS * cable.parameter("slung_load", "mass")[0],
            unit="g",
            quoted=4.7,
            **weighed,
        ),
        number("cable_length", cable.parameter("slung_load", "cable")[0], "m"),
        number("load_distance", flown.swing.distance, "m"),
        number("swing_apart", flown.swing.apart, "deg"),
        number("swing_apart_if_hanging", flown.swing.apart_if_hanging, "deg"),
        number("swing_largest", flown.swing.swing_largest, "deg"),
    ]
    for third, other in enumerate(flown.loops):
        made += [
            number(f"third_{third + 1}_curve", other.curve.all, "% of weight"),
            number(f"third_{third + 1}_after", other.after.all, "% of weight"),
            number(f"third_{third + 1}_after_felt", other.after_felt.all, "% of weight"),
            number(f"third_{third + 1}_curve_fast", other.curve.in_fast, "% of weight"),
            number(f"third_{third + 1}_after_fast", other.after.in_fast, "% of weight"),
        ]
    return tuple(made)


def _names(loop: Loop) -> list[str]:
    names = []
    for found in loop.found.found:
        rotor = found.term.rotor
        where = "" if rotor is None else f" of rotor {rotor + 1}"
        names.append(found.term.effect.name.replace("_", " ") + where)
    return names or ["nothing"]


def _ends(parameter: tuple[float, float, float], factor: float = 1.0) -> str:
    value, low, high = (factor * end for end in parameter)
    return f"{value:.2f} ({low:.2f} to {high:.2f})"
