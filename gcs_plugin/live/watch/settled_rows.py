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
        """Return the rows of `time_s` (T,), s, that become final with the rows from `first` on.

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
        """Return the rows of `time_s` (T,), s, that become final with the rows from `first` on: by
        their predictions, and by the search for faults.

        `at_once`: every row is final as soon as it is there.
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
        """Return events of rows with the ground's clock when the report came that gave them.

        Where predictions are final only later, that is the report that made them so; `last`: the
        end of what comes has. `time_s` (T,) is the track's, `arrays` are as `CARRIED`.
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
    """Return the rows of the last update that the next one needs, and the model's state before
    them.

    `look_back_s` is the time, s, that the model needs before a row.
    """
    time_s = last.analysis.track.time_s
    needed = min(last.settled, time_s.size - 1)
    back = np.searchsorted(time_s, time_s[needed] - look_back_s, side="right") - 1
    begin = max(min(int(back), time_s.size - SHOWN), 0)
    start = last.analysis.start if begin == 0 else last.analysis.state_at(begin)
    return slice(begin, None), start
