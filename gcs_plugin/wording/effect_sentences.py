"""One sentence for each effect of the table: what is different on this aircraft, by how much.

An effect without a sentence of its own is described by its parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from thrustmargin.gcs_plugin.wording.described_effect import DescribedEffect, spread
from thrustmargin.gcs_plugin.wording.numbers import clock, number
from thrustmargin.models.identification.already_followed import FOLLOWED_WIND
from thrustmargin.models.identification.result import Found, Identification

#: m/s at which the climb effect is described
CLIMB_RATE = 2.0
MOST_LISTED = 4


def effect_sentence(found: Found, whole: Identification) -> str:
    """What one effect says about the aircraft, without a full stop."""
    key, name = found.term.effect.key, found.term.effect.name
    sentence = SENTENCES.get(key) or SENTENCES.get(name) or _by_parameters
    return sentence(DescribedEffect(found, whole))


def _by_parameters(it: DescribedEffect) -> str:
    term = it.found.term
    where = "" if term.rotor is None else f" of {it.rotor.lower()}"
    values = ", ".join(
        f"{p.name.replace('_', ' ')} "
        + it.text(p.name, "" if p.unit == "1" else p.unit.replace("^2", "²"), most=4)
        for p in term.effect.parameters
    )
    return f"{term.effect.name.replace('_', ' ').capitalize()}{where}: {values}"


def _worn(it: DescribedEffect) -> str:
    more = "more" if it.negative("loss") else "less"
    amount = _percent(it, "loss")
    if it.whole.problem.of_outputs:
        return (
            f"{it.rotor} makes {amount} {more} thrust than its share of the motor outputs: its "
            "propeller, motor or ESC, which outputs cannot distinguish"
        )
    return f"{it.rotor} makes {amount} {more} thrust than its model"


def _onset(it: DescribedEffect) -> str:
    what = "gained" if it.negative("loss") else "lost"
    when = clock(it.ends("onset_time")[0])
    where = it.whole.problem.names[it.found.flight]
    clear = (it.found.lower[:, 0] > 0.0) | (it.found.upper[:, 0] < 0.0)
    more = int(clear.sum()) - 1
    also = f" and in {more} more of {clear.size} flights" if more > 0 else ""
    loss = _percent(it, "loss")
    return f"{it.rotor} {what} {loss} of its thrust in flight, {when} into {where}{also}"


def _each_flight(it: DescribedEffect) -> str:
    what = "gains" if it.negative("loss") else "loses"
    when = clock(it.ends("onset_time")[0])
    return f"{it.rotor} {what} {_percent(it, 'loss')} of its thrust {when} into every flight"


def _since(it: DescribedEffect) -> str:
    what = "gained" if it.negative("loss") else "lost"
    problem, at = it.whole.problem, it.ends("onset_clock")[0]
    began = problem.flight_start_unix_s - problem.first_row_s
    flown = np.flatnonzero(began <= at)
    when = f"from Unix time {at:.0f} s"
    if flown.size:
        flight = int(flown[np.argmax(began[flown])])
        when = f"{clock(at - float(began[flight]))} into {problem.names[flight]}"
    loss = _percent(it, "loss")
    return f"{it.rotor} {what} {loss} of its thrust {when}, and has stayed so in later flights"


def _percent(it: DescribedEffect, name: str) -> str:
    return it.size(name, "%", factor=100.0, most=1)


def _mass(it: DescribedEffect) -> str:
    than = "lighter" if it.negative("mass") else "heavier"
    return f"The aircraft is {it.size('mass', 'kg')} {than} than model and tank gauge say"


def _density(it: DescribedEffect) -> str:
    than = "colder" if it.negative("temperature_offset") else "warmer"
    offset = f"the air is {it.size('temperature_offset', 'K', most=1)} {than} than"
    if it.known:
        return f"{offset} the model has it".replace("the air", "The air", 1)
    flown = number(float(np.nanmedian(it.whole.problem.channels.density)), "kg/m³", 3)
    known = number(it.whole.model.reference_density, "kg/m³", 3)
    return (
        f"Thrust follows the air density, which the model did not: flown in about {flown}, model "
        f"of {known}; {offset} the density of pressure or height takes it to be"
    )


def _tank(it: DescribedEffect) -> str:
    value, low, high = (end - 1.0 for end in it.ends("gain"))
    sign, than = (-1.0, "less") if value < 0.0 else (1.0, "more")
    amount = spread(value, low, high, "%", factor=sign * 100.0, most=1)
    return f"The tank holds {amount} {than} than its gauge shows"


def _lag(it: DescribedEffect) -> str:
    than = "early" if it.negative("lag") else "late"
    return f"The airspeed is reported {it.size('lag', 's')} {than}"


def _rotor_speed_lag(it: DescribedEffect) -> str:
    than = "early" if it.negative("lag") else "late"
    return f"The rotor speeds are reported {it.size('lag', 's')} {than}"


def _drag(it: DescribedEffect) -> str:
    than = "less" if it.negative("drag_area") else "more"
    return f"The aircraft has {it.size('drag_area', 'm²')} {than} drag area than its model"


def _load(it: DescribedEffect) -> str:
    what = "Thrust follows the load factor of turns, climbs and gusts"
    if it.known:
        less = "less" if it.negative("gain") else "more"
        return f"{what} {it.size('gain', '')} {less} than the model has it"
    return f"{what}, which the model did not: {it.text('gain')} times what Newton's law says"


def _slung(it: DescribedEffect) -> str:
    more = "lighter" if it.negative("mass") else "heavier"
    than = f", {more} than the model has it" if it.known else ""
    return f"A load of {it.size('mass', 'kg')} swings on {it.text('cable', 'm')} of cable{than}"


def _balance(it: DescribedEffect) -> str:
    full = "_full" if it.found.term.effect.variant else ""

    def part(axis: str, ways: tuple[str, str]) -> str:
        name = axis + full
        return f"{it.size(name, 'mm', factor=1e3, most=1)} {ways[it.negative(name)]}"

    along, across = part("x", ("forward", "aft")), part("y", ("to the right", "to the left"))
    if full:
        return f"A full tank moves the centre of gravity {along} and {across}, a part of it less"
    return f"The centre of gravity is {along} and {across} of where the model has it"


def _yaw(it: DescribedEffect) -> str:
    to = "left" if it.negative("moment") else "right"
    return (
        f"The rotors hold a steady yaw moment of {it.size('moment', 'N m')} to the {to}: motors "
        "are not level, or the clockwise and counter-clockwise pairs differ; level the motors, "
        "then swap two propellers between the pairs"
    )


def _turning(it: DescribedEffect) -> str:
    inertia, damping = it.text("inertia_yaw", "kg m²"), it.text("damping_yaw", "N m s")
    if it.known:
        return (
            "Turning takes other moments than the model has: about yaw the inertia differs by "
            f"{inertia}, the damping by {damping}"
        )
    return (
        f"Turning takes moments that the model lacks: about yaw an inertia of {inertia} and a "
        f"damping of {damping}"
    )


def _lift(it: DescribedEffect) -> str:
    channels = it.whole.problem.channels
    speed = float(np.nanquantile(channels.airspeed, 0.9))
    hover = float(np.nanmedian(channels.hover_induced_velocity))
    row = replace(
        channels.rows(slice(0, 1)),
        airspeed=np.array([speed]),
        hover_induced_velocity=np.array([hover]),
    )
    shape = float(it.found.term.effect.apply({"gain": 1.0}, row, np)[0]) - 1.0
    more = "less" if it.negative("gain") else "more"
    amount = it.size("gain", "%", factor=100.0 * shape, most=1)
    return (
        f"At {number(speed, 'm/s')} airspeed the rotors make {amount} {more} thrust at a speed than"
        " the model has"
    )


def _climb(it: DescribedEffect) -> str:
    hover_rpm = float(np.median(it.whole.problem.measured_rpm))
    ratio = CLIMB_RATE * 60.0 / (hover_rpm * it.whole.model.airframe.propeller_diameter)
    less = "more" if it.negative("slope") else "less"
    amount = it.size("slope", "%", factor=100.0 * ratio, most=1)
    return f"Climbing at {CLIMB_RATE:.0f} m/s the rotors make {amount} {less} thrust at a speed"


def _ground(it: DescribedEffect) -> str:
    near = float(np.median(it.whole.problem.channels.radius_over_height))
    height = it.whole.model.airframe.propeller_diameter / 2 / near
    value, low, high = (1.0 / (1.0 - k * near**2) - 1.0 for k in it.ends("strength"))
    sign, more = (-1.0, "less") if value < 0.0 else (1.0, "more")
    amount = spread(value, low, high, "%", factor=sign * 100.0, most=1)
    return (
        f"At {number(height, 'm')} above ground the rotors make {amount} {more} thrust at a speed"
    )


def _drift(it: DescribedEffect) -> str:
    what = "gain" if it.negative("rate") else "lose"
    amount = it.size("rate", "%", factor=600.0 * 100.0, most=1)
    return f"All rotors {what} {amount} of their thrust in 10 minutes of flight"


def _voltage(it: DescribedEffect) -> str:
    return (
        f"Thrust at a rotor speed follows the battery voltage to the power {it.text('exponent')}: "
        "not physics of a measured speed, so the speeds look estimated or simulated"
    )


def _wind(it: DescribedEffect) -> str:
    return f"The airspeed lacks a wind: {_winds(it)}"


def _followed_wind(it: DescribedEffect) -> str:
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
    wind = spread(speed, max(0.0, speed - reach), speed + reach, "m/s", most=1)
    return f"{wind} from {from_deg:.0f}°"


#: key of the effect, or its name where all variants are described alike -> its sentence
SENTENCES: Mapping[str, Callable[[DescribedEffect], str]] = MappingProxyType(
    {
        "rotor_degradation": _worn,
        "rotor_degradation:onset": _onset,
        "rotor_degradation:in each flight": _each_flight,
        "rotor_degradation:since": _since,
        "extra_mass": _mass,
        "air_density": _density,
        "tank_scale": _tank,
        "sensor_lag": _lag,
        "sensor_lag:rotor speed": _rotor_speed_lag,
        "parasite_drag": _drag,
        "load_factor": _load,
        "slung_load": _slung,
        "cg_offset": _balance,
        "yaw_trim": _yaw,
        "manoeuvre_moment": _turning,
        "translational_lift": _lift,
        "climb_inflow": _climb,
        "ground_effect": _ground,
        "thrust_drift": _drift,
        "battery_voltage": _voltage,
        "wind": _wind,
        FOLLOWED_WIND.key: _followed_wind,
    }
)
