"""A flight that is over, read from its messages as a report reads its file.

Rows that were made as messages came hold the last value of each channel, and cannot know what came
later. A file's rows are interpolated, and its faults and loads are sought in the whole flight. So
that page, terminal and alarm say at the end what the report says, the messages of a flight are
kept, and read once more when it has landed.
"""

from __future__ import annotations

import struct
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.live.rows.vehicle_state import OF_ITSELF, OF_MISSION
from thrustmargin.gcs_plugin.live.watch.flight_so_far import FlightAdvice, FlightSoFar
from thrustmargin.gcs_plugin.live.watch.update import Later, WatchSettings
from thrustmargin.gcs_plugin.logs.log_answer import answer_log, matched_flights
from thrustmargin.gcs_plugin.mavlink.frame import Frame
from thrustmargin.gcs_plugin.mavlink.layouts import message_ids
from thrustmargin.models.errors import ThrustMarginError
from thrustmargin.models.flight import Bools
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.rotor_model import RotorModel

CHUNK_S = 10.0  # s of messages that are forgotten together
#: Messages sent rarely and valid from then on: stored as long as the vehicle is received.
_LASTING_NAMES = (
    *("HOME_POSITION", "GPS_GLOBAL_ORIGIN", "EXTENDED_SYS_STATE", "AUTOPILOT_VERSION"),
    *("STATUSTEXT", "SYSTEM_TIME"),
)
LASTING = OF_ITSELF | OF_MISSION | {message_ids()[name] for name in _LASTING_NAMES}


class LandedFlights:
    """The messages of one vehicle as the bytes of a .tlog, read when a flight is over.

    `later` schedules the reading.
    """

    def __init__(
        self, system: int, model: RotorModel, settings: WatchSettings, later: Later[FlightAdvice]
    ) -> None:
        self._system, self._model, self._settings, self._later = system, model, settings, later
        self._chunks: list[tuple[int, bytearray, bytearray]] = []  # first µs, all, what lasts
        self.landed_us = 0  # ground's clock of the last landing; 0 while it flies
        self._was_flying = False  # in the last row

    def take(self, frame: Frame) -> None:
        """Store one message."""
        stamp_us = frame.stamp_us
        if not self._chunks or stamp_us - self._chunks[-1][0] > CHUNK_S * 1e6:
            self._chunks.append((stamp_us, bytearray(), bytearray()))
        stamped = struct.pack(">Q", stamp_us) + frame.data
        _, whole, lasting = self._chunks[-1]
        whole += stamped
        if frame.id in LASTING:
            lasting += stamped

    def follow_landing(self, flying: Bools, stamp_us: NDArray[np.int64]) -> None:
        """Set `landed_us` to the stamp of the first row on the ground after the last in flight.

        `flying` (N,) flags rows in flight; `stamp_us` (N,) is the ground's clock, µs. It becomes 0
        where the last row is in flight, and stays if no row is, and none was.
        """
        up = np.flatnonzero(flying)
        down = int(up[-1]) + 1 if up.size else 0
        if up.size or self._was_flying:
            self._was_flying = down == flying.size
            self.landed_us = 0 if self._was_flying else int(stamp_us[down])

    def forget(self, before_us: float) -> None:
        """Drop messages before `before_us`, the ground's clock, µs, that are of no use later."""
        for k, (first_us, whole, lasting) in enumerate(self._chunks[:-1]):
            if self._chunks[k + 1][0] <= before_us and len(whole) > len(lasting):
                self._chunks[k] = first_us, lasting, lasting

    def answer(self, flight: FlightSoFar) -> Callable[[], FlightAdvice | None]:
        """Start an ended flight's report; return a function for its advice, None until ready.

        If no report can be made, it is the advice that `flight` has from the live rows.
        """
        tlog = b"".join(whole for _, whole, _ in self._chunks)
        read = partial(as_reported, tlog, self._model, self._settings, system=self._system)
        return self._later(lambda: read() or flight.so_far)


def as_reported(
    tlog: bytes, model: RotorModel, settings: WatchSettings, *, system: int
) -> FlightAdvice | None:
    """Return the advice that `report` gives for a vehicle's last flight, from the bytes of a .tlog.

    `system` is its system id. None where the flight cannot be read, or the file not be written, as
    on a full disk.
    """
    given, stated = settings.airframe_given, settings.as_of_a_file
    try:
        with tempfile.TemporaryDirectory(prefix="thrustmargin-") as folder:
            file = Path(folder) / f"vehicle {system}.tlog"
            file.write_bytes(tlog)
            flights = matched_flights(file, model, given=given, vehicle=system, **stated)
    except (ThrustMarginError, OSError):
        return None
    log, airframe_match = flights[-1]
    analysis = analyse(
        log.track, model, airframe_match=replace(airframe_match, source=settings.link)
    )
    answer = answer_log(log, analysis, settings.alarms.max_utilisation)
    return FlightAdvice(answer.advice, answer.contact)
