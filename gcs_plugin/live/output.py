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
    """A receiver of all results of the monitor; each method of this base class does nothing.

    The monitor calls `start` before the first frame and `close` after the last update. It calls
    every other method on its compute thread, except `on_frames`, `on_happening` and `on_plan`, so
    these calls must return quickly. An output that raises an exception is closed and reported; the
    other outputs continue.
    """

    name = "an output"  # by which an error of this output is reported

    def start(self) -> None:
        """Open ports, files and threads. Raises LinkError if that fails."""

    def on_frames(self, frames: list[Frame]) -> None:
        """Process a batch of frames in the order of arrival; called on the link threads."""

    def on_update(self, update: Update) -> None:
        """Process new rows of one vehicle."""

    def on_event(self, vehicle: int, event: AlarmEvent) -> None:
        """Process a change of an alarm: raised, cleared, not confirmed or confirmed again."""

    def on_note(self, vehicle: int, text: str, unix_s: float) -> None:
        """Process a note on a vehicle that is no alarm: a restart, its airframe, its mission."""

    def on_happening(
        self, at_us: int, vehicle: int | None, kind: str, text: str, more: Mapping[str, object]
    ) -> None:
        """Process an event for the record: appeared, left, returned, acknowledged or note.

        `at_us` is the ground's clock, µs; `vehicle` is the system id, None for the whole link;
        `more` are further fields of the record. Called on any thread.
        """

    def on_round(self, fleet: Fleet, now_us: int) -> None:
        """Process the state of all vehicles after a round of analysis, even without new rows.

        `now_us` is the ground's clock, µs.
        """

    def on_plan(self, vehicle: int, text: str) -> None:
        """Process a sentence on how the plan is flown; called on the thread that watches the
        plan."""

    def on_links_closing(self) -> None:
        """Stop sending: the links close next. The last rows are still to come."""

    def close(self) -> None:
        """Finish files and free ports; may be called twice, and without `start`."""
