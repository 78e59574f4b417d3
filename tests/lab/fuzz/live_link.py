"""A damaged link: what is left of a log's frames, with checksums that hold again, watched live."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from thrustmargin.gcs_plugin.link.sender import Sender
from thrustmargin.gcs_plugin.live.announce import Announcer
from thrustmargin.gcs_plugin.live.console import answer_lines, vehicle_cells
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.gcs_plugin.live.pilot_bar import PilotBar
from thrustmargin.gcs_plugin.live.watch.update import WatchSettings
from thrustmargin.gcs_plugin.mavlink.frame import Frame, checksum, frame_of
from thrustmargin.gcs_plugin.mavlink.layouts import layouts
from thrustmargin.gcs_plugin.view.live_view import HeardVehicles
from thrustmargin.models.model.rotor_model import RotorModel

HEAD, SUM = 10, 2  # bytes of MAVLink 2 before and after the payload
ROUND = 20  # frames that come together
BEGUN_US, STEP_US = 1_795_000_000_000_000, 17_000  # as many a second as the logs have


def whole_frames(data: bytes) -> Iterator[Frame]:
    """Every stretch that begins as a frame of a known message does, with its checksum made anew.

    They come by a clock of this computer, which no damage reaches.
    """
    at, stamp_us = data.find(b"\xfd"), BEGUN_US
    while at >= 0:
        end = at + HEAD + (data[at + 1] if at + HEAD <= len(data) else len(data))
        layout = layouts().get(int.from_bytes(data[at + 7 : at + HEAD], "little"))
        if layout is None or end + SUM > len(data):
            at = data.find(b"\xfd", at + 1)
            continue
        frame = data[at : at + 2] + b"\0" + data[at + 3 : end]  # not signed
        made = frame + checksum(frame[1:], layout.crc_extra).to_bytes(SUM, "little")
        stamp_us += STEP_US
        if (found := frame_of(made, stamp_us=stamp_us)) is not None:
            yield found
        at = data.find(b"\xfd", end + SUM)


class Unheard:
    """A link into which one can only speak."""

    def send(self, data: bytes, *, system: int | None = None, forwards: bool = False) -> None:
        del data, system, forwards


def watched(path: Path, model: RotorModel, *, given: bool) -> None:
    """All that a monitor makes of such a link: rows, alarms, answers, texts, bar, page, table."""
    frames = list(whole_frames(path.read_bytes()))
    fleet, heard = (
        Fleet(model, WatchSettings(airframe_given=given)),
        HeardVehicles(threading.Event()),
    )
    link: Any = Unheard()
    announcer, now_us = Announcer(Sender(link), battery=True), 0
    bar = PilotBar(lambda: now_us, limit=0.5, port=0, host="127.0.0.1")
    for first in range(0, len(frames), ROUND):
        some = frames[first : first + ROUND]
        now_us = some[-1].stamp_us
        fleet.take(some)
        for update in fleet.updates():
            heard.update(update)
        for vehicle, event in fleet.tick(now_us):
            announcer.on_event(vehicle, event)
        for one in (announcer, bar):
            one.on_round(fleet, now_us)
        heard.round(fleet, now_us)
        json.dumps(bar.content(), allow_nan=False)
    for update in fleet.finish():
        heard.update(update)
    for watch in fleet.vehicles.values():
        vehicle_cells(watch, now_us, 0.5, fleet.old_s)
        answer_lines(watch)
