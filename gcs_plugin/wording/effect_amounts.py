"""Write the sentence about each effect: the part, the amount and its interval.

Each effect has an `Amount` or a function of a `DescribedEffect`. Sentences end without a full stop
and contain no action.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from thrustmargin.gcs_plugin.wording.alarm_words import place_words
from thrustmargin.gcs_plugin.wording.language import (
    DEGREES,
    Verbatim,
    clock,
    joined,
    number,
    say,
    within,
)

if TYPE_CHECKING:
    from thrustmargin.models.identification.answer.result import Identification, ReportedEffect


CLIMB_RATE = 2.0  # m/s at which the climb effect is described
MOST_LISTED = 4


def rotor_words(rotor: int, names: tuple[str, ...]) -> str:
    """Return a 0-based rotor with its place: `rotor 1 (front right)`."""
    return f"{say('rotor {number}', number=rotor + 1)} ({place_words(names[rotor])})"


@dataclass(frozen=True, slots=True, eq=False)
class DescribedEffect:
    """An effect, with the identification that found it."""

    found: ReportedEffect
    whole: Identification

    def ends(self, name: str) -> tuple[float, float, float]:
        """Return (value, lower, upper) of the parameter `name`, in the flight that represents the
        effect."""
        found, row = self.found, self.found.flight
        k = [p.name for p in found.term.effect.parameters].index(name)
        return float(found.value[row, k]), float(found.lower[row, k]), float(found.upper[row, k])

    def of_sign(self, name: str, above: str, below: str) -> str:
        """Return `below` if the parameter `name` is negative, else `above`."""
        return below if self.ends(name)[0] < 0.0 else above

    def size(
        self, name: str, unit: str = "", *, factor: float = 1.0, most: int = 2
    ) -> tuple[str, str]:
        """Return the absolute amount of the parameter `name`, with unit, and its interval, as
        texts.

        Value and interval are multiplied by `factor`, and by -1 if the value is negative. `most` is
        the largest number of decimals.
        """
        sign = -1.0 if self.ends(name)[0] < 0.0 else 1.0
        return within(*self.ends(name), unit, factor=sign * factor, most=most)

    def text(self, name: str, unit: str = "", *, most: int = 2) -> str:
        """Return a parameter with its sign and its interval as one text."""
        return joined(within(*self.ends(name), unit, most=most))

    @property
    def known(self) -> bool:
        """Return True if the model has this effect already, so that the amount is a change."""
        return self.found.term.effect.name in {e.name for e in self.whole.model.effects}

    @property
    def rotor(self) -> str:
        """Return the effect's rotor with its place, capitalised; rotor 1 if it acts on none."""
        names = self.whole.model.airframe.rotor_names
        return rotor_words(self.found.term.rotor or 0, names).capitalize()


@dataclass(frozen=True, slots=True)
class Amount:
    """A sentence with one parameter's amount in place of `{amount}`.

    `above` is the sentence for a positive amount, `below` that for a negative one.
    """

    name: str
    unit: str
    above: str
    below: str
    factor: float = 1.0
    most: int = 2

    def __call__(self, it: DescribedEffect) -> str:
        size = it.size(self.name, self.unit, factor=self.factor, most=self.most)
        return _sized(it.of_sign(self.name, self.above, self.below), size)


def by_parameters(it: DescribedEffect) -> str:
    """Return `Effect: parameter amount, ...`, for an effect that has no sentence of its own."""
    term = it.found.term
    name = say(term.effect.name.replace("_", " ")).capitalize()
    if term.rotor is not None:
        names = it.whole.model.airframe.rotor_names
        name = say("{effect} of {rotor}", effect=name, rotor=rotor_words(term.rotor, names))
    values = ", ".join(
        f"{say(p.name.replace('_', ' '))} "
        + it.text(p.name, "" if p.unit == "1" else p.unit.replace("^2", "²"), most=4)
        for p in term.effect.parameters
    )
    return f"{name}: {values}"


def _sized(sentence: str, parts: tuple[str, str], **values: object) -> str:
    """Fill the amount into a sentence and append the interval: `... 8 % less (7.8 to 8.2)`."""
    amount, interval = parts
    return f"{say(sentence, amount=amount, **values)} {interval}".rstrip()


def _percent(it: DescribedEffect, name: str, factor: float = 1.0) -> tuple[str, str]:
    """Return a parameter, times `factor`, and its interval as texts in per cent, without sign."""
    return it.size(name, "%", factor=100.0 * factor, most=1)


def weak_rotor(it: DescribedEffect) -> str:
    """Return the sentence on a rotor that makes less or more thrust than expected, with the amount.

    Expected is by the model, or, without rotor speeds, by the motor outputs.
    """
    less, more = "{rotor} makes {amount} less thrust", "{rotor} makes {amount} more thrust"
    if it.whole.problem.of_outputs:
        less = "{rotor} makes {amount} less thrust than its share of the motor outputs"
        more = "{rotor} makes {amount} more thrust than its share of the motor outputs"
    if it.known:
        less = "{rotor} makes {amount} less thrust than the model has it"
        more = "{rotor} makes {amount} more thrust than the model has it"
    return _sized(it.of_sign("loss", less, more), _percent(it, "loss"), rotor=it.rotor)


LOST, GAINED = "{rotor} lost {amount} of its thrust", "{rotor} gained {amount} of its thrust"


def _lost(it: DescribedEffect, lost: str = LOST, gained: str = GAINED) -> Verbatim:
    """Return the text about a rotor that lost or gained thrust, with the amount."""
    words = it.of_sign("loss", lost, gained)
    return Verbatim(_sized(words, _percent(it, "loss"), rotor=it.rotor))


def weakened_in_flight(it: DescribedEffect) -> str:
    """Return the sentence on a step change of a rotor's thrust: how much, at what time, in which
    log.

    Other flights in which its interval excludes zero are counted.
    """
    when = clock(it.ends("onset_time")[0])
    where = Verbatim(it.whole.problem.names[it.found.flight])
    clear = (it.found.lower[:, 0] > 0.0) | (it.found.upper[:, 0] < 0.0)
    more = int(clear.sum()) - 1
    words = "{lost} in flight, {clock} into {log}"
    if more > 0:
        words = "{lost} in flight, {clock} into {log} and in {more} more of {all} flights"
        return say(words, lost=_lost(it), clock=when, log=where, more=more, all=clear.size)
    return say(words, lost=_lost(it), clock=when, log=where)


def weakened_for_a_while(it: DescribedEffect) -> str:
    """Return the sentence about a transient loss of a rotor's thrust: its log, begin and end."""
    began, ended = (clock(it.ends(name)[0]) for name in ("onset_time", "end_time"))
    where = Verbatim(it.whole.problem.names[it.found.flight])
    words = "{lost} for a while, from {begin} to {end} of {log}"
    return say(words, lost=_lost(it, gained=LOST), begin=began, end=ended, log=where)


def weakens_each_flight(it: DescribedEffect) -> str:
    """Return the sentence on a rotor's loss of thrust that begins equally late in each flight."""
    lost = _lost(it, "{rotor} loses {amount} of its thrust", "{rotor} gains {amount} of its thrust")
    return say("{lost} {clock} into every flight", lost=lost, clock=clock(it.ends("onset_time")[0]))


def weak_since_a_flight(it: DescribedEffect) -> str:
    """Return the sentence on a rotor's loss of thrust that began at one time and has lasted since.

    The time is given in the log in which it began, or, between two flights, as the next log.
    """
    problem, at = it.whole.problem, it.ends("onset_clock")[0]
    began = problem.flight_start_unix_s - problem.first_row_s
    flown = np.flatnonzero(began <= at)
    when = say("from Unix time {seconds} s", seconds=f"{at:.0f}")
    if flown.size:
        flight = int(flown[np.argmax(began[flown])])
        into_s = at - float(began[flight])
        log = Verbatim(problem.names[flight])
        when = say("{clock} into {log}", clock=clock(into_s), log=log)
        later = np.flatnonzero(began > at)
        if into_s > problem.first_row_s[flight] + problem.durations[flight] and later.size:
            log = Verbatim(problem.names[int(later[np.argmin(began[later])])])
            when = say("from {log} on", log=log)
    words = "{lost} {when}, and has stayed so in later flights"
    return say(words, lost=_lost(it), when=Verbatim(when))


def weak_until_repaired(it: DescribedEffect) -> str:
    """Return the sentence on a rotor's loss of thrust that ended before later flights: a repair.

    It names the first and the last log with the loss.
    """
    problem = it.whole.problem
    start = problem.flight_start_unix_s
    at, over = it.ends("onset_clock")[0], it.ends("end_clock")[0]
    bad = np.flatnonzero((start >= at) & (start < over))
    named = [problem.names[f] for f in bad[np.argsort(start[bad])]]
    flights = say("some flights")
    if named:
        flights = f" {say('to')} ".join(dict.fromkeys((named[0], named[-1])))
    words = "{lost} in {flights}, and is sound in the flights after, so it was repaired"
    return say(words, lost=_lost(it), flights=Verbatim(flights))


hidden_mass = Amount(
    "mass",
    "kg",
    "The aircraft is {amount} heavier than model and tank gauge say",
    "The aircraft is {amount} lighter than model and tank gauge say",
)


def air_density(it: DescribedEffect) -> str:
    """Return the sentence on an error of air density, given as the temperature error that causes
    it.

    The amount is in K. If the model had no effect of air density, that is stated, with the density
    flown in and the model's, kg/m³.
    """
    offset = it.size("temperature_offset", "K", most=1)
    if it.known:
        warmer = "The air is {amount} warmer than the model has it"
        colder = "The air is {amount} colder than the model has it"
        return _sized(it.of_sign("temperature_offset", warmer, colder), offset)
    flown = number(float(np.nanmedian(it.whole.problem.channels.density)), "kg/m³", 3)
    known = number(it.whole.model.reference_density, "kg/m³", 3)
    warmer = "the air is {amount} warmer than pressure and height say"
    colder = "the air is {amount} colder than pressure and height say"
    air = _sized(it.of_sign("temperature_offset", warmer, colder), offset)
    words = "The model does not follow air density: flown in {flown}, model of {known}, {air}"
    return say(words, flown=flown, known=known, air=air)


def wrong_gain(little: str, much: str, it: DescribedEffect) -> str:
    """Return the sentence on an instrument whose true value is `gain` times the displayed one.

    `little` is the sentence for a reading too low, `much` for one too high. The amount filled in is
    the error in % of the true value.
    """
    value, *ends = (1.0 - 1.0 / gain for gain in it.ends("gain"))
    sign, words = (-1.0, much) if value < 0.0 else (1.0, little)
    shown = within(value, ends[0], ends[1], "%", factor=100.0 * sign, most=1)
    return _sized(words, shown)


#: Of an instrument with a positive correction, and with a negative one.
GAUGE_SHOWS = ("The tank gauge shows {amount} too little", "The tank gauge shows {amount} too much")
AIRSPEED_SHOWS = (
    "The airspeed sensor shows {amount} too little",
    "The airspeed sensor shows {amount} too much",
)


def tank_zero(it: DescribedEffect) -> str:
    """Return the sentence on an error of the tank gauge's zero, in the flight where it is worst."""
    flight = Verbatim(it.whole.problem.names[it.found.flight])
    shown = Verbatim(Amount("offset", "kg", *GAUGE_SHOWS)(it))
    words = "{shown} in {log}"
    if it.found.value.shape[0] > 1:
        words = "{shown} in {log}, most of all flights"
    return say(words, shown=shown, log=flight)


tank_drift = Amount(
    "rate",
    "kg",
    "The tank gauge shows {amount} too little after 10 minutes",
    "The tank gauge shows {amount} too much after 10 minutes",
    factor=600.0,
)
airspeed_bias = Amount("bias", "m/s", *AIRSPEED_SHOWS)


def flow_moment(it: DescribedEffect) -> str:
    """Return the sentence about the moments of level flight."""
    parts = {axis: it.text(axis, most=3) for axis in ("roll", "pitch")}
    words = (
        "Flying level makes moments that the model lacks, with the gain roll {roll}, pitch {pitch}"
    )
    return say(words, **parts)


weathervane = Amount(
    "lever",
    "mm",
    "Air from the side turns the nose into it, at the speed of the wash as thrust on a lever of "
    "{amount} does",
    "Air from the side turns the nose away from it, at the speed of the wash as thrust on a lever "
    "of {amount} does",
    factor=1e3,
)


def drag_moment(it: DescribedEffect) -> str:
    """Return the sentence about the moments of drag above the centre of gravity."""
    parts = {axis: it.text(axis, "m", most=3) for axis in ("roll", "pitch")}
    words = (
        "Leaning into wind makes moments that the model lacks, as drag that acts above the centre "
        "of gravity does: roll {roll}, pitch {pitch}"
    )
    return say(words, **parts)


late_airspeed = Amount(
    "lag",
    "s",
    "The airspeed is reported {amount} late",
    "The airspeed is reported {amount} early",
)
late_rotor_speed = Amount(
    "lag",
    "s",
    "The rotor speeds are reported {amount} late",
    "The rotor speeds are reported {amount} early",
)
drag = Amount(
    "drag_area",
    "m²",
    "The aircraft has {amount} more drag area than its model",
    "The aircraft has {amount} less drag area than its model",
)


def load_factor(it: DescribedEffect) -> str:
    """Return the sentence on how strongly thrust follows the load factor of turns, climbs and
    gusts.

    The amount is relative to the model if the model contains this effect; else it is a factor to
    Newton's law.
    """
    if it.known:
        more = (
            "Thrust follows the load factor of turns, climbs and gusts {amount} more than the "
            "model has it"
        )
        less = (
            "Thrust follows the load factor of turns, climbs and gusts {amount} less than the "
            "model has it"
        )
        return _sized(it.of_sign("gain", more, less), it.size("gain"))
    words = (
        "Thrust follows the load factor of turns, climbs and gusts, {gain} times what Newton's law "
        "says, and the model does not"
    )
    return say(words, gain=it.text("gain"))


def slung_load(it: DescribedEffect) -> str:
    """Return the sentence about a swinging load: its mass and its cable."""
    words = "A load of {load} swings on {cable} of cable"
    if it.known:
        heavier = "A load of {load} swings on {cable} of cable, heavier than the model has it"
        lighter = "A load of {load} swings on {cable} of cable, lighter than the model has it"
        words = it.of_sign("mass", heavier, lighter)
    return say(words, load=joined(it.size("mass", "kg")), cable=it.text("cable", "m"))


def balance(it: DescribedEffect) -> str:
    """Return the sentence on how far the centre of gravity is from where the model has it, mm.

    For the variant of a full tank: how far a full tank moves it.
    """
    full = "_full" if it.found.term.effect.variant else ""

    def part(axis: str, above: str, below: str) -> Verbatim:
        """Return amount, direction and interval along one axis."""
        name = axis + full
        size = it.size(name, "mm", factor=1e3, most=1)
        return Verbatim(_sized(it.of_sign(name, above, below), size))

    along = part("x", "{amount} forward", "{amount} aft")
    across = part("y", "{amount} to the right", "{amount} to the left")
    words = "The centre of gravity is {along} and {across} of where the model has it"
    if full:
        words = "A full tank moves the centre of gravity {along} and {across}, a part of it less"
    return say(words, along=along, across=across)


yaw_moment = Amount(
    "moment",
    "N m",
    "The rotors hold a steady yaw moment of {amount} to the right",
    "The rotors hold a steady yaw moment of {amount} to the left",
)


def arm_weight(it: DescribedEffect) -> str:
    """Return the sentence about a weight at the end of an arm."""
    names = it.whole.model.airframe.rotor_names
    rotor = rotor_words(it.found.term.rotor or 0, names)
    words = "A weight that the model lacks, {amount}, hangs near {rotor}"
    return say(words, amount=Verbatim(joined(it.size("mass", "kg"))), rotor=rotor)


def tilted_arm(it: DescribedEffect) -> str:
    """Return the sentence on a tilted arm: by how many degrees, and to which side it yaws the
    aircraft.
    """
    spin = it.whole.model.airframe.rotor_spin[it.found.term.rotor or 0]
    words = "The arm of {rotor} is tilted by {amount}, which turns the aircraft to the right"
    if spin * it.ends("tilt")[0] < 0.0:
        words = "The arm of {rotor} is tilted by {amount}, which turns the aircraft to the left"
    names = it.whole.model.airframe.rotor_names
    amount = it.size("tilt", "°", factor=DEGREES, most=1)
    rotor = rotor_words(it.found.term.rotor or 0, names)
    return say(words, rotor=rotor, amount=Verbatim(joined(amount)))


def turning(it: DescribedEffect) -> str:
    """Return the sentence about the yaw inertia and damping that the model lacks."""
    words = (
        "Turning takes moments that the model lacks, about yaw an inertia of {inertia} and a "
        "damping of {damping}"
    )
    inertia, damping = it.text("inertia_yaw", "kg m²"), it.text("damping_yaw", "N m s")
    return say(words, inertia=inertia, damping=damping)


def inertia(it: DescribedEffect) -> str:
    """Return the sentence about a different inertia."""
    larger = "The aircraft turns as if its inertia were {amount} larger"
    smaller = "The aircraft turns as if its inertia were {amount} smaller"
    return _sized(it.of_sign("share", larger, smaller), _percent(it, "share"))


def forward_lift(it: DescribedEffect) -> str:
    """Return the sentence on the thrust that airspeed adds or takes, %.

    It is evaluated at the 90 % quantile of the flights' airspeed.
    """
    channels = it.whole.problem.channels
    speed = float(np.nanquantile(channels.airspeed, 0.9))
    hover = float(np.nanmedian(channels.hover_induced_velocity))
    row = replace(
        channels.rows(slice(0, 1)),
        airspeed=np.array([speed]),
        hover_induced_velocity=np.array([hover]),
    )
    shape = float(it.found.term.effect.apply({"gain": 1.0}, row)[0]) - 1.0
    more = "At {speed} airspeed the rotors make {amount} more thrust than the model has"
    less = "At {speed} airspeed the rotors make {amount} less thrust than the model has"
    words = it.of_sign("gain", more, less)
    return _sized(words, _percent(it, "gain", shape), speed=number(speed, "m/s"))


def climb(it: DescribedEffect) -> str:
    """Return the sentence about thrust in a climb at CLIMB_RATE."""
    hover_rpm = float(np.median(it.whole.problem.measured_rpm))
    ratio = CLIMB_RATE * 60.0 / (hover_rpm * it.whole.model.airframe.propeller_diameter)
    less = "Climbing at {speed} the rotors make {amount} less thrust"
    more = "Climbing at {speed} the rotors make {amount} more thrust"
    words = it.of_sign("slope", less, more)
    return _sized(words, _percent(it, "slope", ratio), speed=number(CLIMB_RATE, "m/s", 0))


def ground_effect(it: DescribedEffect) -> str:
    """Return the sentence on the thrust that the ground adds or takes, %.

    It is evaluated at the flights' median height.
    """
    near = float(np.median(it.whole.problem.channels.radius_over_height))
    height = it.whole.model.airframe.propeller_diameter / 2 / near
    value, *ends = (1.0 / (1.0 - k * near**2) - 1.0 for k in it.ends("strength"))
    sign, words = 1.0, "At {height} above ground the rotors make {amount} more thrust"
    if value < 0.0:
        sign, words = -1.0, "At {height} above ground the rotors make {amount} less thrust"
    gained = within(value, ends[0], ends[1], "%", factor=sign * 100.0, most=1)
    return _sized(words, gained, height=number(height, "m"))


thrust_drift = Amount(
    "rate",
    "%",
    "All rotors lose {amount} of their thrust in 10 minutes of flight",
    "All rotors gain {amount} of their thrust in 10 minutes of flight",
    factor=6e4,
    most=1,
)


def voltage(it: DescribedEffect) -> str:
    """Return the sentence about the exponent of battery voltage."""
    words = "Thrust at a rotor speed follows the battery voltage to the power {power}"
    return say(words, power=it.text("exponent"))


def wind(it: DescribedEffect) -> str:
    """Return the sentence about a wind that is missing in the airspeed."""
    return say("The airspeed lacks a wind: {winds}", winds=_winds(it))


def followed_wind(it: DescribedEffect) -> str:
    """Return the sentence on a wind stronger than in training that the reported airspeed already
    includes.

    It lists the winds, and gives the RMSE, rpm, with ground speed and with airspeed.
    """
    found, domain = it.found, it.whole.model.training_domain
    words = (
        "A wind blows, stronger than the {known} of the training: {winds}; the reported airspeed "
        "follows it, so it is not missing: with the speed over ground instead RMSE would be "
        "{before}, not {after}"
    )
    return say(
        words,
        known="" if domain is None else number(domain.wind_speed[1], "m/s"),
        winds=_winds(it),
        before=number(found.rmse_before_rpm, "", 0),
        after=number(found.rmse_after_rpm, "rpm", 0),
    )


def _winds(it: DescribedEffect) -> Verbatim:
    """List the winds of the flights in words, strongest first.

    At most MOST_LISTED are listed, then the number of the others.
    """
    found, names = it.found, it.whole.problem.names
    order = np.argsort(-np.hypot(found.value[:, 0], found.value[:, 1]), kind="stable")
    winds = [
        say("{wind} in {log}", wind=_wind_of(found, int(f)), log=Verbatim(names[f]))
        for f in order[:MOST_LISTED]
    ]
    if order.size > MOST_LISTED:
        winds.append(say("and {count} more", count=order.size - MOST_LISTED))
    return Verbatim(", ".join(winds))


def _wind_of(found: ReportedEffect, flight: int) -> str:
    """Return the wind in the flight of index `flight` as `8.1 m/s (7.2 to 9.0) from 240°`."""
    north, east = found.value[flight, :2]
    half = (found.upper[flight, :2] - found.lower[flight, :2]) / 2
    speed = float(np.hypot(north, east))
    # As if both components were at their ends at once: wider than their joint interval.
    reach = float((abs(north) * half[0] + abs(east) * half[1]) / max(speed, 1e-9))
    from_deg = float(np.degrees(np.arctan2(-east, -north)) % 360.0)
    blown = joined(within(speed, max(0.0, speed - reach), speed + reach, "m/s", most=1))
    return say("{speed} from {degrees}°", speed=blown, degrees=f"{from_deg:.0f}")
