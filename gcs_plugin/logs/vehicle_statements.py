"""Compare what a vehicle reported of itself with what its log shows: thrust, motors, ESCs, control.

A report is evidence, not the truth: ArduPilot names the motor with the highest output, and a crash
check may trip on the ground. Reports of one kind and one motor are one statement, with their times.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from thrustmargin.gcs_plugin.telemetry.vehicle_events import EventKind, VehicleEvent
from thrustmargin.models.checks.loss_of_control import LossOfControl
from thrustmargin.models.checks.motor_evidence import MotorEvidence, motor_evidence
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.model.rotor_faults import FaultEpisode
from thrustmargin.models.physics.smoothing import known_mean

#: s by which a fault that the program finds may begin or end before or after the report.
NEAR_S = 30.0
#: s within which an error code and a text are one report.
TOGETHER_S = 1.0
#: s about a report over which the yaw authority is a mean: ArduPilot's check filters over seconds.
YAW_S = 5.0
_OF_MOTORS = (EventKind.THRUST_LOSS, EventKind.MOTOR_FAILURE, EventKind.ESC_FAILURE)
_OF_CONTROL = (
    EventKind.CRASH,
    EventKind.LOST_CONTROL,
    EventKind.TERMINATED,
    EventKind.ATTITUDE_FAILURE,
)
_NO_REPORT = (EventKind.ARMED, EventKind.DISARMED, EventKind.RESOLVED, EventKind.PARAMETER)


class Corroboration(StrEnum):
    """How the log confirms or contradicts a report of the vehicle."""

    AGREES = "agrees"  # the same motor by speeds
    OTHER_MOTOR = "other motor"  # another one by speeds
    MOTOR_FOUND = "motor found"  # the report names none, the log does
    EXCHANGED = "exchanged"  # two motors each follow the output of the other: no name is sure
    ALL_HARD = "all hard"  # all motors near full output, none more than the others
    HARDEST = "hardest"  # the named motor works hardest, and its speed follows
    FOLLOWS = "follows"  # speed of the named motor follows its output
    CONTROL_LOST = "control lost"
    CONTROL_KEPT = "control kept"
    YAW = "yaw"  # the yaw authority that was left
    NOT_COMPARED = "not compared"  # without speeds and outputs
    NOTHING = "nothing"  # the program has no view of it


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleStatement:
    """A vehicle's report, or several alike, with what its log shows of the fault; motors from 0."""

    kind: EventKind
    subject: str
    text: str  # as it was sent
    times_s: tuple[float, ...]  # s from the first row, in order
    named: tuple[int, ...]  # motors that it names
    corroboration: Corroboration
    found: tuple[int, ...] = ()  # motors that the log shows
    value: float = math.nan  # output of the named motor, or share of the yaw authority


def vehicle_statements(
    events: Iterable[VehicleEvent],
    track: FlightTrack,
    *,
    faults: Sequence[FaultEpisode] = (),
    losses: Sequence[LossOfControl] = (),
    yaw_reserve: Floats | None = None,
) -> tuple[VehicleStatement, ...]:
    """Return the vehicle's reports in order of their first time, each compared with its log.

    Arming, disarming, resolved faults and parameters are no reports. `faults` and `losses` are
    those found in the flight; `yaw_reserve` (T,) is the unused share of yaw authority, None without
    airframe.
    """
    alike: dict[tuple[EventKind, str], list[VehicleEvent]] = {}
    for event in events:
        if event.kind not in _NO_REPORT:
            alike.setdefault((event.kind, event.subject), []).append(event)
    groups = [same for same in alike.values() if not _doubled(same, alike.values())]
    made = [_statement(same, track, faults, losses, yaw_reserve) for same in groups]
    return tuple(sorted(made, key=lambda one: one.times_s[0]))


def _doubled(same: Sequence[VehicleEvent], groups: Iterable[Sequence[VehicleEvent]]) -> bool:
    """Return True if each event of `same` is an error code that only repeats a text.

    The text must be of the same kind, in any of `groups`, and within TOGETHER_S. An error code's
    event has a text that begins with "ERR ".
    """
    if not all(event.text.startswith("ERR ") for event in same):
        return False
    texts = [
        event.time_s
        for other in groups
        for event in other
        if event.kind is same[0].kind and not event.text.startswith("ERR ")
    ]
    return all(any(abs(e.time_s - when) <= TOGETHER_S for when in texts) for e in same)


def _statement(
    same: Sequence[VehicleEvent],
    track: FlightTrack,
    faults: Sequence[FaultEpisode],
    losses: Sequence[LossOfControl],
    yaw_reserve: Floats | None,
) -> VehicleStatement:
    """Compare the vehicle's events `same` with the log at the time of the first of them.

    They are of one kind and one subject. `faults` and `losses` are those found in the flight;
    `yaw_reserve` (T,) is the unused share of yaw authority, None without airframe.
    """
    first = same[0]
    named = ()
    if first.kind in _OF_MOTORS and first.subject.isdigit():
        motor = int(first.subject) - 1
        named = (motor,) if 0 <= motor < track.rotor_count else ()
    corroboration, found, value = Corroboration.NOTHING, (), math.nan
    if first.kind in _OF_MOTORS or first.kind is EventKind.IMBALANCE:
        corroboration, found, value = _of_motors(first.time_s, named, track, faults)
    elif first.kind in _OF_CONTROL:
        corroboration = Corroboration.CONTROL_LOST if losses else Corroboration.CONTROL_KEPT
    elif first.kind is EventKind.YAW_IMBALANCE:
        corroboration, value = _of_yaw(first.time_s, track, yaw_reserve)
    return VehicleStatement(
        kind=first.kind,
        subject=first.subject,
        text=first.text,
        times_s=tuple(event.time_s for event in same),
        named=named,
        corroboration=corroboration,
        found=found,
        value=value,
    )


def _of_motors(
    time_s: float, named: tuple[int, ...], track: FlightTrack, faults: Sequence[FaultEpisode]
) -> tuple[Corroboration, tuple[int, ...], float]:
    """Compare a report at `time_s`, s, with the log; `named` are the motors it names, from 0.

    Return the result, the motors that the log shows as faulty or exchanged, and the output, 0 to 1,
    of the first named motor (NaN without one). Without a fault or an exchange the motors are empty,
    and the result says if motors could be compared, if all outputs were high, or if the named one
    was the highest.
    """
    seen = motor_evidence(track, time_s)
    value = seen.outputs[named[0]] if named else math.nan
    found = _found(time_s, seen, faults)
    if found and named:
        same = set(named) & set(found)
        return (Corroboration.AGREES if same else Corroboration.OTHER_MOTOR), found, value
    if found:
        return Corroboration.MOTOR_FOUND, found, value
    if seen.exchanged:
        return Corroboration.EXCHANGED, seen.exchanged, value
    if not seen.compared:
        return Corroboration.NOT_COMPARED, (), value
    if seen.all_hard:
        return Corroboration.ALL_HARD, (), value
    if named and seen.highest == named[0]:
        return Corroboration.HARDEST, (), value
    return Corroboration.FOLLOWS, (), value


def _found(time_s: float, seen: MotorEvidence, faults: Sequence[FaultEpisode]) -> tuple[int, ...]:
    """Return the faulty motors, from 0, at `time_s`, s; empty if the log shows none.

    They are those of the first fault episode within NEAR_S of it; else the motors that stand still
    by `seen`; else the slow motor, if exactly one is slow.
    """
    for episode in faults:
        end_s = math.inf if episode.end_s is None else episode.end_s
        if episode.begin_s - NEAR_S <= time_s <= end_s + NEAR_S:
            return tuple(episode.fault.rotors) or (episode.fault.rotor,)
    if seen.stands:
        return seen.stands
    # Of several that are slow, all may follow an output that one of them does not.
    return seen.slow if len(seen.slow) == 1 else ()


def _of_yaw(
    time_s: float, track: FlightTrack, yaw_reserve: Floats | None
) -> tuple[Corroboration, float]:
    """Return YAW and the mean unused yaw authority, 0 to 1, in flight within YAW_S of `time_s`, s.

    NOT_COMPARED and NaN where it is unknown. `yaw_reserve` (T,) is on the track's rows.
    """
    if yaw_reserve is None:
        return Corroboration.NOT_COMPARED, math.nan
    near = np.abs(track.time_s - time_s) <= YAW_S
    value = known_mean(yaw_reserve[near & track.flying])
    return (Corroboration.YAW if math.isfinite(value) else Corroboration.NOT_COMPARED), value
