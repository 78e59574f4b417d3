"""What was found on the real flights, in sentences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tests.measured.crazyflie import MeasuredFlight
from tests.measured.crazyflie_errors import ThrustLeft
from tests.measured.crazyflie_loop import Loop, speed_errors
from tests.measured.swing_check import SwingCheck
from tests.measured.thrust_check import CommandCheck, PlainCheck
from thrustmargin.models.checks.motor_order import MotorOrder

GRAMS = 1e3
EXTRA_MASS, SLUNG_MASS = 7.4, 4.7  # g, by the masses that the source states


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Flown:
    """Everything worked out on the flights."""

    flights: tuple[int, int]  # in the files without payload and with a load on a cable
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
    cable: tuple[MeasuredFlight, ...]
    swing: SwingCheck


def answer_of(flown: Flown) -> tuple[str, ...]:
    loop, cable = flown.loops[0], flown.on_cable
    before, after = speed_errors(flown.loops)
    slope, lift = (
        loop.parameter("climb_inflow", "slope"),
        loop.parameter("translational_lift", "gain"),
    )
    judged = sum(len(one.held_out) for one in flown.loops)
    return (
        f"On real flights with the measured speed of each rotor the loop names what the model "
        f"lacks - {_names(flown.loops)} - and on flights left out the error of rotor speed falls "
        f"from {before:.0f} to {after:.0f} rpm, that of thrust from {flown.curve.all:.2f} to "
        f"{flown.after.all:.2f} % of the weight.",
        "No log of a large multirotor with the speed of each rotor was obtainable: these are "
        f"flights of a 37 g quad, {flown.flights[0]} without payload and {flown.flights[1]} with "
        "4.7 g on a cable.",
        f"Without payload, {judged} flights left out: faster than 1.5 m/s the error of thrust "
        f"falls from {flown.curve.in_fast:.2f} to {flown.after.in_fast:.2f} % of the weight. "
        "Against the raw accelerometer, whose delay and scale the model finds too, "
        f"{flown.after_felt.all:.2f} % is left, {flown.after_felt.in_fast:.2f} % when fast; the "
        "yardstick below is fitted to that accelerometer itself.",
        "A plain regression of thrust on climb and in-plane speed, the yardstick, on the same "
        f"flights: {flown.plain.before:.2f} -> {flown.plain.after:.2f} %, when fast "
        f"{flown.plain.before_fast:.2f} -> {flown.plain.after_fast:.2f} %."
        f"{_with_all(flown)}",
        f"Axial inflow: thrust falls with the climb by {_ends(slope)} x J; translational lift: "
        f"{_ends(lift)} of what the induced velocity loses.",
        "Battery voltage does not explain thrust at a rotor speed (r = "
        f"{flown.plain.voltage_correlation:.2f}), but rotor speed at a command: error "
        f"{flown.command.command:.0f} -> {flown.command.voltage:.0f} rpm, and "
        f"{flown.command.delayed:.0f} rpm with the motor {1e3 * flown.command.delay:.0f} ms behind "
        "its command.",
        f"Motor order: {flown.order.words}.",
        f"With the load, judged against the model of the flights without, the loop names "
        f"{_names((cable,))}; on {len(cable.held_out)} flights left out "
        f"{cable.found.before.rmse_rpm:.0f} -> {cable.found.after.rmse_rpm:.0f} rpm and "
        f"{cable.before.all:.1f} -> {cable.after.all:.1f} % of the weight "
        f"({cable.curve.all:.1f} % by the curve with the mass known).",
        *_load_words(flown),
    )


def _with_all(flown: Flown) -> str:
    """What the regression says when flights put aside are kept; nothing if it says the same."""
    whole = flown.plain_of_all
    if whole == flown.plain:
        return ""
    return (
        f" With the flights that were put aside (see what was left out): {whole.before:.2f} -> "
        f"{whole.after:.2f} %, when fast {whole.before_fast:.2f} -> {whole.after_fast:.2f} %."
    )


def _load_words(flown: Flown) -> tuple[str, ...]:
    cable, swing = flown.on_cable, flown.swing
    extra, load = cable.parameter("extra_mass", "mass"), cable.parameter("slung_load", "mass")
    length = cable.parameter("slung_load", "cable")
    more = 100.0 * (flown.mass_ratio / flown.lift_ratio - 1.0)
    words = [
        f"It finds {_ends(extra, GRAMS)} g more mass (weighed: {EXTRA_MASS}). In hover the sum of "
        f"squared rotor speeds is {flown.lift_ratio:.3f} times that without load where the masses "
        f"say {flown.mass_ratio:.3f}: by them this aircraft makes {more:.1f} % more thrust at a "
        "rotor speed than the other, which rotor speeds alone cannot tell from mass.",
        f"Of the mass {_ends(load, GRAMS)} g (weighed: {SLUNG_MASS}) swing on {_ends(length)} m of "
        f"cable (aircraft to load by motion capture: {swing.distance:.2f} m). Swing and load "
        "factor rise together, and the loop leaves the gain of the load factor free; a plain "
        f"regression with that gain at 1 gives {GRAMS * swing.mass:.1f} g on the same swing and "
        f"{GRAMS * swing.mass_by_capture:.1f} g on that of motion capture.",
        "The swing, worked "
        f"out from the aircraft's own accelerometer, is {swing.apart:.0f} deg off the load's "
        f"measured direction; a load that did not swing would be {swing.apart_if_hanging:.0f} deg "
        f"off, and it swings up to {swing.swing_largest:.0f} deg.",
    ]
    worn = [
        f"rotor {rotor + 1} {abs(100 * loss):.1f} % {'less' if loss > 0 else 'more'}"
        for rotor, loss in cable.losses
    ]
    if worn:
        words.append(
            f"Rotor by rotor, thrust at the reported speed differs from the model's: "
            f"{', '.join(worn)}. This is another aircraft, with other sensors (see the flights put "
            "aside)."
        )
    return tuple(words)


def _names(loops: Sequence[Loop]) -> str:
    """Effects that every loop found, and those that only some did."""
    always = [n for n in loops[0].names if all(n in loop.names for loop in loops)]
    sometimes = dict.fromkeys(n for loop in loops for n in loop.names if n not in always)
    words = ", ".join(always) or "nothing"
    if not sometimes:
        return words
    counted = (
        f"{name} ({sum(name in loop.names for loop in loops)} of {len(loops)} times)"
        for name in sometimes
    )
    return f"{words}, and not always {', '.join(counted)}"


def _ends(parameter: tuple[float, float, float], factor: float = 1.0) -> str:
    value, low, high = (factor * end for end in parameter)
    if value != value:
        return "nothing"
    return f"{value:.2f} ({low:.2f} to {high:.2f})"
