"""Telemetry logs for tests: a recorded flight, its frames, and short flights made by pymavlink."""

import struct
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.logs.log_files import frames_of

ROOT = Path(__file__).resolve().parents[3]
FLIGHT = ROOT / "sitl_logs/campaign/v4_m10_q2.5.tlog"
WHOLE = FLIGHT.read_bytes()
STAMPED = frames_of(FLIGHT)
UNIX = 1_790_000_000_000_000  # µs


def written(tmp_path: Path, data: bytes, name: str = "made.tlog") -> Path:
    path = tmp_path / name
    path.write_bytes(data)
    return path


def link(system: int = 1, component: int = 1) -> dialect.MAVLink:
    return dialect.MAVLink(None, srcSystem=system, srcComponent=component)


def stamped(frame: bytes, time_s: float) -> bytes:
    return struct.pack(">Q", UNIX + int(time_s * 1e6)) + frame


def flight_of(
    sender, seconds: int, *, v1: bool = False, rpm: int = 1900, later: float = 0.0
) -> bytes:
    """A short made flight at 10 Hz: attitude, rotor speeds and tank; `sender(message)` packs.

    The vehicle's clock starts at 10 s; the ground's is `later` s on.
    """
    out = []
    for tick in range(seconds * 10):
        t = 10.0 + tick / 10
        boot = int(t * 1000)
        messages = [
            dialect.MAVLink_attitude_message(boot, 0.01, 0.02, 0.03, 0, 0, 0),
            dialect.MAVLink_named_value_float_message(boot, b"TANK", 9.0 - tick / 1000),
        ]
        if not v1:
            four = [rpm + tick, rpm + 1, rpm + 2, rpm + 3]
            esc = dialect.MAVLink_esc_telemetry_1_to_4_message(
                [30] * 4, [5600] * 4, [1500] * 4, [1] * 4, four, [tick + 1] * 4
            )
            messages.append(esc)
        out += [stamped(sender(message), t + 0.05 + later) for message in messages]
    return b"".join(out)
