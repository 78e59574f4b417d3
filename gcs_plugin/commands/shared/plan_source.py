"""`read_plan`: the plan in a plan file, or the mission in a log, by what the file holds."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from thrustmargin.gcs_plugin.commands.shared.options import UsageError
from thrustmargin.mission import plan as plan_files
from thrustmargin.mission.plan_items import (
    FIRMWARE_ARDUPILOT,
    FIRMWARE_GENERIC,
    FIRMWARE_PX4,
    MissionPlan,
    PlanItem,
    plan_from_items,
)
from thrustmargin.models.errors import LogError, PlanError
from thrustmargin.models.whole_file import regular

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.telemetry.recording import Recording
    from thrustmargin.mission.forecast.plan_flight import PlanConditions
    from thrustmargin.mission.pump_rule import PumpRule
    from thrustmargin.mission.steps import PumpOutput

_ENDINGS = (".plan", ".mission", ".waypoints")
#: What `cover` reads.
_FIELDS = (".kml", ".kmz", ".geojson", ".shp", ".xml")
#: Bytes of a file beyond which it is not searched to its end for a log that it may not be: so many
#: samples of so many bytes each hold messages in hundreds, and noise almost none.
_LARGE, _SAMPLES, _SAMPLE, _FEW = 32 << 20, 16, 1 << 16, 20
#: Messages with home: of MAVLink, of DataFlash.
_HOMES = ("HOME_POSITION", "ORGN")
_FIRMWARE = {"ArduPilot": FIRMWARE_ARDUPILOT, "PX4": FIRMWARE_PX4}


def read_assumed(path: Path, *, plan: Path | None) -> PlanConditions:
    """Read the conditions that a plan was forecast with from the JSON of `forecast --json`.

    Raises PlanError if the file is another one or has impossible values, and if `plan` is None,
    since conditions without a plan have no use.
    """
    if plan is None:
        raise PlanError(f"{path.name} is what a plan was forecast with; give the plan with --plan")
    from thrustmargin.mission.forecast.battery import FlightBattery
    from thrustmargin.mission.forecast.plan_flight import PlanConditions

    try:
        content = json.loads(regular(path).read_text("utf-8"))
        known = dict(content["conditions"])
        if "tank_start_kg" in known:  # `fill_kg` in thrustmargin.forecast/1
            known["fill_kg"] = known.pop("tank_start_kg")
        battery = FlightBattery(**_numbers(known.pop("battery")))
        north, east, down = (float(axis) for axis in known.pop("wind_ned"))
        made = PlanConditions(battery=battery, wind_ned=(north, east, down), **_numbers(known))
    except OSError as error:
        raise PlanError(f"{path} cannot be read: {error.strerror}") from error
    except (
        ValueError,
        TypeError,
        KeyError,
        AttributeError,
        ArithmeticError,
        RecursionError,
    ) as error:
        raise PlanError(
            f"{path.name} does not hold what a plan was forecast with; write it with: "
            "thrustmargin forecast PLAN --fill KG --json FILE.json"
        ) from error
    wind = math.hypot(north, east, down)
    if not (0.0 <= made.fill_kg <= 1e4 and 0.3 < made.density < 2.0 and wind < 60.0):
        raise PlanError(
            f"{path.name} has {made.fill_kg:g} kg in the tank, air of {made.density:g} kg/m³ and "
            f"a wind of {wind:g} m/s, which cannot be"
        )
    return made


def _numbers(content: dict[str, float | None]) -> dict[str, float]:
    """Return the entries that are not None."""
    return {name: float(value) for name, value in content.items() if value is not None}


def read_plan(path: str | Path, *, vehicle: int | None = None) -> MissionPlan:
    """Read the plan in a `.plan`, `.mission` or `.waypoints` file, or the mission inside a log.

    Of a log (`.tlog`, DataFlash `.BIN` or `.log`) it is the last mission that `vehicle`, a system
    id, received or sent; None: the log's main vehicle. Raises PlanError, with the remedy, if there
    is no plan, or one that cannot be flown; LogError if a log cannot be read.

        >>> plan = read_plan("sitl_logs/campaign/v4_m16_q2.5.tlog")
        >>> len(plan.items)
        28
    """
    path = Path(path)
    try:
        with regular(path).open("rb") as file:
            head = file.read(4096).lstrip(b"\xef\xbb\xbf \t\r\n")
    except FileNotFoundError as error:
        raise PlanError(f"no file {path}; check its name and folder") from error
    except OSError as error:
        raise PlanError(f"{path} cannot be read: {error.strerror}") from error
    if path.suffix.lower() in _FIELDS:
        raise PlanError(
            f"{path.name} is a field, not a plan; make its route first: "
            f"thrustmargin cover {path.name} --swath 5 -o field.plan"
        )
    if path.suffix.lower() in _ENDINGS or head.startswith((b"{", b"[", b"QGC WPL")):
        return plan_files.read_plan(path)
    return _plan_of_log(path, vehicle)


def _plan_of_log(path: Path, vehicle: int | None) -> MissionPlan:
    # A plan file is read or refused before the readers of logs are loaded.
    from thrustmargin.gcs_plugin.logs.dataflash.binary import dataflash_boots
    from thrustmargin.gcs_plugin.logs.dataflash.text_log import dataflash_text_boots
    from thrustmargin.gcs_plugin.logs.read import formats
    from thrustmargin.gcs_plugin.logs.tlog import tlog_boots
    from thrustmargin.gcs_plugin.telemetry.recording import NotThisFormat

    boots = {
        "tlog": tlog_boots,
        "DataFlash": dataflash_boots,
        "DataFlash text": dataflash_text_boots,
    }
    try:
        kinds = formats(path)
        if not any(kind.is_text for kind in kinds) and not _holds_messages(path):
            raise LogError("no messages show in it")
        readers = [read for kind in kinds if (read := boots.get(kind.name))]
    except LogError as error:
        raise PlanError(
            f"{path.name} is neither a plan (.plan, .waypoints) nor a log with one ({error})"
        ) from error
    for reader in readers:
        try:
            holding = [r for r in reader(path, vehicle=vehicle) if r.waypoints]
        except NotThisFormat:
            continue
        if holding:
            return plan_of_waypoints(
                holding[-1].waypoints,
                autopilot=holding[-1].autopilot,
                source=path.name,
                home=_home(holding[-1]),
            )
    raise PlanError(f"{path.name} holds no whole mission; name a .plan or .waypoints file")


def _holds_messages(path: Path) -> bool:
    """Return False if samples of a large file contain neither MAVLink nor DataFlash messages.

    True for a file of at most _LARGE bytes, which is read anyway.
    """
    from thrustmargin.gcs_plugin.logs.dataflash.message_scan import HEAD
    from thrustmargin.gcs_plugin.mavlink.scan import PADDING, scan

    size = path.stat().st_size
    if size <= _LARGE:
        return True
    with path.open("rb") as file:
        for place in range(0, size, size // _SAMPLES):
            file.seek(place)
            part = file.read(_SAMPLE)
            frames = scan(np.frombuffer(part + bytes(PADDING), dtype=np.uint8), len(part))
            if max(frames.start.size, part.count(bytes(HEAD))) >= _FEW:
                return True
    return False


def _home(recording: Recording) -> tuple[float, float, float] | None:
    """Return the last home in a log: latitude, longitude, degrees, and altitude, m AMSL.

    None if the log reports none.
    """
    from thrustmargin.gcs_plugin.logs.dataflash.dataflash_table import dataflash_signals
    from thrustmargin.gcs_plugin.telemetry.signals import best, mavlink_signals
    from thrustmargin.models.provenance import NOT_REPORTED

    named = {name: one for name, one in recording.streams.items() if name in _HOMES}
    if not named:
        return None
    if "HOME_POSITION" in named:
        signals = mavlink_signals(named, NOT_REPORTED)
    else:
        signals = dataflash_signals(named)
    home = best(signals, "home")
    places = np.empty((0, 3)) if home is None else home.values
    known = places[np.isfinite(places).all(axis=1) & np.any(places[:, :2] != 0.0, axis=1)]
    return (float(known[-1, 0]), float(known[-1, 1]), float(known[-1, 2])) if len(known) else None


def plan_of_waypoints(
    waypoints: Sequence[PlanItem],
    *,
    autopilot: str,
    source: str,
    home: tuple[float, float, float] | None = None,
) -> MissionPlan:
    """Return the plan that consists of the mission items in a log.

    `autopilot` is the name of the autopilot; with "ArduPilot" the first item is home. `source` is
    the log's name for errors. `home` is that reported by the log: latitude, longitude, degrees, m
    AMSL. Raises PlanError if items are missing or the mission cannot be flown.
    """
    numbers = [w.number for w in waypoints]
    if numbers != list(range(len(numbers))):
        missing = next(k for k, number in enumerate([*numbers, -1]) if number != k)
        raise PlanError(f"{source} holds a mission without its item {missing}; name a .plan file")
    return plan_from_items(
        waypoints,
        home_first=autopilot == "ArduPilot",
        home=home,
        firmware=_FIRMWARE.get(autopilot, FIRMWARE_GENERIC),
        source=source,
    )


def pump_rule_of(words: str | None) -> PumpRule | None:
    """Return the rule `always` or `lines` for plans that do not switch the pump; None for other
    words.
    """
    return words if words in ("always", "lines") else None


def pump_of(words: str) -> PumpOutput:
    """Parse the output that switches the pump: `sprayer`, `servo:9:1900:1100` or `relay:0`.

    Of a servo these are its number, and the pulses for on and off, µs. Raises UsageError for
    another text.
    """
    from thrustmargin.mission.steps import PumpOutput

    if words == "sprayer":
        return PumpOutput()
    if found := re.fullmatch(r"relay:(\d{1,2})", words):
        return PumpOutput(relay=int(found[1]))
    if found := re.fullmatch(r"servo:(\d{1,2}):(\d{3,4}):(\d{3,4})", words):
        output, on, off = map(int, found.groups())
        if 1 <= output <= 32 and on != off:
            return PumpOutput(servo=output, on_us=float(on), off_us=float(off))
    raise UsageError(
        f"--pump {words!r:.40} is none of sprayer, servo:NUMBER:ON:OFF (such as "
        "servo:9:1900:1100), relay:NUMBER, always and lines"
    )
