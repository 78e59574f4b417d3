"""Record the source of a number as data: what sent it, its meaning, and the sources rejected for
it.

Decisions read these fields. `words` is for people, and `remarks` are text for people that no code
reads: another text, or another name of a log, changes no number.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import lru_cache
from types import MappingProxyType
from typing import Self


class SourceKind(StrEnum):
    """The kind of source of a fact."""

    ABSENT = "not reported"
    MESSAGE = "message"  # of MAVLink or DataFlash
    TOPIC = "topic"  # of PX4
    COLUMN = "column"  # of a table
    PARAMETER = "parameter"  # of the autopilot
    STATED = "stated"  # by the user
    AIRFRAME = "airframe file"
    INFERRED = "inferred"  # from other channels
    ASSUMED = "assumed"


class Meaning(StrEnum):
    """The meaning of a channel's numbers, where it differs from the channel's name."""

    AS_NAMED = "as named"
    GROUND_SPEED = "ground speed"  # an airspeed: no sensor of it, and no wind
    BOARD_TEMPERATURE = "board temperature"  # warmer than the air
    ABOVE_HOME = "height above home"  # not above the crop
    THRUST_DEMAND = "thrust demand"  # a motor output before the autopilot's thrust curve
    PX4_OUTPUT = "PX4 output"  # a motor output after PX4's thrust curve
    MOTOR_OUTPUTS = "motor outputs"  # rotor speeds made from them
    HOVER_THRUST = "hover thrust"  # a load made from it


#: Words for people on a channel whose meaning differs from its name.
_MEANINGS: Mapping[Meaning, str] = MappingProxyType(
    {
        Meaning.GROUND_SPEED: "ground speed: no airspeed and no wind reported",
        Meaning.BOARD_TEMPERATURE: "of the autopilot's board: warmer than the air",
        Meaning.ABOVE_HOME: "height above home, not above the crop",
    }
)
_INFERRED: Mapping[Meaning, str] = MappingProxyType(
    {
        Meaning.MOTOR_OUTPUTS: "from motor outputs",
        Meaning.HOVER_THRUST: "inferred from hover thrust",
    }
)


_NAMED_BEFORE: Mapping[SourceKind, str] = MappingProxyType(
    {SourceKind.COLUMN: "column ", SourceKind.AIRFRAME: "airframe "}
)


class Reason(StrEnum):
    """The reason why a source was not used."""

    LESS_PREFERRED = "another is preferred"
    COVERS_LESS = "covers less of the flight"
    NO_NUMBERS = "has no numbers"
    CONTRADICTED = "contradicted by thrust"
    FROZEN = "stood still throughout the flight"
    BROKEN = "fell at once, and the motors felt nothing of it"
    UNLOADED = "did not fall under load"  # a voltage that only trembles
    UNFOLLOWED = "does not change as the thrust does"  # a tank level
    IMPOSSIBLE = "is not of the air"  # pressure or temperature
    COPIED = "equals another's in every sample"  # a rotor speed


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """The source of one channel or one fact."""

    kind: SourceKind
    name: str = ""  # of the message, topic, column, parameter or option
    fields: tuple[str, ...] = ()  # of the message or topic
    instance: str = ""  # battery or sensor id
    unit: str = ""  # as sent; empty where it is that of the channel
    meaning: Meaning = Meaning.AS_NAMED
    assumed: bool = False  # an input that it needed was unknown and is assumed
    parts: tuple[Provenance, ...] = ()  # sources that it was made from
    rejected: tuple[Rejected, ...] = ()
    numbers: tuple[tuple[str, float], ...] = ()  # numbers that it was made with, by name
    remarks: tuple[str, ...] = ()  # for people; no code reads them

    @property
    def reported(self) -> bool:
        """Return whether a message, topic or column reports it: no setting, inference or
        assumption, and not absent."""
        return self.kind in (SourceKind.MESSAGE, SourceKind.TOPIC, SourceKind.COLUMN)

    @property
    def words(self) -> str:
        """Return the source for people, as `BATTERY_STATUS voltages of id 0`."""
        return self.described()

    def described(self, say: Callable[[str], str] = str) -> str:
        """Return the source for people; `say` translates what is not a name."""
        remarks = "; ".join(map(say, self.remarks))
        if self.kind is SourceKind.ABSENT:
            return say("not in the log")
        if self.kind is SourceKind.STATED:
            return f"{say('stated')}: {remarks}" if remarks else say("stated")
        if self.kind is SourceKind.INFERRED:
            parts = (part for part in self.parts if part.meaning is not self.meaning)
            of = ", ".join(part.described(say) for part in parts)
            named = say(_INFERRED.get(self.meaning, self.name))
            if named and of and self.meaning is Meaning.MOTOR_OUTPUTS:
                named = f"{of}; {named}"
            return f"{named} ({remarks})" if named and remarks else named or remarks
        if self.parts:
            named = ", ".join(part.described(say) for part in self.parts)
        else:
            fields = f" {', '.join(self.fields)}" if self.fields else ""
            before = _NAMED_BEFORE.get(self.kind, "")
            named = f"{say(before) if before else ''}{self.name}{fields}"
        if self.instance:
            named = f"{named}{say(' of id ')}{self.instance}"
        meaning = _MEANINGS.get(self.meaning, "")
        known = [text for text in (say(meaning) if meaning else "", remarks) if text]
        return f"{named} ({'; '.join(known)})" if known else named

    def remarked(self, *remarks: str) -> Self:
        """Return the source with more remarks for people."""
        return replace(self, remarks=(*self.remarks, *remarks))

    def of_instance(self, instance: int | None) -> Provenance:
        """Return the source with the id of one battery or sensor; unchanged for None."""
        return self if instance is None else _of_instance(self, instance)


@dataclass(frozen=True, slots=True)
class Rejected:
    """A source that exists and was not used, with the reason."""

    source: Provenance
    reason: Reason


NOT_REPORTED = Provenance(kind=SourceKind.ABSENT)


@lru_cache(maxsize=1024)  # each live message needs it
def _of_instance(source: Provenance, instance: int) -> Provenance:
    """Return the source with an id; cached for live use."""
    return replace(source, instance=str(instance))


def stated(remark: str) -> Provenance:
    """Return the source of a value that the user states, with the amount for people."""
    return Provenance(kind=SourceKind.STATED, remarks=(remark,))
