"""Outputs of the monitor: page, recording, announcements, metrics, each one an `Output`.

A new output is one file with a class and a function `output(context, value)` that makes it, and one
line in a table: `OUTPUTS` of `commands/flight/monitor.py`, or of the `__init__` of an extra.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.live.alarms.alarm import AlarmEvent
    from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
    from thrustmargin.gcs_plugin.live.watch.update import Update
    from thrustmargin.gcs_plugin.mavlink.frame import Frame


class Output:
    """A receiver of all that the monitor finds; each method of this base class does nothing.

    The monitor calls `start` before the first frame and `close` after the last update. It calls
    every other method on its compute thread, except `on_frames`, `on_happening` and `on_plan`, so
    these calls must return quickly. An output that raises an exception is closed and reported; the
    other outputs go on.
    """

    name = "an output"  # by which an error of this output is reported

    def start(self) -> None:
        """Open ports, files and threads. Raises LinkError where that is not possible."""

    def on_frames(self, frames: list[Frame]) -> None:
        """Take a batch of frames as they arrived; called on the link threads."""

    def on_update(self, update: Update) -> None:
        """Take new rows of one vehicle."""

    def on_event(self, vehicle: int, event: AlarmEvent) -> None:
        """Take a change of an alarm: raised, cleared, not confirmed or confirmed again."""

    def on_note(self, vehicle: int, text: str, unix_s: float) -> None:
        """Take a note on a vehicle that is no alarm: a restart, its airframe, its mission."""

    def on_happening(
        self, at_us: int, vehicle: int | None, kind: str, text: str, more: Mapping[str, object]
    ) -> None:
        """Take an event for the record: appeared, left, returned, acknowledged or note.

        `at_us` is the ground's clock, µs; `vehicle` is None for the whole link; `more` are further
        fields of the record. Called on any thread.
        """

    def on_round(self, fleet: Fleet, now_us: int) -> None:
        """Look at all vehicles after a round of analysis, also where nothing is new.

        `now_us` is the ground's clock, µs.
        """

    def on_plan(self, vehicle: int, text: str) -> None:
        """Take a sentence on how the plan is flown; called on a thread of the plan's watch."""

    def on_links_closing(self) -> None:
        """Stop sending: the links close next. The last rows are still to come."""

    def close(self) -> None:
        """Finish files and free ports; may be called twice, and without `start`."""
