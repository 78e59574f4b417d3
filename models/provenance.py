"""Record the source of a number as data: what sent it, its meaning, and the sources rejected for
it.

Decisions read these fields. `remarks` are for people, and no decision reads them: another
remark, or another name of a log, changes no number. `gcs_plugin/wording` makes the words.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from functools import lru_cache
from typing import Self

from thrustmargin.models.statement import Source, Statement


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
class Provenance(Source):
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
    remarks: tuple[Statement, ...] = ()  # for people; no decision reads them

    @property
    def reported(self) -> bool:
        """Return True if a message, topic or column reports it: no setting, inference or
        assumption, and not absent."""
        return self.kind in (SourceKind.MESSAGE, SourceKind.TOPIC, SourceKind.COLUMN)

    def __str__(self) -> str:
        """Return the source as data, for programmers: `BATTERY_STATUS voltages 0 (port)`."""
        named = " ".join((self.name or self.kind, *self.fields, self.instance)).rstrip()
        return f"{named} ({'; '.join(map(str, self.remarks))})" if self.remarks else named

    def remarked(self, *remarks: Statement) -> Self:
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


def stated(remark: Statement) -> Provenance:
    """Return the source of a value that the user states, with the amount for people."""
    return Provenance(kind=SourceKind.STATED, remarks=(remark,))
