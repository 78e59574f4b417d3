"""Which rows of one vehicle are final, and which the next update of it still needs.

A model with effects reads later rows: its prediction of a row is final only when later rows are
known. The search for faults reads rows later still. Neither has a clock of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.live.alarms.alarm import AlarmEvent
from thrustmargin.gcs_plugin.live.alarms.alarm_rules import OF_SETTLED_ROWS, OF_SOUGHT_ROWS
from thrustmargin.gcs_plugin.live.watch.update import Update
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.analysis import FlightState
from thrustmargin.models.model.rotor_faults import fault_model
from thrustmargin.models.model.rotor_model import RotorModel

#: Rows of which screens show a mean, and in which a loss of control lasts: so many stay at least.
SHOWN = 20
#: Arrays of an Update that the next one goes on with.
CARRIED = ("clock_s", "stamp_us", "pumped_kg", "delivered_kg", "margin_ahead")


class RowHorizon:
    """A tracker of which rows are final, because `look_s` s of later rows are known."""

    def __init__(self, look_s: float) -> None:
        self.look_s = look_s
        self._waiting = 0  # of the known rows, the last so many

    def restart(self) -> None:
        """Forget the waiting rows, because the next rows do not continue them."""
        self._waiting = 0

    def settled(self, time_s: Floats, first: int, *, at_once: bool) -> slice:
        """Return the slice of the rows that become final with the rows from `first` on.

        `time_s` (T,), s, are all known rows, of which a final one has `look_s` s of later ones.
        `at_once`: every row is final as soon as it arrives.
        """
        begin, until = first - self._waiting, time_s.size
        if self.look_s > 0.0 and not at_once:
            known = np.searchsorted(time_s, time_s[-1] - self.look_s, side="right")
            until = max(int(known), begin)
        self._waiting = time_s.size - until
        return slice(begin, until)


class SettledRows:
    """The rows of one vehicle in which predictions are final, and in which faults were sought."""

    def __init__(self, model: RotorModel) -> None:
        self._effects = bool(model.effects)
        self._predicted = RowHorizon(model.look_ahead_s)
        self._sought = RowHorizon(fault_model(model).look_ahead_s)

    def restart(self) -> None:
        """Forget the waiting rows, because the next rows do not continue them."""
        self._predicted.restart()
        self._sought.restart()

    def settled(self, time_s: Floats, first: int, *, at_once: bool) -> tuple[slice, slice]:
        """Return two slices of the rows that become final with the rows from `first` on.

        The first is by their predictions, the second by the search for faults. `time_s` (T,), s,
        are all known rows. `at_once`: every row is final as soon as it arrives.
        """
        at_once = at_once or not self._effects
        return (
            self._predicted.settled(time_s, first, at_once=at_once),
            self._sought.settled(time_s, first, at_once=at_once),
        )

    def stamped(
        self,
        events: Sequence[AlarmEvent],
        time_s: Floats,
        arrays: Mapping[str, NDArray[Any]],
        *,
        last: bool,
    ) -> tuple[AlarmEvent, ...]:
        """Return the events with the Unix time of the report that showed them, sorted by it.

        Where predictions are final only later, that is the report that made them final. `last`: no
        further report will come, and the newest counts. `time_s` (T,) is the track's, s; `arrays`
        are those that CARRIED names, on the same rows.
        """
        later = {rule.name for rule in OF_SETTLED_ROWS} if self._effects else set[str]()
        if self._sought.look_s > 0.0:
            later |= {rule.name for rule in OF_SOUGHT_ROWS}
        made = []
        for event in events:
            row = int(np.searchsorted(arrays["clock_s"], event.time_s))
            if event.alarm.name in later:
                row = int(np.searchsorted(time_s, time_s[row] + self._predicted.look_s))
            row = time_s.size - 1 if last else min(row, time_s.size - 1)
            made.append(replace(event, unix_s=float(arrays["stamp_us"][row]) * 1e-6))
        return tuple(sorted(made, key=lambda event: event.unix_s))


def kept_rows(last: Update, look_back_s: float) -> tuple[slice, FlightState | None]:
    """Return the rows of the last update that the next needs, and the model's state before them.

    They are the rows that are not final, and `look_back_s` s before, which the model needs; at
    least SHOWN.
    """
    time_s = last.analysis.track.time_s
    needed = min(last.settled, time_s.size - 1)
    back = np.searchsorted(time_s, time_s[needed] - look_back_s, side="right") - 1
    begin = max(min(int(back), time_s.size - SHOWN), 0)
    start = last.analysis.start if begin == 0 else last.analysis.state_at(begin)
    return slice(begin, None), start
