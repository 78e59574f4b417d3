"""The rotor that needs more thrust than the model says and than all others: a CUSUM of each.

With e_i = (N_i/N_i,predicted)^2 - 1, what rotor i needs beyond the model,
    x_i = e_i - max e_j - (max e_j - min e_j),  j != i       S_i = max(0, S_i + (x_i - k) dt)
One damaged rotor stands out from all others, which agree; a wrong mass, thin air, a turn, a shifted
centre of gravity, or two of these together move pairs or all, and give no x_i. While the others are
more than 0.05 apart S_i does not fall. E. S. Page, Continuous Inspection Schemes, Biometrika 41
(1954); k = 0.02 and 0.04 s are chosen on the healthy campaign flights and on losses
of a propeller put into them.
"""

from __future__ import annotations

import numpy as np

from thrustmargin.gcs_plugin.live.alarm import AlarmSettings
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.analysis import FlightAnalysis


class RotorSums:
    """The sums of one vehicle, kept up by `add`: `sums` (R,) s."""

    def __init__(self, settings: AlarmSettings) -> None:
        self.sums: Floats = np.zeros(0)
        self._settings = settings
        self._needed = self._since = np.zeros(0)

    @property
    def needed(self) -> Floats:
        """(R,) mean share of thrust needed beyond the others since the sum last left zero."""
        return self._needed / np.maximum(self._since, 1e-3)

    def add(self, excess: Floats, step: float) -> bool:
        """One row in order, `step` s after the last; `excess` (R,) as `thrust_excess`.

        False where there is nothing to judge by, and the sums rest.
        """
        s = self._settings
        if not np.mean(excess) > -s.rotor_unloaded:
            # Without data, or with the legs on the ground before that is reported, the sum rests.
            return False
        if self.sums.size != excess.size:
            self.sums, self._needed, self._since = np.zeros((3, excess.size))
        # A pause in the rows counts as one short step: what happened in it is not known.
        seconds = min(step, 0.5) if step > 0.0 else 0.0
        stands_out, spread = standing_out(excess)
        gain = stands_out - spread - s.rotor_slack
        # While the others disagree (a turn), not standing out says nothing of a rotor's health.
        gain = np.where(spread > s.rotor_agree, np.maximum(gain, 0.0), gain)
        grown = self.sums + gain * seconds
        # Capped, so that the end of a fault is seen as fast as its beginning.
        self.sums = np.clip(grown, 0.0, 3.0 * s.rotor_threshold)
        apart = (excess - np.median(excess)) * seconds
        running = self.sums > 0.0
        self._needed = np.where(running, self._needed + apart, 0.0)
        self._since = np.where(running, self._since + seconds, 0.0)
        return True


def thrust_excess(analysis: FlightAnalysis) -> Floats:
    """(T, R) thrust that each rotor needs beyond the model, as a share of the model's.

    NaN for a speed from a motor's output: one motor differs from the next by more than is sought.
    """
    measured = np.where(analysis.from_outputs, np.nan, analysis.track.rotor_speed_rpm)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = measured / analysis.prediction.rotor_speed_rpm
    return ratio**2 - 1.0


def standing_out(excess: Floats) -> tuple[Floats, Floats]:
    """By how much each rotor's excess (R,) is above the highest other, and the others' spread."""
    ordered = np.sort(excess)
    highest = np.where(excess == ordered[-1], ordered[-2], ordered[-1])
    lowest = np.where(excess == ordered[0], ordered[1], ordered[0])
    return excess - highest, highest - lowest
