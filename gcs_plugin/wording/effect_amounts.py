"""What each effect of the table says about the aircraft: the part, the amount and its interval.

One function an effect, of an effect within the identification that found it. A sentence has no full
stop, and no action.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from thrustmargin.gcs_plugin.wording.described_effect import DescribedEffect, joined
from thrustmargin.gcs_plugin.wording.numbers import clock, number, within
from thrustmargin.models.identification.result import Found

#: m/s at which the climb effect is described
CLIMB_RATE = 2.0
MOST_LISTED = 4


def by_parameters(it: DescribedEffect) -> str:
    term = it.found.term
    where = "" if term.rotor is None else f" of {it.rotor.lower()}"
    values = ", ".join(
        f"{p.name.replace('_', ' ')} "
        + it.text(p.name, "" if p.unit == "1" else p.unit.replace("^2", "²"), most=4)
        for p in term.effect.parameters
    )
    return f"{term.effect.name.replace('_', ' ').capitalize()}{where}: {values}"


def _sized(start: str, parts: tuple[str, str], end: str) -> str:
    """`Rotor 1 makes 8 % less thrust (7.8 to 8.2)`."""
    amount, interval = parts
    return f"{start} {amount} {end} {interval}".rstrip()


def _percent(it: DescribedEffect, name: str, factor: float = 1.0) -> tuple[str, str]:
    return it.size(name, "%", factor=100.0 * factor, most=1)


def weak_rotor(it: DescribedEffect) -> str:
    more = "more" if it.negative("loss") else "less"
    than = " than its share of the motor outputs" if it.whole.problem.of_outputs else ""
    if it.known:
        than = " than the model has it"
    return _sized(f"{it.rotor} makes", _percent(it, "loss"), f"{more} thrust{than}")


def weakened_in_flight(it: DescribedEffect) -> str:
    what = "gained" if it.negative("loss") else "lost"
    when = clock(it.ends("onset_time")[0])
    where = it.whole.problem.names[it.found.flight]
    clear = (it.found.lower[:, 0] > 0.0) | (it.found.upper[:, 0] < 0.0)
    more = int(clear.sum()) - 1
    also = f" and in {more} more of {clear.size} flights" if more > 0 else ""
    lost = _sized(f"{it.rotor} {what}", _percent(it, "loss"), "of its thrust")
    return f"{lost} in flight, {when} into {where}{also}"


def weakened_for_a_while(it: DescribedEffect) -> str:
    began, ended = (clock(it.ends(name)[0]) for name in ("onset_time", "end_time"))
    where = it.whole.problem.names[it.found.flight]
    lost = _sized(f"{it.rotor} lost", _percent(it, "loss"), "of its thrust")
    return f"{lost} for a while, from {began} to {ended} of {where}"


def weakens_each_flight(it: DescribedEffect) -> str:
    what = "gains" if it.negative("loss") else "loses"
    when = clock(it.ends("onset_time")[0])
    lost = _sized(f"{it.rotor} {what}", _percent(it, "loss"), "of its thrust")
    return f"{lost} {when} into every flight"


def weak_since_a_flight(it: DescribedEffect) -> str:
    what = "gained" if it.negative("loss") else "lost"
    problem, at = it.whole.problem, it.ends("onset_clock")[0]
    began = problem.flight_start_unix_s - problem.first_row_s
    flown = np.flatnonzero(began <= at)
    when = f"from Unix time {at:.0f} s"
    if flown.size:
        flight = int(flown[np.argmax(began[flown])])
        when = f"{clock(at - float(began[flight]))} into {problem.names[flight]}"
    lost = _sized(f"{it.rotor} {what}", _percent(it, "loss"), "of its thrust")
    return f"{lost} {when}, and has stayed so in later flights"


def hidden_mass(it: DescribedEffect) -> str:
    than = "lighter" if it.negative("mass") else "heavier"
    return _sized("The aircraft is", it.size("mass", "kg"), f"{than} than model and tank gauge say")


def air_density(it: DescribedEffect) -> str:
    than = "colder" if it.negative("temperature_offset") else "warmer"
    offset = it.size("temperature_offset", "K", most=1)
    if it.known:
        return _sized("The air is", offset, f"{than} than the model has it")
    flown = number(float(np.nanmedian(it.whole.problem.channels.density)), "kg/m³", 3)
    known = number(it.whole.model.reference_density, "kg/m³", 3)
    air = _sized("the air is", offset, f"{than} than pressure and height say")
    return f"The model does not follow air density: flown in {flown}, model of {known}, {air}"


def tank_gauge(it: DescribedEffect) -> str:
    return _gain("The tank gauge shows", it)


def airspeed_gain(it: DescribedEffect) -> str:
    return _gain("The airspeed sensor shows", it)


def _gain(what: str, it: DescribedEffect) -> str:
    """Of an instrument whose true value is gain times what it shows."""
    value, *ends = (1.0 - 1.0 / gain for gain in it.ends("gain"))
    sign, much = (-1.0, "much") if value < 0.0 else (1.0, "little")
    shown = within(value, ends[0], ends[1], "%", factor=100.0 * sign, most=1)
    return _sized(what, shown, f"too {much}")


def tank_zero(it: DescribedEffect) -> str:
    flight = it.whole.problem.names[it.found.flight]
    shown = _sized("The tank gauge shows", it.size("offset", "kg"), _too(it, "offset"))
    flights = it.found.value.shape[0]
    return f"{shown} in {flight}" + (", most of all flights" if flights > 1 else "")


def tank_drift(it: DescribedEffect) -> str:
    shown = it.size("rate", "kg", factor=600.0)
    return _sized("The tank gauge shows", shown, f"{_too(it, 'rate')} after 10 minutes")


def airspeed_bias(it: DescribedEffect) -> str:
    return _sized("The airspeed sensor shows", it.size("bias", "m/s"), _too(it, "bias"))


def _too(it: DescribedEffect, name: str) -> str:
    """Of what is to be added to what an instrument shows."""
    return "too much" if it.negative(name) else "too little"


def flow_moment(it: DescribedEffect) -> str:
    parts = [f"{axis} {it.text(axis, most=3)}" for axis in ("roll", "pitch")]
    return f"Flying level makes moments that the model lacks, with the gain {', '.join(parts)}"


def drag_moment(it: DescribedEffect) -> str:
    parts = [f"{axis} {it.text(axis, 'm', most=3)}" for axis in ("roll", "pitch")]
    return (
        "Leaning into wind makes moments that the model lacks, as drag that acts above the centre "
        f"of gravity does: {', '.join(parts)}"
    )


def late_airspeed(it: DescribedEffect) -> str:
    return _late("The airspeed is", it)


def late_rotor_speed(it: DescribedEffect) -> str:
    return _late("The rotor speeds are", it)


def _late(what: str, it: DescribedEffect) -> str:
    than = "early" if it.negative("lag") else "late"
    return _sized(f"{what} reported", it.size("lag", "s"), than)


def drag(it: DescribedEffect) -> str:
    than = "less" if it.negative("drag_area") else "more"
    return _sized(
        "The aircraft has", it.size("drag_area", "m²"), f"{than} drag area than its model"
    )


def load_factor(it: DescribedEffect) -> str:
    what = "Thrust follows the load factor of turns, climbs and gusts"
    if it.known:
        less = "less" if it.negative("gain") else "more"
        return _sized(what, it.size("gain"), f"{less} than the model has it")
    return f"{what}, {it.text('gain')} times what Newton's law says, and the model does not"


def slung_load(it: DescribedEffect) -> str:
    more = "lighter" if it.negative("mass") else "heavier"
    than = f", {more} than the model has it" if it.known else ""
    load = joined(it.size("mass", "kg"))
    return f"A load of {load} swings on {it.text('cable', 'm')} of cable{than}"


def balance(it: DescribedEffect) -> str:
    full = "_full" if it.found.term.effect.variant else ""

    def part(axis: str, ways: tuple[str, str]) -> str:
        name = axis + full
        amount, interval = it.size(name, "mm", factor=1e3, most=1)
        return f"{amount} {ways[it.negative(name)]} {interval}".rstrip()

    along, across = part("x", ("forward", "aft")), part("y", ("to the right", "to the left"))
    if full:
        return f"A full tank moves the centre of gravity {along} and {across}, a part of it less"
    return f"The centre of gravity is {along} and {across} of where the model has it"


def yaw_moment(it: DescribedEffect) -> str:
    to = "left" if it.negative("moment") else "right"
    return _sized(
        "The rotors hold a steady yaw moment of", it.size("moment", "N m"), f"to the {to}"
    )


def turning(it: DescribedEffect) -> str:
    inertia, damping = it.text("inertia_yaw", "kg m²"), it.text("damping_yaw", "N m s")
    if it.known:
        return (
            "Turning takes other moments than the model has: about yaw the inertia differs by "
            f"{inertia}, the damping by {damping}"
        )
    return (
        f"Turning takes moments that the model lacks, about yaw an inertia of {inertia} and a "
        f"damping of {damping}"
    )


def forward_lift(it: DescribedEffect) -> str:
    channels = it.whole.problem.channels
    speed = float(np.nanquantile(channels.airspeed, 0.9))
    hover = float(np.nanmedian(channels.hover_induced_velocity))
    row = replace(
        channels.rows(slice(0, 1)),
        airspeed=np.array([speed]),
        hover_induced_velocity=np.array([hover]),
    )
    shape = float(it.found.term.effect.apply({"gain": 1.0}, row)[0]) - 1.0
    more = "less" if it.negative("gain") else "more"
    start = f"At {number(speed, 'm/s')} airspeed the rotors make"
    return _sized(start, _percent(it, "gain", shape), f"{more} thrust than the model has")


def climb(it: DescribedEffect) -> str:
    hover_rpm = float(np.median(it.whole.problem.measured_rpm))
    ratio = CLIMB_RATE * 60.0 / (hover_rpm * it.whole.model.airframe.propeller_diameter)
    less = "more" if it.negative("slope") else "less"
    start = f"Climbing at {CLIMB_RATE:.0f} m/s the rotors make"
    return _sized(start, _percent(it, "slope", ratio), f"{less} thrust")


def ground_effect(it: DescribedEffect) -> str:
    near = float(np.median(it.whole.problem.channels.radius_over_height))
    height = it.whole.model.airframe.propeller_diameter / 2 / near
    value, *ends = (1.0 / (1.0 - k * near**2) - 1.0 for k in it.ends("strength"))
    sign, more = (-1.0, "less") if value < 0.0 else (1.0, "more")
    gained = within(value, ends[0], ends[1], "%", factor=sign * 100.0, most=1)
    return _sized(
        f"At {number(height, 'm')} above ground the rotors make", gained, f"{more} thrust"
    )


def thrust_drift(it: DescribedEffect) -> str:
    what = "gain" if it.negative("rate") else "lose"
    lost = _percent(it, "rate", 600.0)
    return _sized(f"All rotors {what}", lost, "of their thrust in 10 minutes of flight")


def voltage(it: DescribedEffect) -> str:
    power = it.text("exponent")
    return f"Thrust at a rotor speed follows the battery voltage to the power {power}"


def wind(it: DescribedEffect) -> str:
    return f"The airspeed lacks a wind: {_winds(it)}"


def followed_wind(it: DescribedEffect) -> str:
    found, domain = it.found, it.whole.model.training_domain
    known = "" if domain is None else number(domain.wind_speed[1], "m/s")
    return (
        f"A wind blows, stronger than the {known} of the training: {_winds(it)}; the reported "
        "airspeed follows it, so it is not missing: with the speed over ground instead RMSE would "
        f"be {number(found.rmse_before_rpm, '', 0)}, not {number(found.rmse_after_rpm, 'rpm', 0)}"
    )


def _winds(it: DescribedEffect) -> str:
    found, names = it.found, it.whole.problem.names
    order = np.argsort(-np.hypot(found.value[:, 0], found.value[:, 1]), kind="stable")
    said = [f"{_wind_of(found, int(f))} in {names[f]}" for f in order[:MOST_LISTED]]
    if order.size > MOST_LISTED:
        said.append(f"and {order.size - MOST_LISTED} more")
    return ", ".join(said)


def _wind_of(found: Found, flight: int) -> str:
    north, east = found.value[flight, :2]
    half = (found.upper[flight, :2] - found.lower[flight, :2]) / 2
    speed = float(np.hypot(north, east))
    # As if both components were at their ends at once: wider than their joint interval.
    reach = float((abs(north) * half[0] + abs(east) * half[1]) / max(speed, 1e-9))
    from_deg = float(np.degrees(np.arctan2(-east, -north)) % 360.0)
    blown = joined(within(speed, max(0.0, speed - reach), speed + reach, "m/s", most=1))
    return f"{blown} from {from_deg:.0f}°"
