"""Represent the content of a log file in the vehicle's own time, before it becomes one table.

A `Recording` is all streams of messages that are needed from one file. The reader of each format
makes a Recording; `sorties_of` makes a FlightLog of each of its sorties. The treatment of clocks
that jump, fall back or pause is shared here by all readers.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.telemetry.signals import Stream
from thrustmargin.gcs_plugin.telemetry.vehicle_events import VehicleEvent
from thrustmargin.gcs_plugin.wording.check_words import source_values, source_words, statement_words
from thrustmargin.gcs_plugin.wording.flight_words import sortie_suffix
from thrustmargin.mission.plan_items import PlanItem
from thrustmargin.models.errors import LogError
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.json_values import to_json_values
from thrustmargin.models.physics.smoothing import median_of_five
from thrustmargin.models.provenance import Provenance
from thrustmargin.models.statement import Statement, state
from thrustmargin.models.vehicle_facts import VehicleFacts


class NotThisFormat(LogError):
    """Raised when no message of the expected format is in the file."""


@dataclass(frozen=True, slots=True)
class Damage:
    """A place in a file where bytes were skipped."""

    byte: int  # offset in the file
    length: int  # bytes skipped
    time_s: float  # vehicle's clock of the last good message before it; NaN at the start


@dataclass(frozen=True, slots=True, kw_only=True)
class LogQuality:
    """The completeness of a log file: frames read, bytes skipped, gaps."""

    bytes: int
    frames: int  # messages kept, of every type and sender
    bad_checksum: int = 0  # whole frames whose checksum is wrong (formats without one: 0)
    bytes_skipped: int = 0  # bytes that belong to no message kept
    unknown_ids: Mapping[int, int] = field(default_factory=dict)  # id -> frames skipped
    copies: int = 0  # frames that came again over a second link or router, dropped
    frames_missing: int = 0  # by MAVLink sequence numbers: not received, or not recorded
    damage: tuple[Damage, ...] = ()  # the largest places, in file order
    damaged_places: int = 0
    clock_jumps: tuple[tuple[float, float], ...] = ()  # (clock before, clock after), s
    gaps: tuple[tuple[float, float], ...] = ()  # (start, length) s without any message, > 1 s


def mission_item(message: str, item: np.void) -> PlanItem:
    """Return the plan item of one MISSION_ITEM_INT or MISSION_ITEM message, as `message` names it.

    `item` is the message's row. Latitude and longitude become degrees, (0, 0) if either is not
    finite.
    """
    scale, places = (1e-7, 7) if message == "MISSION_ITEM_INT" else (1.0, 15)
    where = tuple(round(float(item[k]) * scale, places) for k in ("x", "y"))
    one, two, three, four = (float(item[f"param{k}"]) for k in (1, 2, 3, 4))
    return PlanItem(
        number=int(item["seq"]),
        command=int(item["command"]),
        frame=int(item["frame"]),
        parameters=(one, two, three, four, *placed(*where), float(item["z"])),
    )


def placed(latitude: float, longitude: float) -> tuple[float, float]:
    """Return latitude and longitude, degrees; (0, 0), as vehicles send for no place, if either is
    not finite."""
    return (latitude, longitude) if math.isfinite(latitude + longitude) else (0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelReport:
    """The source and completeness of one channel of a track."""

    name: str
    unit: str
    source: Provenance
    unused: Statement | None  # a source that is there and was not used, where there is no other
    samples: int
    rate_hz: float  # median of the source; NaN with fewer than two samples
    gaps: int  # pauses longer than the channel's age limit
    longest_gap_s: float
    minimum: float
    median: float
    maximum: float


def channel_source(channel: ChannelReport) -> str:
    """Return the source of a channel of a log, or why a source in the log is not used."""
    unused = channel.unused
    return source_words(channel.source) if unused is None else statement_words(unused)


def channel_values(channel: ChannelReport) -> dict[str, Any]:
    """Return the report of a channel as JSON values by field name, with its source in words as
    `source`.

    `provenance` is the source as values. `unused` is left out: it is in the words of the source.
    """
    values: dict[str, Any] = to_json_values(channel)
    del values["unused"]
    words = {"source": channel_source(channel), "provenance": source_values(channel.source)}
    return {"name": channel.name, "unit": channel.unit} | words | values | words


@dataclass(frozen=True, slots=True)
class EngineerNote:
    """A note that a person made of a flight, at s from its first row."""

    time_s: float
    text: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class LogHeader:
    """The metadata that a recording shares with each of its sorties."""

    path: Path
    format: str
    quality: LogQuality
    parameters: Mapping[str, float] = field(default_factory=dict)
    waypoints: tuple[PlanItem, ...] = ()
    messages: tuple[tuple[float, str], ...] = ()  # (s, text)
    #: Texts of the same boot from before this sortie: frame and version are valid until a restart.
    earlier_texts: tuple[str, ...] = ()
    events: tuple[VehicleEvent, ...] = ()  # of a recording: those without a text
    vehicle: int = 1
    vehicles: tuple[int, ...] = (1,)  # system ids in the file; empty for a table, which has none
    autopilot: str = "unknown"  # or "ArduPilot", "PX4"
    hardware_id: str = ""  # serial number of the autopilot in hexadecimal digits
    firmware: str = ""  # where a field of its own states it


def several_autopilots(system: int, chosen: int, others: Iterable[int]) -> Statement:
    """Return the note that component `chosen` of several autopilots with one system id is read."""
    left_out = ", ".join(map(str, others))
    return state("several autopilots", system=str(system), chosen=str(chosen), others=left_out)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class Recording(LogHeader):
    """The needed messages of one vehicle in one file; times are the vehicle's clock."""

    streams: Mapping[str, Stream]
    unix_minus_clock: float | None  # s to add to the vehicle's clock for Unix time
    mav_type: int | None = None  # as the vehicle reports itself; None unknown
    motor_order: Statement | None = None  # where motor outputs are numbered by motor already
    esc_order: Statement | None = None  # likewise ESC channels
    unused: Mapping[str, Statement] = field(
        default_factory=dict
    )  # channel -> what is there, why not used
    notes: tuple[Statement, ...] = ()
    parameters_whole: bool = True  # False: the vehicle has more than are in the log
    #: (s, name, value) of every time that a parameter was sent, in order.
    parameters_sent: tuple[tuple[float, str, float], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class FlightLog(LogHeader):
    """A sortie of a log; times are s from the first row of its track.

    Most logs contain one sortie.
    """

    track: FlightTrack
    channels: tuple[ChannelReport, ...]
    clock_start_s: float  # vehicle's clock at the track's first row, s since boot
    facts: VehicleFacts = field(default_factory=VehicleFacts)  # what kind of vehicle it is
    esc_voltage_offset_v: tuple[float, ...] = ()  # of each motor's ESC off the others; NaN none
    unmeasured: tuple[Statement, ...] = ()  # of the notes, those on ESC readings that are none
    other_units: tuple[
        Statement, ...
    ] = ()  # of the notes, those on columns left out for their unit
    sortie: int = 1  # its number in the log, of `sorties` in all
    sorties: int = 1
    unflown: tuple[Statement, ...] = ()  # the rest of the log
    engineer_notes: tuple[EngineerNote, ...] = ()  # of the log's notes file, in order of time

    @property
    def name(self) -> str:
        """Return `flight.tlog`, or `flight.tlog sortie 2 of 3`; clean it before showing it on a
        screen.
        """
        return f"{self.path.name}{self.sortie_suffix}"

    @property
    def sortie_suffix(self) -> str:
        """Return ` sortie 2 of 3`; empty if the log contains only one."""
        return sortie_suffix(self.sortie, self.sorties)

    @property
    def silences(self) -> tuple[tuple[float, float], ...]:
        """Return the start, s since boot, and length, s, of every pause over 1 s without any
        message.

        Pauses before the first row are excluded: mission and parameters are sent then.
        """
        return tuple(gap for gap in self.quality.gaps if gap[0] >= self.clock_start_s)

    def __repr__(self) -> str:
        track, quality = self.track, self.quality
        present = ", ".join(c.name for c in self.channels if c.samples)
        absent = ", ".join(c.name for c in self.channels if not c.samples)
        skipped = f"{quality.bytes_skipped} bytes in {quality.damaged_places} damaged place(s)"
        lines = (
            f"FlightLog {self.path.name}: {self.format}, vehicle {self.vehicle} ({self.autopilot})",
            f"{track.duration:.1f} s in {track.time_s.size} rows; "
            f"{statement_words(self.facts.statement)}",
            f"channels: {present or 'none'}",
            f"not in the log: {absent or 'nothing'}",
            f"file: {quality.frames} messages in {quality.bytes} bytes, skipped: "
            + (skipped if quality.damaged_places else "nothing"),
        )
        return textwrap.indent("\n".join(textwrap.shorten(x, 240) for x in lines), "  ")[2:]


def serial_digits(text: str) -> str:
    """Return a serial number's hexadecimal digits, in lower case, without trailing zero bytes.

    Empty if the text is not hexadecimal, or all zeros.
    """
    text = text.strip().lower()
    if len(text) % 2 or not re.fullmatch("[0-9a-f]+", text):
        return ""
    return bytes.fromhex(text).rstrip(b"\0").hex()


def damage_of(
    skipped: Sequence[tuple[int, int]], place: NDArray[np.int64], clock_s: Floats
) -> dict[str, Any]:
    """Return bytes_skipped, damage and damaged_places of LogQuality for the skipped stretches.

    `skipped` has (offset, length), bytes, of each; the 20 longest are listed singly, in file order.
    `clock_s` (n,) is the vehicle's clock at the ascending file offsets `place` (n,).
    """
    worst = sorted(sorted(skipped, key=lambda stretch: -stretch[1])[:20])
    before = np.searchsorted(place, [byte for byte, _ in worst])
    times = np.append(np.nan, clock_s)[before].tolist()
    return {
        "bytes_skipped": sum(length for _, length in skipped),
        "damage": tuple(Damage(*lost, time_s) for lost, time_s in zip(worst, times, strict=True)),
        "damaged_places": len(skipped),
    }


BACKWARD = 1.0  # s; a clock that falls by more has been restarted
FORWARD = 5.0  # s; a larger step from message to message is looked at twice
GAP = 1.0  # s without any message
_MANY = 10  # falls in one log that no vehicle restarts


class Stretch(NamedTuple):
    """A run of rows between two restarts, `first` and `last` included."""

    first: int
    last: int


def stretches(time_s: Floats, name: str) -> tuple[Stretch, ...]:
    """Divide times (n,), s, in file order, into the runs between restarts; every row is in one.

    A fall of more than BACKWARD s is a restart, but not a single late message. `name` is the log's,
    for the LogError raised if two clocks alternate, as when two vehicles share a system id.
    """
    smooth = median_of_five(time_s) if time_s.size >= 5 else time_s
    falls = np.flatnonzero(np.diff(smooth) < -BACKWARD) + 1
    edges = np.concatenate([[0], falls, [time_s.size]]).astype(np.int64)
    if falls.size > _MANY and np.diff(edges).max() < 0.5 * time_s.size:
        # A clock that was restarted counts on; that of another vehicle leaps back up.
        up = [np.max(np.diff(smooth[a:b]), initial=0.0) for a, b in pairwise(edges[1:])]
        if np.mean(np.array(up) > 0.5 * (smooth[falls - 1] - smooth[falls])) > 0.5:
            raise LogError(
                f"{name}: the clock jumps back {falls.size} times, as when two vehicles share one "
                "system id; give each its own and record again"
            )
    return tuple(Stretch(int(a), int(b) - 1) for a, b in pairwise(edges))


def longest(stretches: Sequence[Stretch]) -> Stretch:
    """Return the stretch with most rows; a jump of the clock would distort its length in
    seconds.
    """
    return max(stretches, key=lambda stretch: stretch.last - stretch.first)


def restarts(time_s: Floats, stretches: Sequence[Stretch]) -> tuple[tuple[float, float], ...]:
    """Return the times before and after, s, of every restart between the stretches."""
    return tuple((float(time_s[a.last]), float(time_s[b.first])) for a, b in pairwise(stretches))


def without_leaps(time_s: Floats) -> Floats:
    """Return `time_s` (n,), in file order, with outliers (damaged time fields) replaced by NaN.

    An outlier is more than FORWARD s from the median of the five times about it. Fewer than five
    times are returned unchanged.
    """
    step = np.diff(time_s)
    odd = np.flatnonzero((step < -BACKWARD) | (step > FORWARD))
    if time_s.size < 5 or odd.size == 0:
        return time_s
    # Only rows next to an odd step can be leaps; each is held against the median of five.
    rows = np.unique(np.clip(odd[:, None] + np.arange(-1, 3), 0, time_s.size - 1))
    # The first and last row have neighbours on one side only: two of five are their own time.
    centre = np.clip(rows, 1, time_s.size - 2)
    around = np.clip(centre[:, None] + np.arange(-2, 3), 0, time_s.size - 1)
    middle = np.median(time_s[around], axis=1)
    repaired = time_s.copy()
    repaired[rows[np.abs(time_s[rows] - middle) > FORWARD]] = np.nan
    return repaired


def pauses(time_s: Floats) -> tuple[tuple[float, float], ...]:
    """Return the start and length, s, of every pause longer than GAP."""
    ordered = time_s if (np.diff(time_s) >= 0.0).all() else np.sort(time_s, kind="stable")
    step = np.diff(ordered)
    late = np.flatnonzero(step > GAP)
    return tuple((float(ordered[i]), float(step[i])) for i in late)
