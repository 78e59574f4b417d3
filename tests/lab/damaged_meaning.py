"""Flights whose meaning is damaged, and what a report says of them.

    python -m tests.lab.damaged_meaning                       a table of 300 flights, and the bad
    python -m tests.lab.damaged_meaning --seeds 1 5           of seeds 1 to 5
    python -m tests.lab.damaged_meaning --only 1:17 --keep D  one flight again, its file kept in D

Every file is whole and every message valid, but one or two of its instruments do not tell the
truth: a gauge shows half, an ESC repeats another's speed, a voltage stands still. What is true is
what the report says of the sound flight, with what is known of how that was recorded. A report of
a damaged flight is scored by its JSON; a doubt is a line in print that the sound flight's lacks:

- green: level under or near without a doubt, with a fill or a ratio of one rotor lost above the
  truth's interval, or where the truth has a graver level
- blamed: a sound rotor, or an instrument that is right, is named surely (not as "or its ESC")
- missed: level under or near without a doubt, where a rotor is weak; fill and ratio are not wrong
- emergency: a level of emergency that the sound flight does not have
- silent: a fill or a ratio above the truth's interval without a doubt, at a graver level
- doubted: green, missed or silent but for a doubt
- cautious: a graver level, or a fill or a ratio below the truth's interval
- no_verdict: no margin is claimed, or no level; or the file is refused
- right: none of these
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import io
import json
import re
import struct
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from thrustmargin.gcs_plugin.cli import run

LOGS = Path(__file__).parents[2] / "sitl_logs"
FLIGHTS = 300
#: Base flight -> its weak rotors, from 1, by how it was recorded (sitl_logs/manifest.toml).
BASES: Mapping[str, frozenset[int]] = {
    "campaign/v4_m16_q2.5": frozenset(),  # heavy: with one rotor lost it holds 0.92 of its weight
    "campaign/v6_m16_q3.5": frozenset(),
    "campaign/v2_m16_q1.5": frozenset(),
    "campaign/v4_m10_q2.5": frozenset(),
    "campaign/v4_m4_q2.5": frozenset(),  # light
    "campaign/v6_m4_q3.5": frozenset(),
    "dev/windy_1": frozenset(),
    "dev/cg_forward_2": frozenset(),
    "dev/high_altitude_1": frozenset(),
    "dev/worn_prop_1": frozenset({1}),
    "dev/worn_prop_2": frozenset({1}),
    "onset/worn_prop_onset": frozenset({3}),
}
ROTORS = 4
#: Messages that a damage changes; others pass as they are.
DAMAGED_MESSAGES = {
    *("ATTITUDE", "BATTERY_STATUS", "ESC_TELEMETRY_1_TO_4", "GLOBAL_POSITION_INT", "GPS_RAW_INT"),
    *("NAMED_VALUE_FLOAT", "RAW_IMU", "SCALED_PRESSURE", "SERVO_OUTPUT_RAW", "SYS_STATUS"),
    *("SYSTEM_TIME", "VFR_HUD", "WIND"),
}

Message = Any
#: Changes a message at a time in s from the log's start, in place; False drops it.
Edit = Callable[[Message, float], bool]


# --- what is damaged


@dataclass(frozen=True, slots=True)
class Damage:
    """What is wrong of a flight: the `part` that does not tell the truth, and the `edit` for it.

    `rotors` are those (from 1) whose telemetry is wrong.
    """

    name: str
    part: str
    edit: Edit
    rotors: frozenset[int] = frozenset(range(1, ROTORS + 1))


def _gauge(name: str, change: Callable[[float, float], float | None]) -> Damage:
    def edit(message: Message, time_s: float) -> bool:
        if message.get_type() == "BATTERY_STATUS":
            return message.id != 1  # a second gauge of the same tank
        if message.get_type() != "NAMED_VALUE_FLOAT" or message.name != "TANK":
            return True
        changed = change(message.value, time_s)
        message.value = message.value if changed is None else changed
        return changed is not None

    return Damage(name, "gauge", edit, frozenset())


def _speeds(
    name: str,
    change: Callable[[list[float], float], Sequence[float] | None],
    rotors: Sequence[int] = (1, 2, 3, 4),
) -> Damage:
    def edit(message: Message, time_s: float) -> bool:
        if message.get_type() != "ESC_TELEMETRY_1_TO_4":
            return True
        changed = change([float(rpm) for rpm in message.rpm], time_s)
        if changed is not None:
            message.rpm = [int(np.clip(round(rpm), 0, 65535)) for rpm in changed]
        return changed is not None

    return Damage(name, "rotor speeds", edit, frozenset(rotors))


def _voltage(name: str, change: Callable[[float, float], float]) -> Damage:
    """Damage the battery's voltage in V wherever it is reported, and the ESCs' beside it."""

    def edit(message: Message, time_s: float) -> bool:
        kind = message.get_type()
        if kind == "BATTERY_STATUS" and message.id == 0:
            whole = sum(v for v in message.voltages if v < 65535)
            factor = change(whole / 1e3, time_s) * 1e3 / max(whole, 1)
            message.voltages = [v if v == 65535 else round(v * factor) for v in message.voltages]
        elif kind == "SYS_STATUS":
            message.voltage_battery = round(change(message.voltage_battery / 1e3, time_s) * 1e3)
        elif kind == "ESC_TELEMETRY_1_TO_4":
            message.voltage = [round(change(v / 100, time_s) * 100) for v in message.voltage]
        return True

    return Damage(name, "voltage", edit, frozenset())


def _fields(name: str, part: str, kinds: Mapping[str, Callable[[Message, float], bool]]) -> Damage:
    def edit(message: Message, time_s: float) -> bool:
        change = kinds.get(message.get_type())
        return True if change is None else change(message, time_s)

    return Damage(name, part, edit, frozenset())


def _swapped(values: Sequence[float], one: int, other: int) -> list[float]:
    """Return `values` with those of two rotors, from 1, swapped."""
    found = list(values)
    found[one - 1], found[other - 1] = found[other - 1], found[one - 1]
    return found


class Held:
    """Holds the value that came last before `from_s`; before that time values pass."""

    def __init__(self, from_s: float) -> None:
        self.from_s, self.value = from_s, None

    def __call__(self, value: Any, time_s: float) -> Any:
        if time_s < self.from_s or self.value is None:
            self.value = value
        return self.value


def _gauges(rng: np.random.Generator) -> Iterator[Damage]:
    stuck, mixed = rng.uniform(2.0, 12.0, 2)
    yield _gauge("g_half", lambda kg, _: kg / 2)
    yield _gauge("g_stuck", lambda *_: stuck)
    yield _gauge("g_stuck_dither", lambda *_: mixed + rng.uniform(-0.05, 0.05))
    yield _gauge("g_plus3", lambda kg, _: kg + 3.0)
    yield _gauge("g_x07", lambda kg, _: kg * 0.7)
    yield _gauge("g_none", lambda *_: None)


def _rotor_speeds(rng: np.random.Generator) -> Iterator[Damage]:
    for factor in (0.9, 0.95, 1.05, 1.1):
        name = f"r_x{factor:.2f}".replace(".", "")
        yield _speeds(name, lambda rpm, _, factor=factor: [factor * n for n in rpm])
    one, other = (int(k) for k in rng.permutation(ROTORS)[:2] + 1)
    yield _speeds(
        f"r_one104_{one}",
        lambda rpm, _: [n * (1.04 if k == one else 1.0) for k, n in enumerate(rpm, 1)],
        (one,),
    )
    yield _speeds(
        f"r_copy{other}to{one}",
        lambda rpm, _: [rpm[other - 1] if k == one else n for k, n in enumerate(rpm, 1)],
        (one,),
    )
    yield _speeds(f"r_swap{one}{other}", lambda rpm, _: _swapped(rpm, one, other), (one, other))
    for share in (5, 16):
        yield _speeds(
            f"r_noise{share}",
            lambda rpm, _, share=share: list(
                np.array(rpm) * (1 + share / 100 * rng.normal(size=ROTORS))
            ),
        )
    sent = Held(0.0)

    def seldom(rpm: list[float], time_s: float) -> list[float] | None:
        if sent.value is not None and time_s - sent.value < 1 / 3:
            return None
        sent.value = time_s
        return rpm

    yield _speeds("r_3hz", seldom)
    yield _speeds("r_steps250", lambda rpm, _: [250 * round(n / 250) for n in rpm])
    yield _speeds("r_none", lambda *_: None)
    yield _speeds("r_frozen", Held(rng.uniform(60.0, 110.0)))


def _voltages(rng: np.random.Generator) -> Iterator[Damage]:
    yield _voltage("v_x104", lambda volt, _: volt * 1.04)
    yield _voltage("v_x095", lambda volt, _: volt * 0.95)
    yield _voltage("v_frozen", lambda *_: 58.6)
    yield _voltage("v_frozen_dither", lambda *_: 58.6 + rng.uniform(-0.03, 0.03))


def _others(rng: np.random.Generator) -> Iterator[Damage]:
    one, other = (int(k) for k in rng.permutation(ROTORS)[:2] + 1)

    def swap_outputs(message: Message, _: float = 0.0) -> bool:
        names = [f"servo{k}_raw" for k in range(1, ROTORS + 1)]
        for name, value in zip(
            names, _swapped([getattr(message, n) for n in names], one, other), strict=True
        ):
            setattr(message, name, value)
        return True

    outputs = "SERVO_OUTPUT_RAW"
    yield _fields("o_none", "outputs", {outputs: lambda *_: False})
    yield _fields(f"o_swap{one}{other}", "outputs", {outputs: swap_outputs})

    def scale_airspeed(message: Message, _: float) -> bool:
        message.airspeed *= 1.3
        return True

    held = Held(rng.uniform(60.0, 110.0))

    def hold_airspeed(message: Message, time_s: float) -> bool:
        message.airspeed = held(message.airspeed, time_s)
        return True

    yield _fields("a_none", "airspeed", {"VFR_HUD": lambda *_: False, "WIND": lambda *_: False})
    yield _fields("a_x13", "airspeed", {"VFR_HUD": scale_airspeed})
    yield _fields("a_frozen", "airspeed", {"VFR_HUD": hold_airspeed})

    def heat(message: Message, _: float) -> bool:
        message.temperature = 10_500  # 0.01 degC
        return True

    def away(time_s: float) -> bool:
        return int(time_s / 20.0) % 2 == 1

    def jump_pressure(message: Message, time_s: float) -> bool:
        message.press_abs -= 35.5 * away(time_s)  # hPa in 300 m
        return True

    def jump_height(message: Message, time_s: float) -> bool:
        if message.get_type() == "VFR_HUD":
            message.alt += 300.0 * away(time_s)
        else:
            message.alt += 300_000 * away(time_s)
            message.relative_alt += 300_000 * away(time_s)
        return True

    heights = {"GLOBAL_POSITION_INT": jump_height, "VFR_HUD": jump_height}
    yield _fields("b_105c", "barometer", {"SCALED_PRESSURE": heat})
    yield _fields("b_jumps", "barometer", {"SCALED_PRESSURE": jump_pressure, **heights})
    began: dict[str, int] = {}

    def hurry(message: Message, _: float) -> bool:
        for name in ("time_boot_ms", "time_usec"):
            if (own := getattr(message, name, None)) is not None:
                start = began.setdefault(name, own)
                setattr(message, name, 2 * own - start)
        return True

    yield _fields("c_attitude_x2", "clock", {"ATTITUDE": hurry})
    yield _fields("c_all_x2", "clock", dict.fromkeys(DAMAGED_MESSAGES, hurry))

    def swap_all(message: Message, _: float) -> bool:
        if message.get_type() == outputs:
            return swap_outputs(message)
        for name in ("rpm", "voltage", "current", "temperature", "count", "totalcurrent"):
            setattr(message, name, _swapped(getattr(message, name), one, other))
        return True

    kinds = {outputs: swap_all, "ESC_TELEMETRY_1_TO_4": swap_all}
    yield _fields(f"m_order{one}{other}", "motor order", kinds)


def damages(rng: np.random.Generator) -> list[Damage]:
    """Return one damage of each kind, with the places and sizes that `rng` draws."""
    return [*_gauges(rng), *_rotor_speeds(rng), *_voltages(rng), *_others(rng)]


def kind_of(name: str) -> str:
    """Return the kind of a damage: its name without the rotors that it is of."""
    return re.sub(r"(?<=one104)_\d$|(?<=copy)\dto\d$|(?<=swap)\d\d$|(?<=order)\d\d$", "", name)


# --- the files


@dataclass(frozen=True, slots=True)
class Frame:
    """One frame of a .tlog: its stamp in us, its bytes, and the message if it may be damaged."""

    stamp_us: int
    data: bytes
    message: Message | None


@cache
def frames(path: Path) -> tuple[Frame, ...]:
    """Return the frames of a .tlog without signatures; raises ValueError where it is damaged."""
    codec, data, found, at = mavlink.MAVLink(None), path.read_bytes(), [], 0
    kinds = {i for i, kind in mavlink.mavlink_map.items() if kind.msgname in DAMAGED_MESSAGES}
    while at < len(data):
        (stamp,) = struct.unpack_from(">Q", data, at)
        if data[at + 8] != mavlink.PROTOCOL_MARKER_V2:
            raise ValueError(f"{path.name}: no frame of MAVLink 2 at byte {at + 8}")
        frame = data[at + 8 : at + 20 + data[at + 9]]
        wanted = int.from_bytes(frame[7:10], "little") in kinds
        found.append(Frame(stamp, frame, codec.decode(bytearray(frame)) if wanted else None))
        at += 8 + len(frame)
    return tuple(found)


def damaged(source: Sequence[Frame], edits: Sequence[Edit]) -> bytes:
    """Return the bytes of a .tlog with all `edits` made to its messages, in their order."""
    out, codec = io.BytesIO(), mavlink.MAVLink(None)
    start_us = source[0].stamp_us
    for frame in source:
        data: bytes = frame.data
        if frame.message is not None:
            message, time_s = copy.copy(frame.message), (frame.stamp_us - start_us) / 1e6
            if not all(edit(message, time_s) for edit in edits):
                continue
            header = frame.message.get_header()
            codec.srcSystem, codec.srcComponent = header.srcSystem, header.srcComponent
            codec.seq = header.seq
            data = message.pack(codec)
        out.write(struct.pack(">Q", frame.stamp_us) + data)
    return out.getvalue()


# --- what a report says


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What is compared of a report of one flight; NaN is unknown, `said` are labels in print."""

    level: str
    headline: str = ""
    fill_kg: float = np.nan
    fill_low_kg: float = np.nan
    fill_high_kg: float = np.nan
    ratio: float = np.nan  # one rotor lost: the thrust that can be held over the weight
    ratio_low: float = np.nan
    ratio_high: float = np.nan
    alarms: tuple[tuple[str, tuple[int, ...]], ...] = ()  # kind, rotors from 1
    findings: tuple[tuple[str, str], ...] = ()  # check and words of those that are not in order
    said: frozenset[str] = frozenset()
    no_verdict: bool = False


GREEN = ("under", "near")
EMERGENCY = ("damaged", "lost", "battery", "no_thrust")
GRAVITY = (*EMERGENCY, "critical", "over", "order", "near", "under", "unknown")
#: Lines that every report has, and that are no doubt of anything.
USUAL = {
    *("what to do", "steady flight", "turns and gusts", "one rotor lost", "fill, how sure"),
    *("worst", "from", "airframe", "prediction", "alarm"),
}
#: Check of a finding that blames one instrument -> the part that it blames.
BLAMES = {
    "accelerometer": "accelerometer",
    "airspeed reading": "airspeed",
    "barometer": "barometer",
    "battery voltage": "voltage",
    "ESC voltage": "voltage",
    "gauge": "gauge",
    "gyro": "clock",
    "motor order": "motor order",
    "rotor speed sensors": "rotor speeds",
    "rotor speeds": "rotor speeds",
}
#: Alarm without outputs that show whether it is the propeller or its ESC: both are named.
EITHER = "propeller or ESC"
#: What a check of the motors' order can be right about.
ORDER_IS_OF = {"motor order", "outputs", "rotor speeds"}


def reported(log: Path) -> Answer:
    """Return what `report` says of a log, by its JSON; its level is `unread` where it has none."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "report.json"
        quiet = io.StringIO()
        with contextlib.redirect_stdout(quiet), contextlib.redirect_stderr(quiet):
            run(["report", str(log), "--json", str(out)])
        flights = json.loads(out.read_text())["flights"] if out.exists() else []
    if not flights:
        return Answer(level="unread", headline=quiet.getvalue()[:200], no_verdict=True)
    return answer_of(min(flights, key=lambda one: GRAVITY.index(one["verdict"]["level"])))


def answer_of(flight: Mapping[str, Any]) -> Answer:
    """Return what is compared of one flight in the JSON of a report."""
    verdict = flight["verdict"]
    numbers = {
        "fill_kg": verdict["fill"]["limit_kg"],
        "fill_low_kg": verdict["fill"]["low_kg"],
        "fill_high_kg": verdict["fill"]["high_kg"],
        "ratio": verdict["rotor_lost"]["redundancy_min"],
        "ratio_low": verdict["rotor_lost"]["redundancy_min_low"],
        "ratio_high": verdict["rotor_lost"]["redundancy_min_high"],
    }
    unsure = any("cannot tell" in fact["text"].lower() for fact in verdict["facts"])
    unsure |= "CANNOT TELL" in verdict["headline"]
    labels = {fact["label"] for fact in verdict["facts"]} - USUAL
    return Answer(
        level=verdict["level"],
        headline=verdict["headline"],
        alarms=tuple(
            (one["kind"] if one["witnessed_by_outputs"] else EITHER, tuple(one["rotors"]))
            for one in flight["alarms"]
        ),
        findings=tuple(
            (one["check"], one["words"])
            for one in flight["findings"]
            if one["level"] in ("grave", "warning") and one["spoils"] != "nothing"
        ),
        said=frozenset(labels | ({"cannot tell"} if unsure else set())),
        no_verdict=bool(flight["no_verdict"]) or verdict["level"] == "unknown",
        **{name: np.nan if value is None else float(value) for name, value in numbers.items()},
    )


# --- the score


@dataclass(frozen=True, slots=True)
class Score:
    """One of the scores in this module's first lines, and what it is by."""

    score: str
    why: str = ""


BAD = ("green", "blamed", "missed", "emergency", "silent")
UNTOLD = "the weak rotor is not told"
SCORES = (*BAD, "doubted", "cautious", "no_verdict", "right")


def score(answer: Answer, truth: Answer, weak: frozenset[int], wrong: Sequence[Damage]) -> Score:
    """Score the answer of a flight with `wrong` damages against that of the sound flight."""
    if answer.level == "unread":
        return Score("no_verdict", answer.headline)
    if blamed := _blamed(answer, truth, weak, wrong):
        return Score("blamed", "; ".join(blamed))
    doubts = sorted(answer.said - truth.said)
    reasons = _reassures(answer, truth)
    if answer.no_verdict:
        return Score("no_verdict", ", ".join(doubts))
    if answer.level in EMERGENCY and truth.level not in EMERGENCY:
        return Score("emergency", answer.headline)
    if reasons:
        why = ", ".join(reasons)
        if doubts:
            return Score("doubted", f"{why}; said: {', '.join(doubts)}")
        if answer.level not in GREEN:
            return Score("silent", why)
        return Score("missed" if reasons == [UNTOLD] else "green", why)
    below = answer.fill_kg < truth.fill_low_kg or answer.ratio < truth.ratio_low
    if below or GRAVITY.index(answer.level) < GRAVITY.index(truth.level):
        return Score("cautious", answer.level)
    return Score("right", ", ".join(doubts))


def _reassures(answer: Answer, truth: Answer) -> list[str]:
    """Return in what an answer is better than the truth."""
    found = []
    if answer.level in GREEN and truth.level == "damaged":
        found.append(UNTOLD)
    elif answer.level in GREEN and truth.level not in GREEN:
        found.append(f"level {answer.level}, truth {truth.level}")
    if answer.fill_kg > truth.fill_high_kg:
        found.append(f"fill {answer.fill_kg:.1f} kg, truth at most {truth.fill_high_kg:.1f}")
    if answer.ratio > truth.ratio_high:
        found.append(f"ratio {answer.ratio:.3f}, truth at most {truth.ratio_high:.3f}")
    return found


def _blamed(
    answer: Answer, truth: Answer, weak: frozenset[int], wrong: Sequence[Damage]
) -> list[str]:
    """Return the sound rotors, and the instruments that are right, that an answer names surely."""
    found = []
    parts = {one.part for one in wrong}
    sensors = frozenset[int]().union(*(d.rotors for d in wrong if d.part == "rotor speeds"))
    for kind, rotors in answer.alarms:
        # Where the names are said to be wrong, only that there is one is claimed.
        right = bool(weak) and (bool(weak & {*rotors}) or "rotor names" in answer.said)
        right |= kind == EITHER and set(rotors) <= sensors
        if not right:
            which = " or ".join(map(str, rotors))
            found.append(f"rotor {which} by {kind}, weak: {sorted(weak) or 'none'}")
    for check, words in answer.findings:
        part = BLAMES.get(check)
        if part is None or (check, words) in truth.findings:
            continue
        if not (ORDER_IS_OF if part == "motor order" else {part}) & parts:
            found.append(f"{check}: {words}")
        elif check == "rotor speed sensors":
            named = {int(k) for k in re.findall(r"\brotor (\d)\b", words)}
            if named - sensors:
                found.append(f"{check}: {words}")
    return found


# --- the flights of a seed


@dataclass(frozen=True, slots=True)
class Flight:
    """One damaged flight: its `number` in its seed, the base, and what is wrong with it."""

    seed: int
    number: int
    base: str
    wrong: tuple[Damage, ...]

    @property
    def name(self) -> str:
        return "+".join(one.name for one in self.wrong)

    @property
    def file(self) -> str:
        return f"{self.seed}_{self.number}_{Path(self.base).name}_{self.name}.tlog"

    def made(self) -> bytes:
        """Return the bytes of its file."""
        return damaged(frames(LOGS / f"{self.base}.tlog"), [one.edit for one in self.wrong])


def flight(seed: int, number: int) -> Flight:
    """Return one flight of a seed: the first have each damage alone, later ones a pair of them."""
    rng = np.random.default_rng([seed, number])
    found = damages(rng)
    bases = list(BASES)
    if number < 3 * len(found):
        base = bases[int(rng.integers(len(bases)))]
        return Flight(seed, number, base, (found[number % len(found)],))
    base = bases[int(rng.integers(len(bases)))]
    while True:
        one, other = (found[int(k)] for k in rng.permutation(len(found))[:2])
        absent = any(d.name.endswith(("_none", "_frozen")) for d in (one, other))
        if one.part != other.part or not absent:  # nothing is changed of what is not there
            return Flight(seed, number, base, (one, other))


def main() -> int:
    """Report damaged flights and print the scores; returns 1 where one is green or blames."""
    options = _options()
    first, last = options.seeds[0], options.seeds[-1]
    wanted = options.only or [
        (s, n) for s in range(first, last + 1) for n in range(options.flights)
    ]
    folder = options.keep or Path(tempfile.mkdtemp(prefix="damaged_"))
    folder.mkdir(parents=True, exist_ok=True)
    truths: dict[str, Answer] = {}
    results: list[tuple[Flight, Score, Answer]] = []
    for seed, number in wanted:
        one = flight(seed, number)
        if one.base not in truths:
            truths[one.base] = reported(LOGS / f"{one.base}.tlog")
        path = folder / one.file
        path.write_bytes(one.made())
        answer = reported(path)
        results.append((one, score(answer, truths[one.base], BASES[one.base], one.wrong), answer))
        if not options.keep:
            path.unlink()
        if sys.stdout.isatty():
            print(f"{len(results)} of {len(wanted)}", end="\r", flush=True)
    for line in table([(one, got) for one, got, _ in results]):
        print(line)
    listed = BAD if not options.all else SCORES
    for one, got, answer in results:
        if got.score in listed:
            print(f"{got.score}: {one.base} {one.name}: {answer.headline}: {got.why}")
            print(f"  python -m tests.lab.damaged_meaning --only {one.seed}:{one.number} --keep .")
    if options.against:
        before = {row["flight"]: row for row in json.loads(options.against.read_text())}
        for one, got, answer in results:
            old = before.get(f"{one.seed}:{one.number}")
            if old and old["score"] != got.score:
                print(
                    f"{one.seed}:{one.number} {one.base} {one.name}: {old['score']} -> {got.score}"
                )
                print(f"  {old['headline']} -> {answer.headline}")
    if options.json:
        rows = [
            {
                **{"flight": f"{one.seed}:{one.number}", "base": one.base, "damage": one.name},
                **{"score": got.score, "why": got.why, "headline": answer.headline},
                **{"level": answer.level, "said": sorted(answer.said)},
                **{k: _or_none(getattr(answer, k)) for k in ("fill_kg", "ratio")},
            }
            for one, got, answer in results
        ]
        options.json.write_text(json.dumps(rows, indent=1))
    return int(any(got.score in ("green", "blamed") for _, got, _ in results))


def _or_none(value: float) -> float | None:
    return None if np.isnan(value) else value


def table(results: Sequence[tuple[Flight, Score]]) -> Iterator[str]:
    """Yield the lines of the table: one for each kind of damage (a pair is in two), and the sum."""
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for one, got in results:
        for name in {kind_of(part.name) for part in one.wrong}:
            counts[name][got.score] += 1
    for words, pairs in (("all single", False), ("all pairs", True)):
        counts[words] = Counter(got.score for one, got in results if (len(one.wrong) > 1) is pairs)
    counts["all"] = Counter(got.score for _, got in results)
    yield f"{'damage':16}{'flights':>8}" + "".join(f"{name:>10}" for name in SCORES)
    for name, row in counts.items():
        cells = "".join(f"{row[one] or '':>10}" for one in SCORES)
        yield f"{name:16}{row.total():8}{cells}"


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[1], help="first and last seed")
    parser.add_argument("--flights", type=int, default=FLIGHTS, help="of each seed")
    parser.add_argument("--only", type=_place, nargs="+", help="SEED:NUMBER of single flights")
    parser.add_argument("--keep", type=Path, help="folder in which the damaged files are left")
    parser.add_argument("--all", action="store_true", help="list every flight, not only the bad")
    parser.add_argument("--json", type=Path, help="file for one row a flight")
    parser.add_argument("--against", type=Path, help="such a file of before: lists what changed")
    return parser.parse_args()


def _place(words: str) -> tuple[int, int]:
    seed, number = words.split(":")
    return int(seed), int(number)


if __name__ == "__main__":
    sys.exit(main())
