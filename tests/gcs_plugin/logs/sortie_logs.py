"""Telemetry logs of two recorded flights in one, as a ground station left on makes them."""

from pathlib import Path

from tests.gcs_plugin.logs.log_files import later_flight, other_flight
from tests.import_graph import ROOT

HEAVY = ROOT / "sitl_logs/campaign/v4_m16_q2.5.tlog"
LIGHT = ROOT / "sitl_logs/campaign/v2_m4_q3.5.tlog"
TEN_MINUTES_US = 600_000_000


def rebooted(path: Path) -> Path:
    """The heavy flight, a restart of the vehicle, and the light one."""
    again = other_flight(LIGHT, later_us=TEN_MINUTES_US, system=1)
    path.write_bytes(HEAVY.read_bytes() + again)
    return path


def refilled(path: Path) -> Path:
    """The light flight and, on the same clock, the heavy one: disarmed on the ground between."""
    first = LIGHT.read_bytes()
    begun_us = int.from_bytes(first[:8], "big") + TEN_MINUTES_US  # both begin 36 s after a start
    path.write_bytes(first + later_flight(HEAVY, TEN_MINUTES_US, first_stamp_us=begun_us))
    return path
