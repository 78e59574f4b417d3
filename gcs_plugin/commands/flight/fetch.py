"""thrustmargin fetch: a mission or a log from the vehicle itself."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import Positional

from thrustmargin.gcs_plugin.commands.shared.options import OutputFile, check_outputs
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal, transfer_bar
from thrustmargin.models.errors import LinkError

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.vehicle.connection import VehicleLink
    from thrustmargin.gcs_plugin.vehicle.downloads import LogEntry


@dataclass(frozen=True, slots=True)
class FetchFrom:
    """The vehicle on a link."""

    url: Annotated[Positional[str], tyro.conf.arg(metavar="URL")]
    """Link: udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or /dev/ttyUSB0,57600."""
    vehicle: int | None = None
    """System id, needed when the link carries several vehicles."""
    timeout: float = 10.0
    """Seconds to wait for the vehicle's first heartbeat."""
    signing_key_file: Path | None = None
    """Key of a vehicle that wants signed messages: 32 bytes, 64 hex digits or a passphrase."""


@dataclass(frozen=True, slots=True)
class FetchMission(FetchFrom):
    """Download the mission and save it as a QGroundControl plan (fence and rally points are not).

    Example: thrustmargin fetch mission udpin:127.0.0.1:14550 -o field.plan
    """

    output: Annotated[Path, tyro.conf.arg(aliases=["-o", "--out"])] = Path("mission.plan")
    """File to write."""


@dataclass(frozen=True, slots=True)
class FetchLog(FetchFrom):
    """Download a flight log; without --id the latest one. Land first: it takes minutes by radio.

    Example: thrustmargin fetch log /dev/ttyACM0,115200 --id 12 -o flight.BIN
    """

    output: Annotated[Path | None, tyro.conf.arg(aliases=["-o", "--out"])] = None
    """File to write; without it log_NUMBER.BIN (.ulg from PX4) in this folder."""
    list: bool = False
    """Only show which logs the vehicle holds."""
    id: int | None = None
    """Number of the log, as --list shows it."""
    latest: bool = False
    """Take the latest log that is not empty, which is also what happens without --id."""
    force: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Replace the file if it is there."""


def fetch(
    what: Annotated[
        Annotated[FetchMission, tyro.conf.subcommand("mission", prefix_name=False)]
        | Annotated[FetchLog, tyro.conf.subcommand("log", prefix_name=False)],
        tyro.conf.arg(name=""),
    ],
) -> None:
    """Download the mission or a flight log from the vehicle.

    Example: thrustmargin fetch mission udpin:127.0.0.1:14550 -o field.plan
    """
    _check_output(what, what.output)
    if isinstance(what, FetchMission):
        _fetch_mission(what)
    else:
        _fetch_log(what)


def _fetch_mission(order: FetchMission) -> None:
    from thrustmargin.gcs_plugin.vehicle.downloads import download_mission
    from thrustmargin.mission.plan import write_plan

    with _link(order) as link, transfer_bar() as (announce, progress):
        announce(f"waiting for a heartbeat at {order.url}")
        vehicle = link.vehicle(order.vehicle, timeout=order.timeout)
        number = vehicle.get_system_id()
        announce(f"mission of vehicle {number}")
        plan = download_mission(link, vehicle, progress)
    write_plan(plan, order.output)
    places = sum(item.place is not None for item in plan.items)
    _say(f"{order.output}: {len(plan.items)} items ({places} places) from vehicle {number}")
    for note in plan.notes:
        _say(f"note: {note}")


def _fetch_log(order: FetchLog) -> None:
    from thrustmargin.gcs_plugin.vehicle.downloads import VehicleLogs

    if (order.id is not None) + order.latest + order.list > 1:
        raise LinkError("--id, --latest and --list exclude each other; give one of them")
    with _link(order) as link, transfer_bar() as (announce, progress):
        announce(f"waiting for a heartbeat at {order.url}")
        vehicle = link.vehicle(order.vehicle, timeout=order.timeout)
        announce(f"list of logs of vehicle {vehicle.get_system_id()}")
        logs = VehicleLogs(link, vehicle)
        if not order.list:
            entry = logs.choose(order.id)
            suffix = "ulg" if vehicle.autopilot_type().name == "PX4" else "BIN"
            path = order.output or Path(f"log_{entry.number}.{suffix}")
            _check_output(order, path)
            announce(f"log {entry.number} of {entry.date or 'an unknown date'}")
            logs.download(entry, path, progress)
    if order.list:
        _print_logs(logs.entries)
    else:
        _say(f"{path}: log {entry.number}, {entry.size_bytes} bytes")


def _check_output(order: FetchMission | FetchLog, path: Path | None) -> None:
    keep = isinstance(order, FetchLog) and not order.force
    check_outputs([OutputFile("--output", path, keep=keep)], inputs=[order.signing_key_file])


def _link(order: FetchFrom) -> AbstractContextManager[VehicleLink]:
    from thrustmargin.gcs_plugin.vehicle.connection import VehicleLink

    if order.signing_key_file is None:
        return VehicleLink.open(order.url)
    from thrustmargin.gcs_plugin.link.signing import read_signing_key
    from thrustmargin.gcs_plugin.vehicle.connection import signed_link

    key = read_signing_key(order.signing_key_file)
    for note in key.notes:
        _say(f"note: {note}", stderr=True)
    return signed_link(order.url, key.key)


def _print_logs(entries: tuple[LogEntry, ...]) -> None:
    if not entries:
        _say("the vehicle holds no logs")
    for entry in entries:
        _say(f"{entry.number:6d}  {entry.date or 'date unknown':20}  {entry.size_bytes:12d} bytes")


def _say(line: str, *, stderr: bool = False) -> None:
    Terminal(stderr=stderr, soft_wrap=True).print(line)
