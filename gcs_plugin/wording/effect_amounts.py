"""Write the sentence about each effect: the part, the amount and its interval.

Each effect has an `Amount` or a function of a `DescribedEffect`. Sentences end without a full stop
and contain no action.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from thrustmargin.gcs_plugin.wording.language import clock, joined, number, within

if TYPE_CHECKING:
    from thrustmargin.models.identification.answer.result import Found, Identification


CLIMB_RATE = 2.0  # m/s at which the climb effect is described
MOST_LISTED = 4


def rotor_words(rotor: int, names: tuple[str, ...]) -> str:
    """Return a 0-based rotor with its place: `rotor 1 (front right)`."""
    return f"rotor {rotor + 1} ({names[rotor]})"


@dataclass(frozen=True, slots=True, eq=False)
class DescribedEffect:
    """One effect, with the identification that found it."""

    found: Found
    whole: Identification

    def ends(self, name: str) -> tuple[float, float, float]:
        """Return value, lower and upper end of a parameter in the flight that represents the
        effect."""
        found, row = self.found, self.found.flight
        k = [p.name for p in found.term.effect.parameters].index(name)
        return float(found.value[row, k]), float(found.lower[row, k]), float(found.upper[row, k])

    def of_sign(self, name: str, above: str, below: str) -> str:
        """Return `below` if the parameter is negative, else `above`."""
        return below if self.ends(name)[0] < 0.0 else above

    def size(
        self, name: str, unit: str = "", *, factor: float = 1.0, most: int = 2
    ) -> tuple[str, str]:
        """Return the absolute amount of a parameter, and its interval with the same change of
        sign."""
        sign = -1.0 if self.ends(name)[0] < 0.0 else 1.0
        return within(*self.ends(name), unit, factor=sign * factor, most=most)

    def text(self, name: str, unit: str = "", *, most: int = 2) -> str:
        """Return a parameter with its sign and its interval as one text."""
        return joined(within(*self.ends(name), unit, most=most))

    @property
    def known(self) -> bool:
        """Return whether the model has this effect already, so that the amount is a change."""
        return self.found.term.effect.name in {e.name for e in self.whole.model.effects}

    @property
    def rotor(self) -> str:
        """Return the effect's rotor with its place, capitalised; rotor 1 if it acts on none."""
        names = self.whole.model.airframe.rotor_names
        return rotor_words(self.found.term.rotor or 0, names).capitalize()


@dataclass(frozen=True, slots=True)
class Amount:
    """A sentence with one parameter's amount in place of `{}`.

    `{sign}` is replaced by the first of `signs` for a positive amount, else by the second.
    """

    name: str
    unit: str
    sentence: str
    signs: tuple[str, str] = ("", "")
    factor: float = 1.0
    most: int = 2

    def __call__(self, it: DescribedEffect) -> str:
        start, end = self.sentence.split(" {} ")
        sign = it.of_sign(self.name, *self.signs)
        size = it.size(self.name, self.unit, factor=self.factor, most=self.most)
        return _sized(start.format(sign=sign), size, end.format(sign=sign))


def by_parameters(it: DescribedEffect) -> str:
    """List all parameters of an effect that has no sentence of its own."""
    term = it.found.term
    where = "" if term.rotor is None else f" of {it.rotor.lower()}"
    values = ", ".join(
        f"{p.name.replace('_', ' ')} "
        + it.text(p.name, "" if p.unit == "1" else p.unit.replace("^2", "²"), most=4)
        for p in term.effect.parameters
    )
    return f"{term.effect.name.replace('_', ' ').capitalize()}{where}: {values}"


def _sized(start: str, parts: tuple[str, str], end: str) -> str:
    """Join start, amount, end and interval: `Rotor 1 makes 8 % less thrust (7.8 to 8.2)`."""
    amount, interval = parts
    return f"{start} {amount} {end} {interval}".rstrip()


def _percent(it: DescribedEffect, name: str, factor: float = 1.0) -> tuple[str, str]:
    """Return a parameter and its interval in per cent, without sign."""
    return it.size(name, "%", factor=100.0 * factor, most=1)


def weak_rotor(it: DescribedEffect) -> str:
    """Return the sentence about a rotor with less or more thrust than the model expects."""
    than = " than its share of the motor outputs" if it.whole.problem.of_outputs else ""
    if it.known:
        than = " than the model has it"
    less = it.of_sign("loss", "less", "more")
    return _sized(f"{it.rotor} makes", _percent(it, "loss"), f"{less} thrust{than}")


def _lost(it: DescribedEffect, lost: str = "lost", gained: str = "gained") -> str:
    """Return the words about a rotor that lost or gained thrust, with the amount."""
    what = it.of_sign("loss", lost, gained)
    return _sized(f"{it.rotor} {what}", _percent(it, "loss"), "of its thrust")


def weakened_in_flight(it: DescribedEffect) -> str:
    """Return the sentence about a step change of a rotor's thrust: when, in which log, in how many
    flights."""
    when = clock(it.ends("onset_time")[0])
    where = it.whole.problem.names[it.found.flight]
    clear = (it.found.lower[:, 0] > 0.0) | (it.found.upper[:, 0] < 0.0)
    more = int(clear.sum()) - 1
    also = f" and in {more} more of {clear.size} flights" if more > 0 else ""
    return f"{_lost(it)} in flight, {when} into {where}{also}"


def weakened_for_a_while(it: DescribedEffect) -> str:
    """Return the sentence about a transient loss of a rotor's thrust: its log, begin and end."""
    began, ended = (clock(it.ends(name)[0]) for name in ("onset_time", "end_time"))
    where = it.whole.problem.names[it.found.flight]
    return f"{_lost(it, gained='lost')} for a while, from {began} to {ended} of {where}"


def weakens_each_flight(it: DescribedEffect) -> str:
    """Return the sentence about a loss that begins equally late in every flight."""
    return f"{_lost(it, 'loses', 'gains')} {clock(it.ends('onset_time')[0])} into every flight"


def weak_since_a_flight(it: DescribedEffect) -> str:
    """Return the sentence about a loss that began at one moment of a series of flights and
    stays."""
    problem, at = it.whole.problem, it.ends("onset_clock")[0]
    began = problem.flight_start_unix_s - problem.first_row_s
    flown = np.flatnonzero(began <= at)
    when = f"from Unix time {at:.0f} s"
    if flown.size:
        flight = int(flown[np.argmax(began[flown])])
        into_s = at - float(began[flight])
        when = f"{clock(into_s)} into {problem.names[flight]}"
        later = np.flatnonzero(began > at)
        if into_s > problem.first_row_s[flight] + problem.durations[flight] and later.size:
            when = f"from {problem.names[int(later[np.argmin(began[later])])]} on"
    return f"{_lost(it)} {when}, and has stayed so in later flights"


def weak_until_repaired(it: DescribedEffect) -> str:
    """Return the sentence about a loss in several flights that later flights no longer show."""
    problem = it.whole.problem
    start = problem.flight_start_unix_s
    at, over = it.ends("onset_clock")[0], it.ends("end_clock")[0]
    bad = np.flatnonzero((start >= at) & (start < over))
    named = [problem.names[f] for f in bad[np.argsort(start[bad])]]
    flights = " to ".join(dict.fromkeys((named[0], named[-1]))) if named else "some flights"
    return f"{_lost(it)} in {flights}, and is sound in the flights after, so it was repaired"


hidden_mass = Amount(
    "mass", "kg", "The aircraft is {} {sign} than model and tank gauge say", ("heavier", "lighter")
)


def air_density(it: DescribedEffect) -> str:
    """Return the sentence about air density as a difference of temperature."""
    than = it.of_sign("temperature_offset", "warmer", "colder")
    offset = it.size("temperature_offset", "K", most=1)
    if it.known:
        return _sized("The air is", offset, f"{than} than the model has it")
    flown = number(float(np.nanmedian(it.whole.problem.channels.density)), "kg/m³", 3)
    known = number(it.whole.model.reference_density, "kg/m³", 3)
    air = _sized("the air is", offset, f"{than} than pressure and height say")
    return f"The model does not follow air density: flown in {flown}, model of {known}, {air}"


def wrong_gain(what: str, it: DescribedEffect) -> str:
    """Return the sentence about an instrument whose true value is `gain` times the shown one."""
    value, *ends = (1.0 - 1.0 / gain for gain in it.ends("gain"))
    sign, much = (-1.0, "much") if value < 0.0 else (1.0, "little")
    shown = within(value, ends[0], ends[1], "%", factor=100.0 * sign, most=1)
    return _sized(f"The {what} shows", shown, f"too {much}")


#: An instrument with a positive correction shows too little.
TOO = ("too little", "too much")


def tank_zero(it: DescribedEffect) -> str:
    """Return the sentence about the tank gauge's zero, in the flight where it is most off."""
    flight = it.whole.problem.names[it.found.flight]
    shown = Amount("offset", "kg", "The tank gauge shows {} {sign}", TOO)(it)
    flights = it.found.value.shape[0]
    return f"{shown} in {flight}" + (", most of all flights" if flights > 1 else "")


tank_drift = Amount(
    "rate", "kg", "The tank gauge shows {} {sign} after 10 minutes", TOO, factor=600.0
)
airspeed_bias = Amount("bias", "m/s", "The airspeed sensor shows {} {sign}", TOO)


def flow_moment(it: DescribedEffect) -> str:
    """Return the sentence about the moments of level flight."""
    parts = [f"{axis} {it.text(axis, most=3)}" for axis in ("roll", "pitch")]
    return f"Flying level makes moments that the model lacks, with the gain {', '.join(parts)}"


weathervane = Amount(
    "lever",
    "mm",
    "Air from the side turns the nose {sign} it, at the speed of the wash as thrust on a lever of "
    "{} does",
    ("into", "away from"),
    factor=1e3,
)


def drag_moment(it: DescribedEffect) -> str:
    """Return the sentence about the moments of drag above the centre of gravity."""
    parts = [f"{axis} {it.text(axis, 'm', most=3)}" for axis in ("roll", "pitch")]
    return (
        "Leaning into wind makes moments that the model lacks, as drag that acts above the centre "
        f"of gravity does: {', '.join(parts)}"
    )


late_airspeed = Amount("lag", "s", "The airspeed is reported {} {sign}", ("late", "early"))
late_rotor_speed = Amount("lag", "s", "The rotor speeds are reported {} {sign}", ("late", "early"))
drag = Amount(
    "drag_area", "m²", "The aircraft has {} {sign} drag area than its model", ("more", "less")
)


def load_factor(it: DescribedEffect) -> str:
    """Return the sentence about thrust in manoeuvres; `gain` is relative to Newton's law or to the
    model."""
    what = "Thrust follows the load factor of turns, climbs and gusts"
    if it.known:
        more = it.of_sign("gain", "more", "less")
        return _sized(what, it.size("gain"), f"{more} than the model has it")
    return f"{what}, {it.text('gain')} times what Newton's law says, and the model does not"


def slung_load(it: DescribedEffect) -> str:
    """Return the sentence about a swinging load: its mass and its cable."""
    more = it.of_sign("mass", "heavier", "lighter")
    than = f", {more} than the model has it" if it.known else ""
    load = joined(it.size("mass", "kg"))
    return f"A load of {load} swings on {it.text('cable', 'm')} of cable{than}"


def balance(it: DescribedEffect) -> str:
    """Return the sentence about the centre of gravity, as it is or as a full tank moves it."""
    full = "_full" if it.found.term.effect.variant else ""

    def part(axis: str, ways: tuple[str, str]) -> str:
        """Return amount, direction and interval along one axis."""
        name = axis + full
        amount, interval = it.size(name, "mm", factor=1e3, most=1)
        return f"{amount} {it.of_sign(name, *ways)} {interval}".rstrip()

    along, across = part("x", ("forward", "aft")), part("y", ("to the right", "to the left"))
    if full:
        return f"A full tank moves the centre of gravity {along} and {across}, a part of it less"
    return f"The centre of gravity is {along} and {across} of where the model has it"


yaw_moment = Amount(
    "moment", "N m", "The rotors hold a steady yaw moment of {} to the {sign}", ("right", "left")
)


def turning(it: DescribedEffect) -> str:
    """Return the sentence about the yaw inertia and damping that the model lacks."""
    inertia, damping = it.text("inertia_yaw", "kg m²"), it.text("damping_yaw", "N m s")
    return (
        f"Turning takes moments that the model lacks, about yaw an inertia of {inertia} and a "
        f"damping of {damping}"
    )


def inertia(it: DescribedEffect) -> str:
    """Return the sentence about a different inertia."""
    more = it.of_sign("share", "larger", "smaller")
    return _sized("The aircraft turns as if its inertia were", _percent(it, "share"), more)


def forward_lift(it: DescribedEffect) -> str:
    """Return the sentence about lift, as thrust at the 90 % quantile of airspeed."""
    channels = it.whole.problem.channels
    speed = float(np.nanquantile(channels.airspeed, 0.9))
    hover = float(np.nanmedian(channels.hover_induced_velocity))
    row = replace(
        channels.rows(slice(0, 1)),
        airspeed=np.array([speed]),
        hover_induced_velocity=np.array([hover]),
    )
    shape = float(it.found.term.effect.apply({"gain": 1.0}, row)[0]) - 1.0
    more = it.of_sign("gain", "more", "less")
    start = f"At {number(speed, 'm/s')} airspeed the rotors make"
    return _sized(start, _percent(it, "gain", shape), f"{more} thrust than the model has")


def climb(it: DescribedEffect) -> str:
    """Return the sentence about thrust in a climb at CLIMB_RATE."""
    hover_rpm = float(np.median(it.whole.problem.measured_rpm))
    ratio = CLIMB_RATE * 60.0 / (hover_rpm * it.whole.model.airframe.propeller_diameter)
    less = it.of_sign("slope", "less", "more")
    start = f"Climbing at {CLIMB_RATE:.0f} m/s the rotors make"
    return _sized(start, _percent(it, "slope", ratio), f"{less} thrust")


def ground_effect(it: DescribedEffect) -> str:
    """Return the sentence about thrust near the ground, at the flights' median height."""
    near = float(np.median(it.whole.problem.channels.radius_over_height))
    height = it.whole.model.airframe.propeller_diameter / 2 / near
    value, *ends = (1.0 / (1.0 - k * near**2) - 1.0 for k in it.ends("strength"))
    sign, more = (-1.0, "less") if value < 0.0 else (1.0, "more")
    gained = within(value, ends[0], ends[1], "%", factor=sign * 100.0, most=1)
    return _sized(
        f"At {number(height, 'm')} above ground the rotors make", gained, f"{more} thrust"
    )


thrust_drift = Amount(
    "rate",
    "%",
    "All rotors {sign} {} of their thrust in 10 minutes of flight",
    ("lose", "gain"),
    factor=6e4,
    most=1,
)


def voltage(it: DescribedEffect) -> str:
    """Return the sentence about the exponent of battery voltage."""
    power = it.text("exponent")
    return f"Thrust at a rotor speed follows the battery voltage to the power {power}"


def wind(it: DescribedEffect) -> str:
    """Return the sentence about a wind that is missing in the airspeed."""
    return f"The airspeed lacks a wind: {_winds(it)}"


def followed_wind(it: DescribedEffect) -> str:
    """Return the sentence about a strong wind that the reported airspeed already includes."""
    found, domain = it.found, it.whole.model.training_domain
    known = "" if domain is None else number(domain.wind_speed[1], "m/s")
    return (
        f"A wind blows, stronger than the {known} of the training: {_winds(it)}; the reported "
        "airspeed follows it, so it is not missing: with the speed over ground instead RMSE would "
        f"be {number(found.rmse_before_rpm, '', 0)}, not {number(found.rmse_after_rpm, 'rpm', 0)}"
    )


def _winds(it: DescribedEffect) -> str:
    """List the winds of up to MOST_LISTED flights, strongest first."""
    found, names = it.found, it.whole.problem.names
    order = np.argsort(-np.hypot(found.value[:, 0], found.value[:, 1]), kind="stable")
    winds = [f"{_wind_of(found, int(f))} in {names[f]}" for f in order[:MOST_LISTED]]
    if order.size > MOST_LISTED:
        winds.append(f"and {order.size - MOST_LISTED} more")
    return ", ".join(winds)


def _wind_of(found: Found, flight: int) -> str:
    """Return speed with interval, and direction, of the wind in one flight."""
    north, east = found.value[flight, :2]
    half = (found.upper[flight, :2] - found.lower[flight, :2]) / 2
    speed = float(np.hypot(north, east))
    # As if both components were at their ends at once: wider than their joint interval.
    reach = float((abs(north) * half[0] + abs(east) * half[1]) / max(speed, 1e-9))
    from_deg = float(np.degrees(np.arctan2(-east, -north)) % 360.0)
    blown = joined(within(speed, max(0.0, speed - reach), speed + reach, "m/s", most=1))
    return f"{blown} from {from_deg:.0f}°"
