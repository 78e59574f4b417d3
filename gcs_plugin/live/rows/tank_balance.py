"""Three independent estimates of what is in the tank, and how they compare.

- gauge: what the vehicle reports, by the same rules as for a log (`telemetry.battery_and_tank`);
- pump: what its servo output says has been sprayed, full output being the airframe's largest flow;
- thrust: what the rotors carry beyond what the model expects, as a mass ("virtual gauge").
They are compared over windows: `tank_verdict` says which of them parts from the others.

    virtual gauge  m = m_gauge + (sum T_measured - sum T_predicted)/g    with a gauge
                   m = sum T_measured/g - m_empty                        without, in steady flight
T by the thrust curve from rotor speeds; a quasi-steady balance of forces, so that only means over
many seconds count.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from thrustmargin.models.flight import Floats
from thrustmargin.models.physics.atmosphere import G0

if TYPE_CHECKING:
    from thrustmargin.models.model.analysis import FlightAnalysis

NAN = float("nan")


class DeliveryMeter:
    """Delivery factor: mass leaving the tank over mass computed from the pump's output.

    It depends on the nozzles. The gauge gives it: `first` after the first kilogram, for the rest of
    the tank; `now` over the last 1.5 kg, to predict. It is 1 until enough was sprayed.
    """

    LEARN_KG, RECENT_KG = 1.0, 1.5

    def __init__(self) -> None:
        self.first = self.now = 1.0
        self._learnt = False
        self._points: deque[tuple[float, float]] = deque()  # kg by the gauge, kg pumped

    def add(self, gauge: float, pumped: float) -> None:
        """Add the next sample: kg by the gauge, and kg pumped so far; ignored if NaN.

        After LEARN_KG pumped, `now` becomes the fall of the gauge over the kg pumped of late, and
        `first` the earliest such factor, limited to 0.4 to 1.6. A refill, or a count that begins
        anew, begins the comparison anew; an almost empty gauge changes neither.
        """
        if not np.isfinite(gauge + pumped):
            return
        if self._points and (gauge > self._points[-1][0] + 0.5 or pumped < self._points[-1][1]):
            self._points.clear()  # refilled, or counted anew
        if not self._points or pumped - self._points[-1][1] >= 0.02:
            self._points.append((gauge, pumped))
        while len(self._points) > 2 and pumped - self._points[1][1] >= self.RECENT_KG:
            self._points.popleft()
        began, before = self._points[0]
        if pumped - before < self.LEARN_KG:
            return
        # A gauge at its end has stopped to fall whatever the pump does.
        if gauge > 0.3:
            self.now = (began - gauge) / (pumped - before)
            if not self._learnt:
                self.first, self._learnt = float(np.clip(self.now, 0.4, 1.6)), True


def virtual_gauge(analysis: FlightAnalysis) -> Floats:
    """Return the mass of liquid by thrust (T,), kg; NaN without measured speeds, or on the ground.

    With a gauge it is the gauge's level plus the thrust that the model does not explain. Without
    one it is all thrust beyond the empty mass, which is true in level flight without acceleration.
    """
    track, airframe = analysis.track, analysis.model.airframe
    # A speed from a motor's output was set by the very weight that is asked for here.
    measured = np.where(analysis.from_outputs, np.nan, analysis.thrust)
    carried = np.sum(measured, axis=1)
    expected = np.sum(analysis.prediction.thrust, axis=1)
    gauge = track.measured("tank_kg")
    with_gauge = gauge + (carried - expected) / G0
    without = carried / G0 - airframe.empty_mass
    mass = np.where(np.isfinite(gauge), with_gauge, without)
    return np.where(track.flying, mass, np.nan)


@dataclass(frozen=True, slots=True)
class TankBalance:
    """The loss of the tank over a window by each estimate, kg; NaN where one is missing."""

    seconds: float
    gauge: float
    pump: float
    thrust: float
    level_kg: float  # by the gauge at its end
    apart_kg: float  # virtual gauge less gauge, mean over the window


class BalanceWatch:
    """The estimates of gauge, pump and thrust over a sliding window of `seconds` s.

    Their means over the first and the last `end` s of the window are compared.
    """

    def __init__(self, seconds: float = 40.0, end: float = 10.0) -> None:
        self.seconds, self.end = seconds, end
        #: (4, N) of which columns `_first` to `_last` are the window; moved back when it is full.
        self._rows = np.empty((4, 1024))
        self._first = self._last = 0

    def add(self, time_s: float, gauge: float, pumped: float, virtual: float) -> None:
        """Add the next sample: time, s; kg by gauge; kg pumped so far; kg by virtual gauge.

        NaN where unknown. A step back in time, or a pause of more than 5 s, begins a new window.
        """
        if self._last > self._first and not 0.0 <= time_s - self._rows[0, self._last - 1] <= 5.0:
            self._first = self._last
        if self._last == self._rows.shape[1]:
            window = self._rows[:, self._first :].copy()
            self._first, self._last = 0, window.shape[1]
            self._rows = np.pad(window, ((0, 0), (0, max(self._last, 1024))))
        self._rows[:, self._last] = time_s, gauge, pumped, virtual
        self._last += 1
        while time_s - self._rows[0, self._first] > self.seconds:
            self._first += 1

    def balance(self) -> TankBalance | None:
        """Return the tank's loss over the window by each estimate, kg; None until full.

        A loss is the mean over the first `end` s less the mean over the last; NaN if either is
        unknown.
        """
        rows = self._rows[:, self._first : self._last]
        time_s = rows[0]
        if not time_s.size or time_s[-1] - time_s[0] < 0.95 * self.seconds:
            return None
        first = rows[:, : time_s.searchsorted(time_s[0] + self.end, side="right")]
        last = rows[:, time_s.searchsorted(time_s[-1] - self.end) :]
        lost = [_mean(first[k]) - _mean(last[k]) for k in (1, 2, 3)]
        return TankBalance(
            seconds=_mean(last[0]) - _mean(first[0]),
            gauge=lost[0],
            pump=-lost[1],
            thrust=lost[2],
            level_kg=float(rows[1, -1]),
            apart_kg=_mean(rows[3] - rows[1]),
        )


def _mean(values: Floats) -> float:
    known = values[np.isfinite(values)]
    return float(np.add.reduce(known) / known.size) if known.size else NAN
