"""The answer of `identify` in words: what is missing, how sure, what it does to the margin."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType

from thrustmargin.gcs_plugin.reports.identify.open_questions import open_questions
from thrustmargin.gcs_plugin.wording.described_effect import rotor_words
from thrustmargin.gcs_plugin.wording.effect_sentences import effect_sentence
from thrustmargin.gcs_plugin.wording.numbers import number, percent
from thrustmargin.models.identification.margin_change import WORST_SHARE, MarginChange
from thrustmargin.models.identification.result import Errors, Found, Identification
from thrustmargin.models.identification.terms import Term

DEGREES = 180.0 / math.pi
#: Channels as people call them, the unit that they are shown in, and what to multiply by for it.
CHANNEL_WORDS: Mapping[str, tuple[str, str, float]] = MappingProxyType(
    {
        "airspeed": ("airspeed", "m/s", 1.0),
        "tank_kg": ("tank level", "kg", 1.0),
        "time_s": ("time in the log", "s", 1.0),
        "advance_ratio": ("climb (axial advance ratio)", "", 1.0),
        "radius_over_height": ("rotor radius over height", "", 1.0),
        "voltage": ("battery voltage", "V", 1.0),
        "density": ("air density", "kg/m³", 1.0),
        "heading": ("heading", "°", DEGREES),
        "yaw_rate": ("yaw rate", "°/s", DEGREES),
        "yaw_acceleration": ("yaw acceleration", "°/s²", DEGREES),
        "load_factor": ("load factor", "", 1.0),
    }
)
#: Share of thrust by which a margin must move to be reported as a change.
NOTICED = 0.005


def answer(
    found: Identification, steps: Sequence[MarginChange], total: MarginChange
) -> tuple[str, ...]:
    """The sentences to read first: one an effect, then all together, then what stays open.

    `steps` and `total` are of `models.identification.margin_change.margin_changes`.
    """
    names = found.model.airframe.rotor_names
    lines = [
        "; ".join([effect_sentence(f, found), _error_words(f, found), margin_words(c, names)])
        for f, c in zip(found.found, steps, strict=True)
    ]
    if len(lines) == 1 and found.held_out is not None:
        change = f"RMSE on flights not used {_fall(found.before.rmse_rpm, found.after.rmse_rpm)}"
        sentence = effect_sentence(found.found[0], found)
        lines = [f"{sentence}; {change}; {margin_words(steps[0], names)}"]
    lines += [effect_sentence(f, found) for f in found.followed]
    lines.append(together(found, total))
    if unexplained(found):
        lines.append(unexplained(found))
    lines += [how_to_distinguish(f) for f in found.found if f.indistinguishable_from]
    lines += open_questions(found)
    return tuple(f"{line}." for line in (*lines, *claims(found)))


def _fall(before: float, after: float) -> str:
    return f"{number(before, '', 0)} -> {number(after, 'rpm', 0)}"


def _error_words(f: Found, found: Identification) -> str:
    left_out = "flights" if found.problem.flights > 1 else "fifths of the flight"
    return f"RMSE on {left_out} left out in turn {_fall(f.rmse_before_rpm, f.rmse_after_rpm)}"


def where_from(found: Identification) -> str:
    """Which rows the errors before and after are of."""
    if found.held_out is not None:
        count = found.held_out.flights
        return f"{count} flight{'s' if count > 1 else ''} not used"
    if found.problem.flights > 1:
        return f"{found.problem.flights} flights, each predicted without itself"
    return "one flight, each fifth predicted without itself"


def together(found: Identification, total: MarginChange) -> str:
    """All effects together, with the interval of the error and the floor."""
    after, names = found.after, found.model.airframe.rotor_names
    floor = f"at best {number(found.floor_rpm, 'rpm', 0)} with these channels"
    if found.held_out is not None:
        floor += " on the flights learnt from"
    if not found.found:
        nothing = "Nothing of the table is missing"
        if unexplained(found):
            nothing = "No effect of the table fits what is left"
        return f"{nothing}: RMSE {_with_interval(after)} on {where_from(found)}, {floor}"
    fall = f"RMSE {number(found.before.rmse_rpm, '', 0)} -> {_with_interval(after)}"
    effects = "All together" if len(found.found) > 1 else "With it"
    return f"{effects}: {fall} on {where_from(found)}, {floor}; {margin_words(total, names)}"


def _with_interval(errors: Errors) -> str:
    low, high = errors.rmse_ci95_rpm
    middle = number(errors.rmse_rpm, "rpm", 1)
    return f"{middle} ({number(low, '', 1)} to {number(high, '', 1)})"


def margin_words(change: MarginChange, names: tuple[str, ...]) -> str:
    """The predicted margin without and with effects: typical, or at the worst moments if more."""
    who = "the worst rotor" if change.rotor is None else rotor_words(change.rotor, names)
    typical = change.typical_after - change.typical_before
    worst = change.worst_after - change.worst_before
    if abs(worst) > 2.0 * abs(typical) and abs(worst) >= NOTICED:
        when = f"at the worst moments ({percent(WORST_SHARE)} of the time) "
        return f"{when}margin of {who} {_moves(change.worst_before, change.worst_after)}"
    if abs(typical) < NOTICED:
        return f"margin of {who} stays at {percent(change.typical_after)}"
    return f"margin of {who} {_moves(change.typical_before, change.typical_after)}"


def _moves(before: float, after: float) -> str:
    decimals = 0 if round(before * 100) != round(after * 100) else 1
    way = "falls" if after < before else "rises"
    return f"{way} from {percent(before, decimals)} to {percent(after, decimals)}"


def unexplained(found: Identification) -> str:
    """What is left that no effect explains."""
    curve, slow = found.curve, found.slow
    if curve is None:
        if slow is None:
            return ""
        return (
            f"Unexplained: {number(slow.rms_rpm, 'rpm', 0)} RMS of {slow.mode}, "
            f"{percent(slow.share, 0)} of the variance left, lasts for seconds and goes with no "
            "channel; look at the liquid, the load and that sensor"
        )
    mode = found.problem.modes.names[curve.mode]
    return (
        f"Unexplained: {percent(curve.share, 1)} of the variance left is {mode} that goes with "
        f"{channel_name(curve.channel)}; no effect of the table has that form, so none was added "
        "for it"
    )


def channel_name(channel: str) -> str:
    """As people call it; the name itself where there is no other."""
    return CHANNEL_WORDS[channel][0] if channel in CHANNEL_WORDS else channel.replace("_", " ")


def channel_title(channel: str) -> str:
    """The channel with its unit, for an axis."""
    unit = CHANNEL_WORDS[channel][1] if channel in CHANNEL_WORDS else ""
    return f"{channel_name(channel)}{f', {unit}' if unit else ''}"


def channel_factor(channel: str) -> float:
    """What the channel's numbers are to be multiplied by for that unit."""
    return CHANNEL_WORDS[channel][2] if channel in CHANNEL_WORDS else 1.0


def term_name(term: Term) -> str:
    """`rotor degradation of rotor 1 (onset)`."""
    words = term.effect.name.replace("_", " ")
    if term.rotor is not None:
        words += f" of rotor {term.rotor + 1}"
    return f"{words} ({term.effect.variant})" if term.effect.variant else words


def found_name(found: Found) -> str:
    """The name of an effect that was found, as in the list of candidates."""
    return term_name(found.term)


def how_to_distinguish(found: Found) -> str:
    """What these flights cannot distinguish from an effect, and the flight that would."""
    others = " or ".join(name.replace("_", " ") for name in found.indistinguishable_from)
    return (
        f"These flights cannot distinguish {found_name(found)} from {others}; this would: "
        f"{found.term.effect.distinguished_by}"
    )


def claims(found: Identification) -> tuple[str, ...]:
    """What so few flights do not allow to say."""
    if found.problem.flights == 1:
        return (
            "One flight only: that this holds on another flight cannot be claimed, and effects "
            "that differ from flight to flight (air, battery, fill, wind) cannot be distinguished "
            "from each other; the intervals are of this flight alone. Give two flights or more, at "
            "different tank levels, and one more with --held-out",
        )
    if found.problem.flights == 2:
        return (
            "Two flights only: the intervals show how stretches of these flights differ, not how "
            "flights do. Three or more would show it",
        )
    return ()
