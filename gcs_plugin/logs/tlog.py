"""Read a telemetry log (.tlog) of MAVLink 1 or 2 frames into a Recording."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.logs.read import LogFormat
from thrustmargin.gcs_plugin.mavlink.decode import MAVLINK_RULES
from thrustmargin.gcs_plugin.mavlink.layouts import message_ids
from thrustmargin.gcs_plugin.mavlink.rules import Columns
from thrustmargin.gcs_plugin.mavlink.scan import PADDING, Frames, named, read_bytes, scan
from thrustmargin.gcs_plugin.mavlink.who_sends import (
    FLIGHT_DATA,
    GROUND_STATION,
    HEARTBEAT,
    copies,
    of_vehicles,
    two_of_one_id,
)
from thrustmargin.gcs_plugin.telemetry.clock import Clock, unix_minus_clock, vehicle_clocks
from thrustmargin.gcs_plugin.telemetry.flight_log import sorties_of
from thrustmargin.gcs_plugin.telemetry.recording import (
    FlightLog,
    LogQuality,
    NotThisFormat,
    Recording,
    damage_of,
    mission_item,
    pauses,
    serial_digits,
    several_autopilots,
)
from thrustmargin.gcs_plugin.telemetry.settings.pulse_range import sent_values
from thrustmargin.gcs_plugin.telemetry.signals import (
    Signals,
    Stream,
    hud_airspeed,
    mavlink_signals,
    pitot_present,
)
from thrustmargin.gcs_plugin.telemetry.vehicle_events import Options, parameter_events
from thrustmargin.gcs_plugin.wording.language import piece, printable
from thrustmargin.mission.plan_items import PlanItem
from thrustmargin.models.errors import LogError
from thrustmargin.models.flight import Bools
from thrustmargin.models.statement import Statement, state

AUTOPILOTS = {3: "ArduPilot", 12: "PX4"}
_OTHER = ("HEARTBEAT", "SYSTEM_TIME", "STATUSTEXT", "PARAM_VALUE", "SYS_STATUS")
_MISSION = ("MISSION_ITEM_INT", "MISSION_ITEM", "MISSION_COUNT", "MISSION_CLEAR_ALL")


def tlog_boots(
    path: Path, *, vehicle: int | None = None, on_arrival: bool = False
) -> Iterator[Recording]:
    """Yield a recording of one vehicle of a .tlog for each run of its clock between restarts.

    `vehicle` is a system id; None takes the one that reports rotor speeds, else the one with most
    frames. `on_arrival` dates each message as a live listener would. Raise LogError if there is no
    MAVLink in the file, no such vehicle, no time stamps, or two vehicles share the id.
    """
    data, size = read_bytes(path, PADDING)
    frames = scan(data, size)
    if frames.start.size == 0:
        raise NotThisFormat(
            f"{path.name}: no MAVLink frame in {size} bytes; is it a telemetry log (.tlog)?"
        )
    if frames.unstamped():
        raise LogError(
            f"{path.name}: its frames have no time stamps between them, as in a raw recording of a "
            "link; record a .tlog, which ground stations do by themselves"
        )
    notes: list[Statement] = []
    vehicles = vehicle_systems(frames)
    chosen = _choose(path, frames, vehicles, vehicle)
    repeated = copies(frames) & (frames.system == chosen)
    came_twice = int(np.count_nonzero(repeated))
    if came_twice:
        frames = frames.select(~repeated)
        notes.append(state("copies dropped", count=float(came_twice)))
    system, component = frames.system, frames.component
    mine = system == chosen
    rows, beats = named(frames, "HEARTBEAT", mine)
    # More than one are two aircraft with one system id, or a spare.
    autopilots = np.unique(component[rows[of_vehicles(beats)]]).tolist()
    pilot = _main_component(frames, mine, component, autopilots)
    if others := [number for number in autopilots if number != pilot]:
        mine &= ~np.isin(component, others)
        notes.append(several_autopilots(chosen, pilot, others))
    if note := two_of_one_id(frames, mine & (component == pilot)):
        raise LogError(
            f"{path.name}: it leaps between {note}, as when two vehicles share one system id; "
            "give each its own and record again"
        )
    clocks = vehicle_clocks(
        path.name,
        frames,
        mine & (component == pilot),
        frames.stamps_s(),
        listened=mine if on_arrival else None,
    )
    clock = next(clocks, None)
    while clock is not None:
        boot = _boot(path, frames, mine, pilot, clock, came_twice)
        boots = [replace(boot, vehicles=tuple(vehicles), notes=(*notes, *clock.notes))]
        # Neither the messages nor, behind the last restart, the file stay while a table is made.
        del boot
        clock = next(clocks, None)
        if clock is None:
            del data, frames, system, component, mine, repeated
        yield boots.pop()


def _boot(
    path: Path, frames: Frames, mine: Bools, pilot: int, clock: Clock, came_twice: int
) -> Recording:
    """Return the recording of one vehicle in one run of its clock.

    `mine` (n,) flags the vehicle's frames, `pilot` is its autopilot's component id, `came_twice`
    the number of copies dropped. Of a message that the autopilot sends, those of other components
    are left out. Unix time is by GPS, else by the log's stamps.
    """
    component, chosen = frames.component, int(frames.system[np.argmax(mine)])
    inside = mine.copy()
    inside[: clock.first_row] = False
    inside[clock.last_row + 1 :] = False
    # Before the messages are there: it takes room for a while.
    quality = LogQuality(
        bytes=frames.data.size - PADDING,
        frames=int(frames.start.size),
        bad_checksum=frames.bad_checksum,
        unknown_ids=frames.unknown_ids,
        copies=came_twice,
        frames_missing=_missing(component[inside], frames.sequence[inside]),
        **damage_of(frames.skipped, frames.start, clock.estimate_s),
        clock_jumps=clock.jumps,
        gaps=pauses(clock.estimate_s[inside]),
    )
    streams: dict[str, Stream] = {}
    for name in dict.fromkeys([rule.message for rule in MAVLINK_RULES] + list(_OTHER)):
        rows, fields = named(frames, name, inside)
        by_pilot = component[rows] == pilot
        if by_pilot.any():
            rows, fields = rows[by_pilot], fields[by_pilot]
        if rows.size:
            streams[name] = Stream(clock.times(fields, rows), fields)

    heart = streams.get("HEARTBEAT")
    kind = int(heart.columns["type"][-1]) if heart else None
    maker = int(heart.columns["autopilot"][-1]) if heart else -1

    parameters, whole = _parameters(frames, mine, clock.last_row)
    times, sent = streams.get("SYSTEM_TIME"), streams.get("PARAM_VALUE")
    values = () if sent is None else _named_values(sent.columns)
    sent_s = () if sent is None else sent.time_s.tolist()
    changes = tuple((time_s, *one) for time_s, one in zip(sent_s, values, strict=True))
    by_gps = None if times is None else unix_minus_clock(times.columns)
    return Recording(
        path=path,
        format="tlog",
        streams=streams,
        parameters=parameters,
        parameters_whole=whole,
        waypoints=_waypoints(frames, chosen, clock.last_row),
        messages=_texts(streams),
        events=tuple(parameter_events(changes)),
        parameters_sent=changes,
        unix_minus_clock=clock.stamp_minus_clock if by_gps is None else by_gps,
        quality=quality,
        vehicle=chosen,
        autopilot=AUTOPILOTS.get(maker, "unknown"),
        mav_type=kind,
        hardware_id=_hardware_id(frames, mine),
    )


def _hardware_id(frames: Frames, mine: Bools) -> str:
    """Return the serial number, hexadecimal, in the last AUTOPILOT_VERSION with one; else empty.

    `mine` (n,) flags the vehicle's frames. The longer number is preferred where a message has two.
    """
    for version in reversed(named(frames, "AUTOPILOT_VERSION", mine)[1]):
        long, short = version["uid2"].tobytes().hex(), version["uid"].tobytes().hex()
        if serial := serial_digits(long) or serial_digits(short):
            return serial
    return ""


def vehicle_systems(frames: Frames) -> list[int]:
    """Return the system ids with a heartbeat of a vehicle's autopilot, ascending.

    If the log has none: the ids that send flight data and are no ground station.
    """
    system = frames.system
    rows, beats = named(frames, "HEARTBEAT")
    flown = np.unique(system[rows[of_vehicles(beats)]])
    if not flown.size:
        stations = [255, *system[rows[beats["type"] == GROUND_STATION]].tolist()]
        flown = np.setdiff1d(system[np.isin(frames.id, FLIGHT_DATA)], stations)
    return flown.tolist()


def _choose(path: Path, frames: Frames, vehicles: list[int], number: int | None) -> int:
    if not vehicles:
        raise LogError(f"{path.name}: no autopilot sends in it; no vehicle was recorded")
    if number is not None:
        if number not in vehicles:
            there = ", ".join(map(str, vehicles))
            raise LogError(f"{path.name}: no vehicle {number}; it holds vehicle {there}")
        return number
    system = frames.system
    escs = [message_ids()[r.message] for r in MAVLINK_RULES if r.channel == "esc_rpm"]
    sends_rpm = np.isin(frames.id, escs)
    counts = np.bincount(system, minlength=256)
    rpms = np.bincount(system[sends_rpm], minlength=256)
    return max(vehicles, key=lambda s: (rpms[s] > 0, counts[s]))


def _main_component(
    frames: Frames, mine: Bools, component: NDArray[np.uint8], autopilots: list[int]
) -> int:
    """Return the component id of a vehicle's autopilot, the one that sends most ATTITUDE.

    Without ATTITUDE, most GLOBAL_POSITION_INT; both first among `autopilots`, then among all frames
    that `mine` (n,) flags. If nobody sends either: the first of `autopilots`, else the sender of
    most HEARTBEAT, else of most frames. `component` (n,) are the frames' component ids.
    """
    for candidates in (mine & np.isin(component, autopilots), mine):
        for name in ("ATTITUDE", "GLOBAL_POSITION_INT"):
            sources = component[candidates & (frames.id == message_ids()[name])]
            if sources.size:
                return int(np.bincount(sources).argmax())
    if autopilots:
        return autopilots[0]
    sources = component[mine & (frames.id == HEARTBEAT)]
    return int(np.bincount(sources if sources.size else component[mine]).argmax())


def _parameters(frames: Frames, mine: Bools, last_row: int) -> tuple[dict[str, float], bool]:
    """Return the parameters' last values up to frame `last_row` by name, and if all are there.

    A parameter sent only after that frame has its first value. `mine` (n,) flags the vehicle's
    frames.
    """
    rows, fields = named(frames, "PARAM_VALUE", mine)
    fields = np.concatenate([fields[rows > last_row][::-1], fields[rows <= last_row]])
    values = dict(_named_values(fields))
    return values, 0 < int(fields["param_count"].max(initial=0)) <= len(values)


def _named_values(fields: Columns | NDArray[np.void]) -> Iterator[tuple[str, float]]:
    """Yield name and value of each PARAM_VALUE, whose fields (n,) `fields` maps by name."""
    values = sent_values(fields["param_value"], fields["param_type"])
    for name, value in zip(fields["param_id"], values.tolist(), strict=True):
        yield printable(name), value


def _waypoints(frames: Frames, chosen: int, last_row: int) -> tuple[PlanItem, ...]:
    """Return the mission last transferred completely up to frame `last_row`, in order.

    Empty if there was none. `chosen` is the vehicle's system id. An item whose MISSION_COUNT was
    not received replaces the known item of its number.
    """
    system = frames.system
    events: list[tuple[int, str, np.void]] = []
    for name in _MISSION:
        rows, fields = named(frames, name, np.arange(frames.id.size) <= last_row)
        concerns = (system[rows] == chosen) | (fields["target_system"] == chosen)
        for k in np.flatnonzero(concerns & (fields["mission_type"] == 0)).tolist():
            events.append((int(rows[k]), name, fields[k]))
    mission: dict[int, PlanItem] = {}
    arriving: dict[int, PlanItem] = {}
    expected = 0
    for _, name, fields in sorted(events, key=lambda event: event[0]):
        if name in ("MISSION_COUNT", "MISSION_CLEAR_ALL"):
            expected = int(fields["count"]) if name == "MISSION_COUNT" else 0
            arriving, mission = {}, mission if expected else {}
            continue
        waypoint = mission_item(name, fields)
        (arriving if expected else mission)[waypoint.number] = waypoint
        if expected and len(arriving) == expected:
            arriving, mission, expected = {}, arriving, 0
    return tuple(mission[number] for number in sorted(mission))


def _texts(streams: dict[str, Stream]) -> tuple[tuple[float, str], ...]:
    """Return (time in s, text) of each STATUSTEXT; pieces of a long text are joined. Empty without
    such a message."""
    stream = streams.get("STATUSTEXT")
    if stream is None:
        return ()
    lines: list[tuple[float, str]] = []
    open_id = 0
    fields = (stream.columns[name] for name in ("text", "id", "chunk_seq"))
    for time, raw, number, turn in zip(stream.time_s.tolist(), *fields, strict=True):
        if turn > 0 and number and number == open_id:
            lines[-1] = (lines[-1][0], lines[-1][1] + piece(raw))
        else:
            lines.append((time, piece(raw)))
        open_id = number
    return tuple((time, text.strip()) for time, text in lines)


def _missing(component: NDArray[np.uint8], sequence: NDArray[np.uint8]) -> int:
    """Count the frames missing by sequence number, from `component` and `sequence` (n,).

    They are in file order. Each component counts its own frames. A step back is a late frame and
    counts as none.
    """
    lost = 0
    for sender in np.unique(component):
        step = np.diff(sequence[component == sender].astype(np.int16)) % 256
        # A step back is a late or doubled frame, not 200 lost ones.
        lost += int(np.sum(np.where((step > 1) & (step < 128), step - 1, 0)))
    return lost


def _read(path: Path, vehicle: int | None, options: Options) -> tuple[FlightLog, ...]:
    boots = tlog_boots(path, vehicle=vehicle, on_arrival=options.sampling == "hold")
    return sorties_of(map(_with_signals, boots), options)


def _with_signals(recording: Recording) -> tuple[Recording, Signals]:
    pitot = pitot_present(recording.streams, recording.parameters)
    airspeed = hud_airspeed(recording.autopilot, pitot)
    return replace(recording, streams={}), mavlink_signals(dict(recording.streams), airspeed)


#: Any file that is no text may be one: only a search of the whole finds its frames.
FORMAT = LogFormat(
    name="tlog",
    known_by="MAVLink frames (.tlog)",
    suffixes=(".tlog",),
    likeness=lambda begins: 0.5 if begins.text is None else 0.0,
    read=_read,
)
