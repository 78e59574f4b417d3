"""A vehicle for live tests: frames made by pymavlink; and our commands as processes."""

import subprocess
import sys
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import reduce
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from thrustmargin.gcs_plugin.live.rows.vehicle_telemetry import LiveRows, VehicleTelemetry
from thrustmargin.gcs_plugin.mavlink.frame import Frame, frame_of
from thrustmargin.gcs_plugin.mavlink.scan import stamped_frames
from thrustmargin.gcs_plugin.telemetry.vehicle_events import Options
from thrustmargin.models.physics.airframe import Airframe

ROOT = Path(__file__).resolve().parents[3]
SECOND = 1_000_000  # µs


class Vehicle:
    """Makes the frames of a hovering quad; `clock_s` is its time since boot."""

    def __init__(self, system: int = 1, *, clock_s: float = 100.0, unix_s: float = 1.7e9) -> None:
        self.packer = dialect.MAVLink(None, srcSystem=system, srcComponent=1)
        self.clock_s = clock_s
        self.stamp_us = int(unix_s * SECOND)
        self.height = 3.0

    def pack(self, message: object) -> bytes:
        data = bytes(message.pack(self.packer))  # type: ignore[attr-defined]
        self.packer.seq = (self.packer.seq + 1) % 256
        return data

    def frame(self, message: object) -> Frame:
        return as_frame(self.pack(message), self.stamp_us)

    @property
    def boot_ms(self) -> int:
        return round(self.clock_s * 1000)

    def heartbeat(self) -> bytes:
        return self.pack(dialect.MAVLink_heartbeat_message(2, 3, 0x80, 0, 4, 3))

    def attitude(self, roll: float = 0.0) -> bytes:
        message = dialect.MAVLink_attitude_message(self.boot_ms, roll, 0.0, 0.0, 0.0, 0.0, 0.0)
        return self.pack(message)

    def escs(self, rpm: Sequence[int] = (2000,) * 4) -> bytes:
        four = [0] * 4
        return self.pack(
            dialect.MAVLink_esc_telemetry_1_to_4_message(
                four, [5000] * 4, four, four, list(rpm), [self.boot_ms % 65536] * 4
            )
        )

    def speed(self, airspeed: float = 4.0) -> bytes:
        return self.pack(dialect.MAVLink_vfr_hud_message(airspeed, airspeed, 0, 50, 10.0, 0.0))

    def tank(self, level: float = 10.0) -> bytes:
        return self.pack(dialect.MAVLink_named_value_float_message(self.boot_ms, b"TANK", level))

    def place(self, height: float = 3.0) -> bytes:
        return self.pack(
            dialect.MAVLink_global_position_int_message(
                *(self.boot_ms, 366_500_000, 1_169_000_000, int(1000 * (5 + height))),
                *(int(1000 * height), 0, 0, 0, 0),
            )
        )

    def landed(self, state: int = 2) -> bytes:
        return self.pack(dialect.MAVLink_extended_sys_state_message(0, state))

    def tick(self, seconds: float = 0.1, *, rpm: Sequence[int] = (2000,) * 4) -> list[Frame]:
        """A tenth of a second of flight as frames: attitude, rotor speeds, and the rest."""
        self.clock_s += seconds
        self.stamp_us += round(seconds * SECOND)
        parts = [self.attitude(), self.escs(rpm), self.speed(), self.tank()]
        parts.append(self.place(self.height))
        if self.boot_ms % 1000 < 100:
            parts += [self.heartbeat(), self.landed()]
        return [as_frame(part, self.stamp_us) for part in parts]


def as_frame(data: bytes, stamp_us: int = 0) -> Frame:
    found = frame_of(data, stamp_us=stamp_us)
    assert found is not None
    return found


def log_frames(path: Path) -> list[Frame]:
    """All frames of a .tlog with its stamps."""
    return [as_frame(data, stamp_us) for stamp_us, data in stamped_frames(path)]


def first_part(path: Path, seconds: float, folder: Path) -> Path:
    """The beginning of a .tlog, as a file of the same name in `folder`."""
    frames = log_frames(path)
    end_us = frames[0].stamp_us + round(seconds * SECOND)
    return write_log(folder / path.name, [f for f in frames if f.stamp_us < end_us])


def live_rows(
    frames: Iterable[Frame], airframe: Airframe, *, piece: int = 7, **options
) -> tuple[LiveRows | None, VehicleTelemetry]:
    """The rows that vehicle 1's frames give live, `piece` frames a round, and what made them."""
    telemetry = VehicleTelemetry(1, Options(airframe=airframe, sampling="hold", **options))
    mine = [frame for frame in frames if frame.system == 1]
    parts: list[LiveRows] = []
    for first in range(0, len(mine), piece):
        for frame in mine[first : first + piece]:
            telemetry.take(frame)
        parts += telemetry.rows()
    return (joined(parts) if parts else None), telemetry


def joined(parts: Sequence[LiveRows]) -> LiveRows:
    """Rows of one start as one piece; what is no array is that of the last."""
    names = ("clock_s", "stamp_us", "pump_share", "pumped_kg", "mission_item", "esc_failures")
    arrays = {name: np.concatenate([getattr(p, name) for p in parts]) for name in names}
    track = reduce(lambda one, later: one.followed_by(later), [p.track for p in parts])
    return replace(parts[-1], track=track, **arrays)


def command(name: str, *arguments: str, **options) -> subprocess.Popen:
    """`thrustmargin NAME ...` in a process of its own."""
    program = (
        "import tyro; from thrustmargin.gcs_plugin.cli import command_function; "
        f"tyro.cli(command_function({name!r}))"
    )
    return subprocess.Popen([sys.executable, "-c", program, *arguments], cwd=ROOT, **options)


def write_log(path: Path, frames: list[Frame]) -> Path:
    """Frames as a .tlog."""
    path.write_bytes(b"".join(f.stamp_us.to_bytes(8, "big") + f.data for f in frames))
    return path
