"""Make the sentences of what checks found, from its data: one for each kind of `Statement`.

A clause follows its sentence or the clause before it, with the values of both.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from thrustmargin.gcs_plugin.wording.language import (
    LANGUAGES,
    Verbatim,
    clock,
    duration,
    say,
    speaking,
    spoken,
    translations,
)
from thrustmargin.gcs_plugin.wording.reader_sentences import NOTES, REMARKS
from thrustmargin.models.json_values import to_json_values
from thrustmargin.models.provenance import Meaning, Provenance, SourceKind
from thrustmargin.models.statement import Statement, Value

if TYPE_CHECKING:
    from thrustmargin.models.flight import FlightTrack
    from thrustmargin.models.model.airframe_match import AirframeMatch, KnownFrom

#: What a rotor speed of another unit, or wrong readings of an instrument, lead to.
_REACH = (
    "thrust left and fill reach to that: check voltmeter, gauge and empty mass, and the airframe's"
)
_WRONG = "empty mass or the airframe's largest rotor speed is wrong"
#: Kind of a statement or of a clause -> its sentence.
SENTENCES: Mapping[str, str] = {
    # Vehicle, rotors and frame
    "vehicle is": "{name}: this is {vehicle} (by {evidence})",
    "for multirotors": ", and thrustmargin is for multirotors",
    "hover motors not known": (
        ", and nothing says which outputs are its hover motors (SERVOn_FUNCTION)"
    ),
    "vehicle by": "{vehicle} by {evidence}",
    "vehicle not reported": "kind of vehicle: not reported",
    "of rotors": "; {rotors}",
    "no rotors reported": "; rotors: not reported",
    "of battery": "; battery of {battery}",
    "quadplane": "a quadplane by {evidence}: it can be compared in hover alone",
    "rotors by": "{count} rotors by {evidence}",
    "rotors in flight": "{count} rotors in the flight",
    "but": ", but {conflict}",
    "rotors": "{of}; airframe {airframe} has {own}",
    "rotors not reported": ("nothing reports the number of rotors; airframe {airframe} has {own}"),
    "frame alike": (
        "FRAME_CLASS {frame_class:.0f} and FRAME_TYPE {frame_type:.0f} are {layout}, as in "
        "airframe {airframe} ({own})"
    ),
    "frame other": (
        "FRAME_CLASS {frame_class:.0f} and FRAME_TYPE {frame_type:.0f} are {layout}, which puts "
        "the motors elsewhere than airframe {airframe} ({own})"
    ),
    # Battery
    "battery": "{known} by {source}",
    "battery cells": "{number} cells",
    "battery voltage": "{number:.4g} V",
    "battery capacity": "{number:.0f} mAh",
    "cells": (
        "a battery of {battery}; the {nominal:.1f} V of airframe {airframe} would be {each:.2f} V "
        "a cell"
    ),
    "no voltage": "no battery voltage in flight",
    "volts": "{volts:.1f} V",
    "voltage": (
        "{volts:.1f} V in flight, {percent:g} % of the {nominal:.1f} V of airframe {airframe}"
    ),
    "voltage beyond": "; the same battery stays within {low:.0f} % to {high:.0f} %",
    "beyond full": (
        "{most:.1f} V at most, where a full battery of {nominal:.1f} V has {full:.1f}: the "
        "voltmeter reads {percent:.0f} % too much, or nominal_voltage is of other cells; "
        "thrust left and fill reach to what remains then"
    ),
    # Thrust by outputs, by rotor speeds and by weight
    "outputs beyond speeds": (
        f"motor outputs show {{percent:.0f}} % more thrust than the rotor speeds; {_REACH} "
        "largest rotor speed and its voltage"
    ),
    "outputs beyond weight": (
        f"motor outputs show {{percent:.0f}} % more thrust than the weight; {_REACH} "
        "largest rotor speed and its voltage"
    ),
    "speeds beyond weight": (
        f"rotor speeds show {{percent:.0f}} % more thrust than the weight; {_REACH} "
        "largest rotor speed and its voltage"
    ),
    "outputs": "motor outputs of {percent:.0f} % {of}",
    "outputs lift": (
        "motor outputs of {percent:.0f} % would lift {lifts:.3g} kg with the rotors of airframe "
        "{airframe}, which weighs {weighs:.3g} kg"
    ),
    "stated load": " with the load that is stated",
    "by the gauge": " by the gauge",
    "full": " full",
    "load is wrong": f": load, {_WRONG}",
    "gauge is wrong": f": gauge, {_WRONG}",
    "outputs and speeds": "motor outputs make {ratio:.2f} times the thrust of the rotor speeds",
    "outputs or speeds wrong": (
        ", where {low:.2f} to {high:.2f} is possible: the rotor speeds, the voltage or the largest "
        "rotor speed of airframe {airframe} are wrong, and which is not known"
    ),
    "for masses": "for {empty:.0f} to {full:.0f} kg",
    "for mass": "for {mass:.0f} kg within {percent:.0f} %",
    # Rotor speeds
    "speed": "rotors at {speed:,.0f} rpm {of}",
    "not closely": ", but not closely",
    "of some load": (
        " of some load, but no tank level says which, and no motor outputs confirm them"
    ),
    "one ESC": (
        "rotor {rotor} reads {ratio:.2f} times the speed that the others have at its output: check "
        "sensor and pole count of its ESC, or that the ESC is that motor's"
    ),
    "speed limit": (
        "a rotor turns at up to {fastest:,.0f} rpm, where airframe {airframe} reaches at most "
        "{most:,.0f} rpm at this voltage: {percent:.0f} % of its thrust would be in use"
    ),
    "speed limit of one": (
        "rotor {rotor} turns at up to {fastest:,.0f} rpm, where airframe {airframe} reaches at "
        "most {most:,.0f} rpm at this voltage: {percent:.0f} % of its thrust would be in use"
    ),
    "too few speeds": "cannot tell: too few rows in flight with every rotor's speed",
    "speeds fit": "rotor speeds fit the weight (ratio {ratio:.2f})",
    "other unit": "rotor speeds are {ratio:.3g} times what the weight needs: they look like ",
    "unit 0.0167": "revolutions per second, not rpm",
    "unit 0.105": "rad/s, not rpm",
    "unit 0.1": "tens of rpm, not rpm",
    "unit 0.01": "hundreds of rpm, not rpm",
    "unit 100": "hundredths of rpm, not rpm",
    "electrical": (
        "rotor speeds are {ratio:.1f} times what the weight needs: the ESC looks to report "
        "electrical rpm; set its pole count ({poles:g} poles fits"
    ),
    "one pole count fits": ")",
    "other poles fit": ", so would {others})",
    "poles": "{poles:g}",
    "odd speeds": (
        "rotor speeds are {ratio:.2f} times what the weight and the thrust curve of {airframe} "
        "need: wrong airframe, wrong unit, or a load that it does not know"
    ),
    "speeds late": (
        "rotor speeds come {delay:.1f} s after the acceleration that they make (correlation "
        "{correlation:.2f}; {usual:.2f} within {most:g} s): they have another clock; move them by "
        "{shift:+.1f} s"
    ),
    "speeds early": (
        "rotor speeds come {delay:.1f} s before the acceleration that they make (correlation "
        "{correlation:.2f}; {usual:.2f} within {most:g} s): they have another clock; move them by "
        "{shift:+.1f} s"
    ),
    "speeds in steps": (
        "rotor speeds come in steps of {step:.0f} rpm ({percent:.1f} %): they are used, and what "
        "is smaller shows in their mean only"
    ),
    "speeds scatter": (
        "rotor speeds scatter by {percent:.0f} % from one reading to the next: single ones say "
        "little, check the ESC telemetry"
    ),
    "speeds slow": (
        "rotor speeds are new every {interval:.1f} s only, and repeated in between: they are used, "
        "as readings that come late"
    ),
    "zero": "zero speed while thrust was asked (its ESC does not measure, or it stood still)",
    "held": "one value held while what drives the rotor changed",
    "lone": "a lone value that no rotor can have",
    # Motor order
    "order agrees": "roll, pitch and yaw response agree with the airframe's motor order",
    "order without speeds": (
        "cannot tell: rotor speeds and body rates are not reported together in flight"
    ),
    "order of vibration": "cannot tell: it shakes faster than the {rows} rows show",
    "order not shown": (
        "cannot tell: too little manoeuvring to distinguish one motor order from another"
    ),
    "arms turned": (
        "roll and pitch answer as if every rotor sat half way to its neighbour of airframe "
        "{airframe} ({layout}): its arms are turned, as plus is against X"
    ),
    "other layout": (
        "roll and pitch answer to the rotors, but not from the places that airframe {airframe} "
        "gives them ({layout}): its layout is another one"
    ),
    "spins reversed": (
        "yaw responds the wrong way: spins look reversed against airframe {airframe}"
    ),
    "swapped": "motors {first} and {second} look swapped",
    "out of order": "rotor speeds look out of order ({listed})",
    "is motor": "{rotor} is motor {motor}",
    "with every spin": ", with every spin reversed",
    "against airframe": " against airframe {airframe}",
    "not fitted": "; nothing was fitted",
    "not fitted in this order": (
        "; nothing was fitted: put the rotor speeds in motor order, or give the right --airframe"
    ),
    # Units and clock
    "units of motion": "{changes:and}, with rows {step:.3g} s apart: ",
    "position changes": "position changes {factor:g} times as much as velocity says",
    "height changes": "height changes {factor:g} times as much as vertical velocity says",
    "heading changes": "heading changes {factor:g} times as much as yaw rate says",
    "tilt changes": "tilt changes {factor:g} times as much as roll and pitch rate says",
    "table in seconds": "time_s must be in s",
    "clock not in seconds": "the clock of the log does not count seconds",
    "position units": ", these in m and m/s",
    "height units": ", these in m and m/s, down",
    "heading units": ", these in rad and rad/s",
    "tilt units": ", these in rad and rad/s",
    "airspeed changes": (
        "airspeed changes {factor:g} times as much as velocity less wind: all must be in m/s"
    ),
    # Instruments
    "instrument": "{instrument} ",
    "broken": "fell at once, and the motors felt nothing of it, to {value:.4g} {unit}",
    "copied": "of rotors {rotors:and}: one equals another's in every sample",
    "rotor": "{rotor}",
    "unloaded": "did not fall under load, {value:.4g} {unit} in flight",
    "unfollowed": "does not change as the thrust does, {value:.4g} {unit} in flight",
    "impossible": "is not of the air, {value:.4g} {unit} in flight",
    "stood": "stood at {value:.4g} {unit} for a minute or more",
    "stood throughout": "stood at {value:.4g} {unit} throughout the flight",
    "left out": ": no measurement, and left out",
    # Load by thrust, where nothing reports it
    "no load shown": ("load not known: no level flight with every rotor's speed to show the load"),
    "load by thrust": "load not known: hover thrust shows {load:.1f} ± {within:.1f} kg (90 %)",
    "too unsure": ", too unsure to be used",
    "less than nothing": ", less than nothing: check mass and thrust of the airframe",
    "more than carried": ", more than the aircraft can carry: check the airframe",
    "state load": "; state it with --load",
    # Air and ceiling
    "air assumed": (
        "assumed {density} kg/m³ (sea level, 15 °C): neither pressure nor altitude was reported"
    ),
    "air given": "given with the flight",
    "air": "{parts:;}",
    "air by pressure": "static pressure and the temperature of {of}",
    "air by altitude": "altitude in the standard atmosphere at the temperature of {of}",
    "air by altitude in rows": "altitude in the standard atmosphere in {rows}",
    "median air": "the flight's median in {rows} that reported neither",
    "pressure ignored": "pressure outside {low:.0f}..{high:.0f} hPa ignored in {rows}",
    "row": "{count:.0f} row",
    "rows": "{count:.0f} rows",
    "outside air": "the air as {source}",
    "air by board": (
        "the autopilot's board less {warmer:g} K (± {within:g} K: outside temperature not known)"
    ),
    "standard atmosphere": (
        "the standard atmosphere (± {within:g} K: outside temperature not known)"
    ),
    "temperature offset": " {offset:+g} K",
    "no airframe": "no airframe",
    "measured voltage": "measured battery voltage",
    "nominal voltage": "nominal voltage {nominal:g} V: battery voltage not reported",
    "partly measured voltage": (
        "measured battery voltage; nominal voltage {nominal:g} V in {rows:.0f} rows without one"
    ),
    "nameplate": "nameplate",
    # Grounds of an airframe
    "no airframe given": "this aircraft is not known: no airframe was given",
    "not yet": "airframe not known yet: hover 5 s",
    "not recognised": "the flight is not recognised as one of {airframe}: {why}",
    "too little to compare": "too little in it to compare",
    **REMARKS,
    **NOTES,
}
#: Words of a channel whose meaning differs from its name.
_MEANINGS: Mapping[Meaning, str] = {
    Meaning.GROUND_SPEED: "ground speed: no airspeed and no wind reported",
    Meaning.BOARD_TEMPERATURE: "of the autopilot's board: warmer than the air",
    Meaning.ABOVE_HOME: "height above home, not above the crop",
}
_INFERRED: Mapping[Meaning, str] = {
    Meaning.MOTOR_OUTPUTS: "from motor outputs",
    Meaning.HOVER_THRUST: "inferred from hover thrust",
}
#: Quantity of an airframe that widens the interval of a margin if it is guessed -> its name.
_RESTS_ON: Mapping[str, str] = {
    "empty_mass": "mass",
    "thrust_coefficient": "thrust coefficient",
    "max_rotor_speed_rpm": "largest rotor speed",
    "ceiling_voltage": "voltage of the largest rotor speed",
}


def statement_words(one: Statement) -> str:
    """Return the sentence of a check's statement; raise KeyError for a kind without one."""
    values = {name: _filled(value, name) for name, value in one.values}
    return "".join(say(SENTENCES[kind], **values) for kind in (one.kind, *one.clauses))


def note_words(track: FlightTrack) -> list[str]:
    """Return the notes of a track, then the findings of its checks, one sentence each."""
    return list(map(statement_words, (*track.notes, *track.statements)))


def source_words(source: Provenance) -> str:
    """Return the source of a channel's values in words, with its remarks in brackets; names of
    messages are not translated.

    It is the names of the parts, if it has some, else its own name with its fields; `not in the
    log` for an absent channel.
    """
    remarks = "; ".join(_remark_words(remark, source) for remark in source.remarks)
    parts = ", ".join(
        source_words(part)
        for part in source.parts
        if source.kind is not SourceKind.INFERRED or part.meaning is not source.meaning
    )
    match source.kind:
        case SourceKind.ABSENT:
            return say("not in the log")
        case SourceKind.STATED:
            return f"{say('stated')}: {remarks}" if remarks else say("stated")
        case SourceKind.INFERRED:
            named = say(_INFERRED.get(source.meaning, source.name))
            if parts and source.meaning is Meaning.MOTOR_OUTPUTS:
                named = f"{parts}; {named}"
            return f"{named} ({remarks})" if named and remarks else named or remarks
        case SourceKind.COLUMN:
            named = say("column {name}", name=Verbatim(source.name))
        case SourceKind.AIRFRAME:
            named = say("airframe {airframe}", airframe=Verbatim(source.name))
        case _:
            named = source.name
    named = f"{named} {', '.join(source.fields)}" if source.fields else named
    named = parts or named
    if source.instance:
        named = say("{source} of id {number}", source=Verbatim(named), number=source.instance)
    meaning = _MEANINGS.get(source.meaning, "")
    known = [text for text in (say(meaning) if meaning else "", remarks) if text]
    return f"{named} ({'; '.join(known)})" if known else named


def _remark_words(remark: Statement, source: Provenance) -> str:
    """Return a remark on a source, which may name its parts or the one rejected for it."""
    own = translations(spoken(), "source").get(SENTENCES[remark.kind])
    if own:  # a word may mean another thing elsewhere
        return own
    of = source.parts or tuple(one.source for one in source.rejected[-1:])
    named = Verbatim(", ".join(map(source_words, of)))
    return statement_words(replace(remark, values=(*remark.values, ("source", named))))


def in_english(one: Statement | Provenance) -> str:
    """Return a statement or a source in English, for files and stores with readers of every
    language."""
    with speaking(LANGUAGES[0]):
        return statement_words(one) if isinstance(one, Statement) else source_words(one)


def source_values(source: Provenance) -> dict[str, Any]:
    """Return a channel's source as a dict for JSON, with its remarks in words.

    Sources of its parts, and rejected sources with the reason, are nested.
    """
    values: dict[str, Any] = to_json_values(source)
    values["parts"] = [source_values(part) for part in source.parts]
    values["rejected"] = [
        {"source": source_values(one.source), "reason": one.reason.value} for one in source.rejected
    ]
    values["remarks"] = [_remark_words(remark, source) for remark in source.remarks]
    return values


def value_words(value: str | Statement) -> str:
    """Return a name, or what a statement says."""
    return statement_words(value) if isinstance(value, Statement) else value


class _Listed(Verbatim):
    """Sentences to fill in, joined by commas, or with "and" where the format says so."""

    def __new__(cls, parts: list[str]) -> _Listed:
        listed = super().__new__(cls, ", ".join(parts))
        listed.parts = parts
        return listed

    parts: list[str]

    def __format__(self, how: str) -> str:
        between = {"and": f" {say('and')} ", ";": "; "}.get(how, ", ")
        return between.join(self.parts)


def _filled(value: Value, name: str = "") -> object:
    """Return a value as `say` fills it into a sentence, translated.

    A number becomes a clock time if `name` ends in _clock, and a duration if it ends in _duration.
    Sources and statements become their words, a tuple of statements a list of them.
    """
    if isinstance(value, Provenance):
        return Verbatim(source_words(value))
    if isinstance(value, float) and name.endswith("_clock"):
        return Verbatim(clock(value))
    if isinstance(value, float) and name.endswith("_duration"):
        return Verbatim(duration(value))
    if isinstance(value, Verbatim):
        return value
    if isinstance(value, Statement):
        return Verbatim(statement_words(value))
    if isinstance(value, tuple):
        return _Listed([statement_words(one) for one in value])
    return Verbatim(say(value)) if isinstance(value, str) else value


def airframe_match_words(airframe_match: AirframeMatch) -> str:
    """Return which airframe a flight is analysed with, and how it was chosen: `airframe x, given`.

    A known aircraft is named with its number of flights; `a plan` for an airframe given without a
    name.
    """
    if airframe_match.known_from is not None:
        return known_words(airframe_match.known_from)
    if not airframe_match.airframe and airframe_match.basis == "given":
        return say("a plan")
    return say("airframe {grounds}", grounds=Verbatim(grounds_words(airframe_match)))


def known_words(known: KnownFrom) -> str:
    """Return the known aircraft and what its model learnt from, in words.

    `aircraft x, known from 5 flights on 3 days`; without a flight, that none has taught its model
    yet.
    """
    own = {"name": Verbatim(known.aircraft), "flights": known.flights, "days": known.days}
    if known.flights == 0:
        return say("aircraft {name}: no flight has taught its model yet", **own)
    if known.flights == 1:
        return say("aircraft {name}, known from 1 flight", **own)
    if known.days == 1:
        return say("aircraft {name}, known from {flights} flights on one day", **own)
    return say("aircraft {name}, known from {flights} flights on {days} days", **own)


def last_known_words(known: KnownFrom) -> str:
    """Return the known aircraft with the day and log of its last flight, as a sentence without its
    full stop.

    What happened after that flight is not known: a log without a verdict is not kept. Empty for an
    aircraft without a flight.
    """
    if not known.last_log:
        return ""
    return say(
        "{known}; its last flight with a verdict is {log} of {day}: what came after it is not "
        "known",
        known=Verbatim(known_words(known)),
        log=Verbatim(known.last_log),
        day=Verbatim(known.last_flight[:10]),
    )


def grounds_words(airframe_match: AirframeMatch) -> str:
    """Return an airframe's name and how it was chosen, to follow the word "airframe": `x, given`.

    For a known aircraft it is its name and the flights it is known from; for a recognised one, what
    in the flight fits it. Guessed values in the airframe are named, but not for a known aircraft;
    `not known` if none was chosen.
    """
    if airframe_match.known_from is not None:
        return known_words(airframe_match.known_from)
    if airframe_match.basis == "not known":
        return say("not known")
    names = ", ".join(say(_RESTS_ON[name]) for name in airframe_match.guessed)
    guessed = say("; guessed in it: {names}", names=Verbatim(names)) if names else ""
    own = {"airframe": Verbatim(airframe_match.airframe), "guessed": guessed}
    if airframe_match.basis == "given":
        return say("{airframe}, given{guessed}", **own)
    by = _Listed([statement_words(one) for one in airframe_match.recognised_by])
    return say("{airframe}: nobody named it, and the flight fits it ({by}){guessed}", by=by, **own)


def no_verdict_words(airframe_match: AirframeMatch) -> list[str]:
    """Return the reasons why no margin is claimed, one sentence each."""
    return [statement_words(one) for one in airframe_match.no_verdict]


def described_words(airframe_match: AirframeMatch) -> str:
    """Return how the airframe was chosen, and what no longer fits it.

    If there is no verdict, return `NO VERDICT:` and the reasons instead.
    """
    if airframe_match.no_verdict:
        why = Verbatim("; ".join(no_verdict_words(airframe_match)))
        return say("NO VERDICT: {why}", why=why)
    misfits = (Verbatim(statement_words(one)) for one in airframe_match.misfit)
    return "; ".join(
        [
            airframe_match_words(airframe_match),
            *(say("no longer fits: {why}", why=w) for w in misfits),
        ]
    )


def remedy_words(airframe_match: AirframeMatch) -> str:
    """Return what the pilot can do for a verdict if the airframe is unknown or does not fit the
    log.

    Only meaningful without a verdict.
    """
    source = Verbatim(airframe_match.source)
    if airframe_match.odd_voltage:
        return say(
            "set the voltmeter's scale right if it reads wrong (BATT_VOLT_MULT, BAT1_V_DIV); of "
            "another battery state its cells: `thrustmargin airframe new --from {source} --cells "
            "COUNT`, or name another with --airframe",
            source=source,
        )
    if airframe_match.known_from is not None:
        return say(
            "set right what reads wrong; if nothing does, make the aircraft again, with its mass, "
            "size and motors: `thrustmargin learn LOGS --aircraft {name} --again`",
            name=Verbatim(airframe_match.known_from.aircraft),
        )
    if airframe_match.basis == "given":
        return say(
            "set right what reads wrong; if nothing does, make the aircraft's own airframe with "
            "`thrustmargin airframe new --from {source}`, or name another with --airframe",
            source=source,
        )
    return say(
        "make the aircraft's own airframe with `thrustmargin airframe new --from {source}`, or "
        "name one with --airframe",
        source=source,
    )
