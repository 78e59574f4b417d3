"""The values that can colour the route: one value a row, its scale, and which end is the worst.

A further quantity is one more `Overlay`; nothing else changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.wording import live_words as words
from thrustmargin.gcs_plugin.wording import palette as colours
from thrustmargin.gcs_plugin.wording.alarm_words import SPINS
from thrustmargin.gcs_plugin.wording.effect_sentences import effect_things
from thrustmargin.gcs_plugin.wording.language import Sentence, clock, say
from thrustmargin.gcs_plugin.wording.palette import ColourScale
from thrustmargin.mission.route import Worst
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.model.analysis import FlightAnalysis, worst_rotor

#: Share of the rows of a flight that the scale of its residual leaves outside.
BEYOND_SCALE = 0.02


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Overlay:
    """A way to colour the route: values by row, and a colour scale."""

    name: str  # as listed in the switch
    values: Floats  # (T,) NaN where unknown
    scale: ColourScale
    worst: Worst
    #: (T,) index of the rotor that the value belongs to; None, or NaN in a row: the vehicle's own.
    rotor: Floats | None = None
    note: str = ""  # what the values rest on, shown with the legend
    extreme: str = "worst"  # what its worst value is called

    def at(self, row: int, time_s: float, rotor_names: Sequence[str]) -> dict[str, Any]:
        """Return the value of row `row` as a JSON object for the page, with its rotor and time.

        Keys: `extreme` (what the worst value is called), `value` (text with unit, "no data" if
        unknown), `number` (of the rotor, from 1), `place` (the rotor's name) and `time` (`time_s`,
        s, as clock text). `number` is None and `place` "" where the value is not a rotor's.
        """
        whose = np.nan if self.rotor is None else self.rotor[row]
        rotor = int(whose) if np.isfinite(whose) else None
        return {
            "extreme": self.extreme,
            "value": self.scale.number(float(self.values[row])),
            "number": None if rotor is None else rotor + 1,
            "place": "" if rotor is None else rotor_names[rotor],
            "time": clock(time_s),
        }

    def worst_row(self, among: Bools) -> int | None:
        """Return the index of the worst value among the flagged rows (T,); None where none is
        known."""
        score = {"max": self.values, "min": -self.values, "abs": np.abs(self.values)}[self.worst]
        score = np.where(among & np.isfinite(score), score, -np.inf)
        return int(np.argmax(score)) if np.isfinite(score).any() else None


def overlays_of(analysis: FlightAnalysis, least: float = 0.5) -> tuple[Overlay, ...]:
    """Return the overlays thrust left, redundancy and residual of an analysis, in this order.

    `least` is the share of thrust that must be left, at which the colours of thrust left change.
    Where no rotor was measured the predicted value is used; a note states the measured share of the
    rows.
    """
    use = analysis.known_utilisation
    load, rotor = worst_rotor(use)
    note = _basis_note(analysis, np.isfinite(load))
    return (
        Overlay(
            name=words.THRUST_LEFT,
            values=1.0 - load,
            scale=colours.thrust_left(least),
            worst="min",
            rotor=rotor,
            note=note,
        ),
        Overlay(
            name="Redundancy",
            values=analysis.redundancy_yaw_uncontrolled,
            scale=colours.REDUNDANCY,
            worst="min",
            note=Sentence.of(lambda: say(SPINS)),
        ),
        _residual("Residual", analysis),
    )


def planned_overlays(analysis: FlightAnalysis, limit: float) -> tuple[Overlay, ...]:
    """Return the overlays thrust left, redundancy and tank, kg, of a plan that is not flown yet.

    `limit` is the largest share of a rotor's maximum thrust that may be in use.
    """
    left, redundancy, _ = overlays_of(analysis, 1.0 - limit)
    tank = analysis.track.tank_kg
    return (
        replace(left, note=Sentence.of(lambda: say(words.PLANNED))),
        replace(redundancy, note=Sentence.of(lambda: f"{say(SPINS)}, {say(words.PLANNED)}")),
        Overlay(
            name=words.TANK_SHOWN,
            values=tank,
            scale=colours.tank_scale(float(np.nanmax(tank, initial=0.0))),
            worst="max",
            extreme="fullest",
        ),
    )


def speed_overlay(track: FlightTrack) -> Overlay:
    """Return the colouring by ground speed, m/s, which needs no airframe."""
    speed = np.hypot(track.velocity_ned[:, 0], track.velocity_ned[:, 1])
    return Overlay(
        name="Speed", values=speed, scale=colours.GROUND_SPEED, worst="max", extreme="fastest"
    )


def before_and_after(before: FlightAnalysis, after: FlightAnalysis) -> tuple[Overlay, Overlay]:
    """Return overlays of the residual, rpm, of one flight under two models, on one colour scale.

    The scale ends at the value that 98 % of the rows in flight under the first model do not exceed.
    Raise DataError if the two are of different flights.
    """
    if before.track is not after.track:
        raise DataError(
            f"{before.track.name} and {after.track.name} are two flights; the residual before and "
            "after is of one"
        )
    first = _residual(words.RESIDUAL_BEFORE, before, _model_note(before))
    second = _residual(words.RESIDUAL_AFTER, after, _model_note(after))
    return first, replace(second, scale=first.scale)


def _residual(name: str, analysis: FlightAnalysis, note: str = "") -> Overlay:
    values, rotor = worst_rotor(analysis.residual_rpm, np.abs(analysis.residual_rpm))
    limit = residual_limit(values, analysis.track.flying)
    scale = colours.residual_scale(limit)
    return Overlay(name=name, values=values, scale=scale, worst="abs", rotor=rotor, note=note)


def residual_limit(residual_rpm: Floats, flying: Bools) -> float:
    """Return the end of the residual's colour scale: the 98 % quantile, rpm, of its size (T,).

    Only rows that `flying` (T,) flags count. At least 1; 1 where no residual is known.
    """
    size = np.abs(residual_rpm)[flying & np.isfinite(residual_rpm)]
    return max(1.0, float(np.quantile(size, 1.0 - BEYOND_SCALE))) if size.size else 1.0


def _model_note(analysis: FlightAnalysis) -> str:
    """Return a note that describes the model by its effects."""
    return Sentence.of(lambda: words.model_with(effect_things(analysis.model)))


def _basis_note(analysis: FlightAnalysis, known: Bools) -> str:
    """Return a note on the share of rows in which a rotor's speed was measured.

    Only rows in flight that `known` (T,) flags count; empty without any.
    """
    flying, basis = analysis.track.flying, analysis.speed_basis
    rows = known[flying]
    if not rows.any():
        return ""
    share = float(np.mean(analysis.any_measured[flying][rows]))
    if share == 1.0:
        return Sentence.of(lambda: say(basis))
    if share == 0.0:
        return Sentence.of(lambda: say(words.ALL_PREDICTED))
    return Sentence.of(lambda: words.measured_share(basis, share))
