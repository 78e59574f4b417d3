"""Provide the channels that a user states, and the events that a vehicle reports.

Stated channels: load, air temperature, and the empty tank of an aircraft without one. A stated load
replaces every gauge. From its start it falls by the amount the pump's output has delivered. A
stated end scales the fall to reach it; without a pump the load falls evenly over the time of
spraying, else of flight. A listener does not know the end of the flight: there only the pump lowers
the load, and the stated end is its lower bound.

Events: reports of faults, failsafes and arming, classified once. Texts are matched by the fixed
beginnings that ArduPilot and PX4 send; errors of DataFlash logs by ArduPilot's table of subsystems
(libraries/AP_Logger/AP_Logger.h, LogErrorSubsystem).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import lru_cache
from types import MappingProxyType

import numpy as np

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.signals import Sampling, known_rows
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import STATED_TEMPERATURE_ERROR
from thrustmargin.models.provenance import Provenance, SourceKind, stated
from thrustmargin.models.statement import Statement, state

LONGEST_STEP = 2.0  # s between rows beyond which nothing is summed up


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """The options of reading a log; see `logs.read_sorties`."""

    airframe: Airframe | None = None
    sampling: Sampling = "linear"
    tank: str = "auto"
    tank_start_kg: float | None = None
    load: float | None = None  # kg
    load_end: float | None = None  # kg
    air_temperature: float | None = None  # K


def stated_channels(
    options: Options,
    *,
    time_s: Floats,
    flying: Bools,
    spraying: Floats,
    pumped_kg: Floats,
) -> Iterator[tuple[str, Floats, Provenance, Floats | None]]:
    """Yield name, values (T,), source, standard error (T,) of channels that `options` state:
    "tank_kg", kg, and the outside "temperature", K.

    A stated load falls by the pump's output, else by spraying time, else by flight time. `time_s`
    and `flying` (T,) are the rows'. `spraying` (T,) is 1 while the pump runs, `pumped_kg` (T,) the
    sum of its output; both NaN where unknown. The error of the load is None. An aircraft without a
    tank carries 0 kg whatever a gauge reports, unless `options` name the gauge.
    """
    rows = time_s.size
    if options.load is not None:
        step = np.minimum(np.diff(time_s, prepend=time_s[:1]), LONGEST_STEP)
        sums = {
            "the pump's output": np.maximum.accumulate(np.nan_to_num(pumped_kg)),
            "the time of spraying": np.cumsum(step * (spraying == 1.0)),
            "the time of flight": np.cumsum(step * flying),
        }
        load, remark = _load(options, options.load, sums)
        yield "tank_kg", load, stated(remark), None
    elif no_tank(options) and (craft := options.airframe) is not None:
        tankless = Provenance(
            kind=SourceKind.AIRFRAME, name=craft.name, remarks=(state("without a tank"),)
        )
        yield "tank_kg", np.zeros(rows), tankless, None
    if options.air_temperature is not None:
        outside = stated(state("outside", celsius=options.air_temperature - 273.15))
        error = np.full(rows, STATED_TEMPERATURE_ERROR)
        yield "temperature", np.full(rows, options.air_temperature), outside, error


def no_tank(options: Options) -> bool:
    """Return True if the airframe has no tank and `options` name no gauge."""
    craft = options.airframe
    return craft is not None and craft.tank_volume_l == 0.0 and options.tank in ("auto", "none")


def stated_track(track: FlightTrack, options: Options) -> FlightTrack:
    """Return a table's track with the channels replaced that the user stated in `options`.

    A `tank` of "none" makes the tank level NaN.
    """
    unknown = np.full(track.time_s.size, np.nan)
    sources, errors = dict(track.sources), dict(track.standard_errors)
    arrays: dict[str, Floats] = {}
    if options.tank.strip().lower() == "none":
        arrays["tank_kg"] = unknown
    for channel, values, source, error in stated_channels(
        options,
        time_s=track.time_s,
        flying=track.flying,
        spraying=track.spraying,
        pumped_kg=unknown,
    ):
        arrays[channel], sources[channel] = values, source
        if error is not None:
            errors[channel] = error
    return replace(track, sources=sources, standard_errors=errors, **arrays)


def _load(options: Options, start: float, sums: dict[str, Floats]) -> tuple[Floats, Statement]:
    """Return the load (T,), kg, from `start` kg on, and a remark on how it falls.

    `sums` (T,) are quantities that grow as the load falls. With a stated end in a recorded flight
    it falls to that with the first sum that is above 0 at the last row; else by the mass pumped, to
    the stated end or 0 at least; constant if nothing was pumped.
    """
    end = options.load_end
    pump = sums["the pump's output"]
    if end is not None and options.sampling == "linear":
        for cause, total in sums.items():
            if total[-1] > 0.0:
                load = start - (start - end) * total / total[-1]
                return load, state("load falls to", load=start, cause=cause, end=end)
    elif pump[-1] > 0.0 or end is not None:
        least = 0.0 if end is None else end
        limit = () if end is None else ("at least",)
        return np.maximum(start - pump, least), state("load falls", *limit, load=start, end=least)
    return np.full(pump.size, start), state("load constant", load=start)


class EventKind(StrEnum):
    """The kind of a vehicle's report."""

    CRASH = "crash"
    LOST_CONTROL = "lost control"
    TERMINATED = "flight terminated"
    ATTITUDE_FAILURE = "attitude failure"
    THRUST_LOSS = "thrust loss"
    YAW_IMBALANCE = "yaw imbalance"
    MOTOR_FAILURE = "motor failure"
    ESC_FAILURE = "ESC failure"
    IMBALANCE = "propeller imbalance"
    BATTERY = "battery failsafe"
    RADIO = "radio failsafe"
    GCS = "ground station failsafe"
    EKF = "estimator"
    GPS = "GPS"
    COMPASS = "compass"
    BAROMETER = "barometer"
    SENSORS = "sensors failsafe"
    VIBRATION = "vibration"
    FENCE = "fence"
    TERRAIN = "terrain"
    FLIGHT_MODE = "flight mode"
    INTERNAL = "internal error"
    OTHER = "other"
    PARAMETER = "parameter changed"
    RESOLVED = "resolved"  # what the subject is was over
    ARMED = "armed"
    DISARMED = "disarmed"


@dataclass(frozen=True, slots=True)
class VehicleEvent:
    """An event that the vehicle reported; `subject` is the motor number or part, empty without one.

    `text` is as the vehicle sent it, empty if the report was no text.
    """

    kind: EventKind
    time_s: float
    subject: str = ""
    text: str = ""


#: Subsystem of an ERR message -> kind and the name of the part.
_SUBSYSTEMS: Mapping[int, tuple[EventKind, str]] = MappingProxyType(
    {
        2: (EventKind.RADIO, "radio"),
        3: (EventKind.COMPASS, "compass"),
        5: (EventKind.RADIO, "radio failsafe"),
        6: (EventKind.BATTERY, "battery failsafe"),
        7: (EventKind.GPS, "GPS failsafe"),
        8: (EventKind.GCS, "ground station failsafe"),
        9: (EventKind.FENCE, "fence failsafe"),
        10: (EventKind.FLIGHT_MODE, "flight mode"),
        11: (EventKind.GPS, "GPS"),
        12: (EventKind.CRASH, "crash check"),
        15: (EventKind.OTHER, "parachute"),
        16: (EventKind.EKF, "EKF check"),
        17: (EventKind.EKF, "EKF failsafe"),
        18: (EventKind.BAROMETER, "barometer"),
        19: (EventKind.INTERNAL, "CPU"),
        20: (EventKind.OTHER, "ADSB failsafe"),
        21: (EventKind.TERRAIN, "terrain"),
        22: (EventKind.FLIGHT_MODE, "navigation"),
        23: (EventKind.TERRAIN, "terrain failsafe"),
        24: (EventKind.EKF, "EKF primary core"),
        25: (EventKind.THRUST_LOSS, "thrust loss check"),
        26: (EventKind.SENSORS, "sensors failsafe"),
        27: (EventKind.SENSORS, "leak failsafe"),
        29: (EventKind.VIBRATION, "vibration failsafe"),
        30: (EventKind.INTERNAL, "internal error"),
        31: (EventKind.EKF, "dead reckoning failsafe"),
    }
)
_CRASH_CHECK, _CONTROL_LOST, _EKF_PRIMARY = 12, 2, 24
#: How a text begins, in small letters after any [module] of PX4 -> kind; the first group is the
#: subject.
_BEGINNINGS: tuple[tuple[re.Pattern[str], EventKind], ...] = tuple(
    (re.compile(pattern), kind)
    for pattern, kind in (
        (r"potential thrust loss \((\d+)\)", EventKind.THRUST_LOSS),
        (r"yaw imbalance", EventKind.YAW_IMBALANCE),
        (r"crash: disarming", EventKind.CRASH),
        (r"parachute: crash|crash:", EventKind.CRASH),
        (r"battery (\d+)? ?(?:is )?(?:low|critical|failsafe)", EventKind.BATTERY),
        (r"battery failsafe|low battery|critical battery|emergency battery", EventKind.BATTERY),
        (r"critically low battery|dangerously low battery", EventKind.BATTERY),
        (r"vibration compensation on", EventKind.VIBRATION),
        (r"vibration compensation off", EventKind.RESOLVED),
        (r"radio failsafe cleared|gcs failsafe cleared|ekf failsafe cleared", EventKind.RESOLVED),
        (r"radio failsafe|manual control lost|rc lost|no manual control", EventKind.RADIO),
        (
            r"gcs failsafe|data link lost|connection to ground (?:station|control) lost",
            EventKind.GCS,
        ),
        (r"ekf failsafe|ekf variance|emergency yaw reset", EventKind.EKF),
        (r"ekf primary changed", EventKind.EKF),
        (r"gps glitch cleared", EventKind.RESOLVED),
        (r"gps glitch", EventKind.GPS),
        (r"critical failure detected: terminate", EventKind.TERMINATED),
        (r"flight termination|terminating", EventKind.TERMINATED),
        (r"attitude failure|critical failure detected: (?:roll|pitch)", EventKind.ATTITUDE_FAILURE),
        (r"motor failure detected|(?:esc|motor) (?:#?(\d+) )?failure", EventKind.THRUST_LOSS),
        (r"internal errors?", EventKind.INTERNAL),
        (r"fence breach", EventKind.FENCE),
    )
)
_MODULE = re.compile(r"^\[[^\]]*\]\s*")


def text_events(messages: Iterable[tuple[float, str]]) -> Iterator[VehicleEvent]:
    """Yield the event of each text with a known beginning, at its time; ignore other texts."""
    for time_s, text in messages:
        if event := _event_in(text):
            yield VehicleEvent(event[0], time_s, event[1], text)


@lru_cache(maxsize=4096)  # a log repeats the same text many times
def _event_in(text: str) -> tuple[EventKind, str] | None:
    """Return the kind and subject of a text; None if its beginning is unknown."""
    lowered = _MODULE.sub("", text.lower()).strip()
    for pattern, kind in _BEGINNINGS:
        if match := pattern.match(lowered):
            return kind, match[1] if match.re.groups and match[1] else ""
    return None


#: Beginnings of the parameters that thrust, load and voltage are worked out by; the last is learnt
#: by the autopilot in every flight.
_WORKED_BY = ("MOT_", "SERVO", "FRAME_", "BATT", "SPRAY_", "CA_", "PWM_", "THR_MDL")
_LEARNT = "MOT_THST_HOVER"


def parameter_events(
    changes: Iterable[tuple[float, str, float]], *, first: bool = False
) -> Iterator[VehicleEvent]:
    """Yield an event for each change of a parameter that affects results.

    `changes` are (s, name, value) in order of time; the first value of each is no change. `first`:
    the event's text says that the log is read with the first value instead of the last.
    """
    known: dict[str, float] = {}
    which = "first" if first else "last"
    for time_s, name, value in changes:
        if change := parameter_change(name, known.get(name, value), value):
            text = f"{change}; the whole log is read by the {which}"
            yield VehicleEvent(EventKind.PARAMETER, time_s, name, text)
        known[name] = value


def parameter_change(name: str, before: float, value: float) -> str:
    """Return a change as `0.15 to 0.5`; empty without one, or for a parameter that affects no
    result.
    """
    if not abs(value - before) > 0.0 or not name.startswith(_WORKED_BY) or name == _LEARNT:
        return ""
    return f"{before:g} to {value:g}"


def error_events(time_s: Floats, subsystem: Floats, code: Floats) -> Iterator[VehicleEvent]:
    """Yield the event of each ArduPilot ERR message, from columns (n,); rows with NaN are ignored.

    Code 0 is the end of an error: its event is RESOLVED.
    """
    for when, part, number in zip(time_s.tolist(), subsystem.tolist(), code.tolist(), strict=True):
        if not np.isfinite([when, part, number]).all():
            continue
        kind, subject = _SUBSYSTEMS.get(int(part), (EventKind.OTHER, f"subsystem {part:.0f}"))
        if number == 0 and int(part) != _EKF_PRIMARY:
            kind = EventKind.RESOLVED
        elif (int(part), number) == (_CRASH_CHECK, _CONTROL_LOST):
            kind = EventKind.LOST_CONTROL
        yield VehicleEvent(kind, when, subject, f"ERR {part:.0f} {number:.0f}")


def flag_events(
    kind: EventKind, time_s: Floats, flags: Floats, subject: str, text: str
) -> Iterator[VehicleEvent]:
    """Yield an event of `kind` about `subject` at each report in which a flag is newly set.

    The bits of `flags` (n,) are the flags, NaN without a report, at `time_s` (n,), s. The event's
    text is `text` with the flags in hexadecimal digits.
    """
    before = 0
    for when, value in zip(time_s.tolist(), flags.tolist(), strict=True):
        if not np.isfinite(value):
            continue
        now = int(value)
        if now & ~before:
            yield VehicleEvent(kind, when, subject, f"{text} 0x{now:x}")
        before = now


def arming_events(armed: Signal | None) -> Iterator[VehicleEvent]:
    """Yield an event at each change between armed and disarmed; none without a signal.

    Values of `armed` above 0 are armed; NaN is ignored.
    """
    if armed is None:
        return
    known = known_rows(armed.values)
    state, time_s = armed.values[known] > 0, armed.time_s[known]
    for row in (np.flatnonzero(state[1:] != state[:-1]) + 1).tolist():
        yield VehicleEvent(
            EventKind.ARMED if state[row] else EventKind.DISARMED, float(time_s[row])
        )
