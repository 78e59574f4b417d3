"""Describe in words whether an aircraft flew, how control was lost, rejected sensors, and the
sorties of a log."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from math import degrees, isfinite

from thrustmargin.gcs_plugin.wording import actions
from thrustmargin.gcs_plugin.wording.language import Verbatim, clock, duration, number, percent, say
from thrustmargin.models.checks.loss_of_control import LossKind, LossOfControl
from thrustmargin.models.flight import FlightTrack, FlyingBy
from thrustmargin.models.model.utilisation_peaks import Activity
from thrustmargin.models.provenance import Reason

#: Why no row of a log is in flight.
GROUNDED_BY: Mapping[FlyingBy, str] = {
    FlyingBy.DISARMED: "the vehicle says that it was disarmed throughout",
    FlyingBy.IDLE_OUTPUTS: "its motor outputs never rose above idle while it was armed",
    FlyingBy.CONSTANT_OUTPUTS: "its motor outputs never changed",
    FlyingBy.SLOW_ROTORS: "its rotors never carried half of the empty weight",
    FlyingBy.NEVER_ROSE: "its motors ran up and it never rose from where it stood",
    FlyingBy.HELD: "it was held, on a bench or in hands: it did not move as thrust and tilt asked",
    FlyingBy.NOT_KNOWN: "neither landed state, rotor speeds, motor outputs nor height is in it",
    FlyingBy.LANDED_STATE: "by its own landed state",
    FlyingBy.HEIGHT: "it was never more than 1 m above home",
    FlyingBy.ROTOR_SPEEDS: "by its rotor speeds",
    FlyingBy.MOTOR_OUTPUTS: "by its motor outputs",
    FlyingBy.GIVEN: "as the table says",
}
TOO_SELDOM = "readings come every {seconds} s: too seldom to find a weak rotor or motor"
#: Reason why a sensor is rejected -> its words, and the action.
LEFT_OUT: Mapping[Reason, str] = {
    Reason.FROZEN: "its reading stood still in flight: no measurement, and left out",
    Reason.BROKEN: "its reading fell at once, and the motors felt nothing of it: no measurement, "
    "and left out; look at sensor, wiring and battery",
    Reason.UNLOADED: "it does not fall under load, as that of every battery does: no measurement, "
    "and left out; look at sensor and wiring",
    Reason.UNFOLLOWED: "it does not change as the thrust does: no measurement, and left out; weigh "
    "the liquid and set the gauge right",
    Reason.IMPOSSIBLE: "pressure or temperature are not those of the air: no measurement, and left "
    "out; look at the barometer",
    Reason.COPIED: "two rotors have the same speed in every sample: one of them is not measured, "
    "both are left out; look at the ESC telemetry",
}


def not_flown(track: FlightTrack) -> str:
    """Return why a log has no row in flight; empty if it has one."""
    if track.flying.any():
        return ""
    why = say(GROUNDED_BY[track.flying_by])
    if track.flying_by is FlyingBy.NOT_KNOWN:
        return say("whether it flew is not known: {why}", why=why)
    return say("by this log it never left the ground: {why}", why=why)


def too_short(seconds: float) -> str:
    """Return the words about a flight too short for a verdict."""
    long = number(seconds, "s")
    return say("only {long} of it in flight: too little for a verdict", long=long)


def loss_words(losses: Sequence[LossOfControl]) -> str:
    """List the signs of a loss of control with their times, in order."""
    return ", ".join(
        say("{sign} at {clock}", sign=_sign(one), clock=clock(one.time_s)) for one in losses
    )


def recovered_words(signs: Sequence[LossOfControl]) -> str:
    """Return the words about a jolt or tilt that did not end the flight, and the action."""
    return f"{loss_words(signs)}, and it went on or landed: {actions.AFTER_A_JOLT.text}"


def lost_rows(losses: Sequence[LossOfControl]) -> str:
    """Return the words about rows after a loss of control, which are not used for training."""
    when = clock(losses[0].time_s)
    return f"control was lost ({loss_words(losses)}): what follows {when} is left out"


def _sign(one: LossOfControl) -> str:
    """Return one sign of a loss of control with its largest size: `tilted up to 95°`.

    `one.value` is a share of full output, rad, rad/s, m/s or m/s² by its kind; angles are worded in
    degrees.
    """
    value = one.value
    words, amount = {
        LossKind.SATURATED: ("a motor at {amount} output", percent(value)),
        LossKind.NOT_AS_ASKED: (
            "up to {amount} off the attitude asked for",
            number(degrees(value), "°", 0),
        ),
        LossKind.TURNED_OVER: ("tilted up to {amount}", number(degrees(value), "°", 0)),
        LossKind.SPUN: ("turning at up to {amount}", number(degrees(value), "°/s", 0)),
        LossKind.FELL: ("falling at up to {amount}", number(value, "m/s", 0)),
        LossKind.HIT: ("hit something, {amount} felt", number(value, "m/s²", 0)),
    }[one.kind]
    return say(words, amount=amount)


def event_words(kind: str, subject: str, text: str, time_s: float, count: int) -> str:
    """Return an event that the vehicle reported, as `crash (crash check: ERR 12 1) at 1:23, 2
    times`.

    `kind` (crash) is what happened; `subject` (crash check) the part, or a motor's number, left out
    if equal to `kind`; `text` (ERR 12 1) the message. `time_s` is the first time, s; negative,
    before the log's first row, is worded `at the start`. `count` is stated if above 1.
    """
    about = say("motor or part {part}", part=subject) if subject.isdigit() else say(subject)
    details = ": ".join(filter(None, (about if subject != kind else "", text)))
    often = say(", {count} times", count=count) if count > 1 else ""
    what = Verbatim(f"{say(kind)}{f' ({details})' if details else ''}")
    if time_s < 0.0:
        return say("{what} at the start", what=what) + often
    return say("{what} at {clock}", what=what, clock=clock(time_s)) + often


#: Beginning of the fact about a motor order that may be wrong.
NAMES_WRONG = "cannot be trusted: "


def sortie_suffix(number: int, of: int) -> str:
    """Return ` sortie 2 of 3` for the name of a log; empty for a log with one sortie."""
    return f" sortie {number} of {of}" if of > 1 else ""


def sortie_words(number: int, track: FlightTrack) -> str:
    """Return `sortie 2: from 2026-05-31 14:30:00 UTC, 3 min 28 s in flight`.

    `number` is the sortie's, from 1. The start is left out if it is unknown.
    """
    flown = f"{duration(track.flying_s)} in flight"
    unknown = float("nan")
    try:
        begun = datetime.fromtimestamp(
            unknown if track.start_unix_s is None else track.start_unix_s, tz=UTC
        )
    except (ValueError, OverflowError, OSError):  # none is known, or what is known is no time
        return f"sortie {number}: {flown}"
    return f"sortie {number}: from {begun:%Y-%m-%d %H:%M:%S} UTC, {flown}"


def several_words(sorties: int, *, load_stated: bool) -> str:
    """Return the line about several sorties in a log; a load stated by the user applies to each."""
    each = "; the load that you state is taken for each of them" if load_stated else ""
    return f"{sorties} sorties in the log, each a flight of its own{each}"


def activity_words(activity: Activity) -> str:
    """Return one thing that the aircraft was doing at a time, such as `braking`."""
    if isfinite(activity.tilt_deg):
        return say("tilted {angle}°", angle=f"{activity.tilt_deg:.0f}")
    return say(activity.kind)


def doing_words(activities: Iterable[Activity]) -> str:
    """Return what the aircraft was doing at a time, `turning left, braking`; empty if unknown."""
    return ", ".join(map(activity_words, activities))
