"""What to fill, on the page while the aircraft stands: the numbers of `thrustmargin fill`."""

from __future__ import annotations

import math

from thrustmargin.gcs_plugin.wording import view_words as words
from thrustmargin.gcs_plugin.wording.fill_words import UNSOUND, fill_advice
from thrustmargin.gcs_plugin.wording.language import say
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.fill_limits import before_take_off, largest_fills

AIRSPEED = 5.0  # m/s, what `thrustmargin fill` takes unless it is asked for another
CHANGE = 0.003  # of air density, from which it is worked out anew


class FillAdvice:
    """The advice for one aircraft on the ground; it is worked out again when the air changes.

    The battery counts at its nominal voltage: at rest its voltage is not that under load.
    """

    def __init__(self, limit: float) -> None:
        self._limit = limit  # share of a rotor's maximum thrust that may be in use
        self._known: tuple[object, float] | None = None
        self._text = ""

    def text(self, analysis: FlightAnalysis) -> str:
        """In words; empty in flight, and where no airframe is claimed or no air is known."""
        model, density = analysis.model, float(analysis.density[-1])
        if analysis.track.flying[-1] or analysis.withheld or not math.isfinite(density):
            return ""
        if analysis.bad_part:
            return f"{say(UNSOUND)}."
        known = self._known
        if known is None or known[0] is not model or abs(density / known[1] - 1.0) > CHANGE:
            self._known = (model, density)
            self._text = self._made(analysis, density)
        return self._text

    def _made(self, analysis: FlightAnalysis, density: float) -> str:
        model = analysis.model
        volts = model.airframe.nominal_voltage
        fills = largest_fills(model, density, volts, airspeed=AIRSPEED, max_utilisation=self._limit)
        fill = before_take_off(fills, model)
        advice = fill_advice(fill, self._limit)
        rests = words.fill_rests_on(density, analysis.density_basis, volts, AIRSPEED)
        return f"{advice}. {rests}"
