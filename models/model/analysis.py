"""One flight through the model: prediction, ceiling, utilisation, margin and redundancy per row.

Replay, report and monitor all show these arrays; none of them computes its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from thrustmargin.models.checks.speed_readings import reading_scatter
from thrustmargin.models.effects.base import FlightState as FlightState
from thrustmargin.models.effects.channels import own_channels
from thrustmargin.models.errors import AirframeError
from thrustmargin.models.flight import Bools, FlightTrack, Floats
from thrustmargin.models.model.airframe_claim import (
    AirframeClaim,
    airframe_claim,
    unknown_aircraft,
)
from thrustmargin.models.model.inferred.load_inference import with_load_for_verdict
from thrustmargin.models.model.inferred.speed_basis import SpeedBasis as SpeedBasis
from thrustmargin.models.model.inferred.speed_basis import speed_basis
from thrustmargin.models.model.inferred.utilisation_error import (
    INTERVAL,
    beyond_load,
    redundancy_error,
    utilisation_error,
)
from thrustmargin.models.model.predict import Basis as Basis
from thrustmargin.models.model.predict import Prediction as Prediction
from thrustmargin.models.model.predict import identified_airframe, predict, temperature_offset
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.model.thermometer import by_thermometer
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import G0, track_air
from thrustmargin.models.physics.margin import (
    ceiling,
    redundancy,
    rotor_thrust,
    trimmable_loss,
    utilisation,
    weight,
)
from thrustmargin.models.vehicle_facts import VehicleFacts

GIVEN_AIR = "given with the flight"  # in the words of the basis


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightAnalysis:
    """Everything that a screen or a report says about T rows of one flight."""

    track: FlightTrack
    model: RotorModel
    density: Floats  # (T,) kg/m³
    density_error: Floats  # (T,) kg/m³, standard error
    density_given: bool  # by whoever analyses, and not made from the track
    density_basis: str  # for people
    voltage_basis: str  # for people
    prediction: Prediction
    residual_rpm: Floats  # (T, R) measured minus predicted; NaN where the load was inferred from it
    max_rotor_speed_rpm: Floats  # (T,) rpm, ceiling at the battery's voltage
    max_thrust: Floats  # (T, R) N
    thrust: Floats  # (T, R) N from the measured rotor speed, or that from motor outputs
    utilisation: Floats  # (T, R) from the same speed
    utilisation_error: Floats  # (T, R) standard error of the known utilisation, to the high side
    utilisation_beyond: Floats  # (T, R) part of it that the low side has not
    utilisation_predicted: Floats  # (T, R) from the predicted rotor speed
    weight: Floats  # (T,) N of the vehicle with its liquid
    redundancy_yaw_kept: Floats  # (T,) worst single rotor lost: holdable thrust over weight
    redundancy_yaw_uncontrolled: Floats  # (T,) the same with yaw uncontrolled
    redundancy_error: Floats  # (T,) standard error of ln of either, to the low side
    redundancy_beyond: float  # part of it that the high side has not
    trimmable_loss: Floats  # (T,) largest share of one rotor's thrust that can be lost in trim
    claim: AirframeClaim  # on what ground it is a flight of the model's airframe
    start: FlightState | None = None  # that the first row was analysed from
    #: kg that hover thrust shows beyond gauge or statement, where they surely differ.
    beyond_gauge_kg: float = 0.0
    #: A rotor or motor of it is bad: see `with_bad_part`.
    bad_part: bool = False

    def __repr__(self) -> str:
        def worst(use: Floats) -> str:
            return f"{np.nanmin(1.0 - use):.1%}" if np.isfinite(use).any() else "unknown"

        error = self.residual_rpm[np.isfinite(self.residual_rpm)]
        off = f"{np.sqrt(np.mean(error**2)):.1f} rpm" if error.size else "unknown"
        return (
            f"FlightAnalysis of {self.track.name}: {self.track.time_s.size} rows, "
            f"{self.track.duration:.1f} s\n"
            f"  model: {self.model.description}\n"
            f"  least thrust margin {worst(self.utilisation)} {self.speed_basis}, "
            f"{worst(self.utilisation_predicted)} predicted; rotor speed error {off} RMS\n"
            f"  air: {self.density_basis}\n  ceiling: {self.voltage_basis}"
            + (f"\n  {self.claim.described}" if self.claim.described else "")
        )

    def state_at(self, row: int) -> FlightState:
        """What the model's effects carry at a row, from which a window that begins there goes on.

        Raises IndexError for a row that the track does not have.
        """
        rows = range(self.track.time_s.size)[row] + 1
        effects = [p.effect for p in self.model.placed if p.effect.own_channel is not None]
        if not effects:
            return FlightState()
        before = self.track.rows(slice(0, rows))
        return own_channels(before, self.model.airframe, effects, self.start)[1]

    @property
    def withheld(self) -> tuple[str, ...]:
        """Why no margin is claimed: then all that needs the airframe is NaN; empty when it is."""
        return self.claim.withheld

    @property
    def places(self) -> tuple[str, ...]:
        """Where each rotor sits; empty words where the flight's motors are in another order."""
        names = self.model.airframe.rotor_names
        return ("",) * len(names) if self.claim.other_order else names

    @property
    def placed(self) -> bool:
        """Whether the place of each rotor is known, so that it may be drawn there."""
        return not (self.claim.withheld or self.claim.other_order)

    @property
    def margin(self) -> Floats:
        """(T, R) thrust margin, 1 - utilisation, from measured rotor speeds."""
        return 1.0 - self.utilisation

    @property
    def margin_predicted(self) -> Floats:
        """(T, R) thrust margin from predicted rotor speeds."""
        return 1.0 - self.utilisation_predicted

    @property
    def measured(self) -> Bools:
        """(T,) rows in which every rotor's speed was measured."""
        return np.all(np.isfinite(self.utilisation), axis=1)

    @property
    def any_measured(self) -> Bools:
        """(T,) rows in which at least one rotor's speed was measured."""
        return np.any(np.isfinite(self.utilisation), axis=1)

    @property
    def known_utilisation(self) -> Floats:
        """(T, R) thrust utilisation by which screen, alarms and report warn.

        That of the rotors whose speed was measured; a silent rotor stays NaN, for a prediction
        beside measurements would be compared with them. In a row without any, all are predicted.
        """
        return np.where(self.any_measured[:, None], self.utilisation, self.utilisation_predicted)

    @property
    def use_ends(self) -> tuple[Floats, Floats]:
        """(T, R) low and high end of the 90 % interval of the known utilisation, NaN unknown.

        Of an error that is not known there is the value alone. No error reaches beyond all.
        """
        use = self.known_utilisation
        down, up = (INTERVAL * np.nan_to_num(error) for error in self.row_errors)
        return np.maximum(use - down, 0.0), np.minimum(use + up, np.maximum(use, 1.0))

    @property
    def row_errors(self) -> tuple[Floats, Floats]:
        """(T, R) standard errors of the known utilisation in single rows to the low and the high
        side, with the scatter of the readings that its speeds are made of."""
        single = 2.0 * reading_scatter(self.track).share * self.utilisation
        low = self.utilisation_error - self.utilisation_beyond
        errors = (low, self.utilisation_error)
        one, other = (np.hypot(error, np.nan_to_num(single)) for error in errors)
        return one, other

    @property
    def from_outputs(self) -> Bools:
        """(T, R) rotors whose speed was not measured, but made from their motor's output."""
        error = self.track.standard_errors.get("rotor_speed_rpm")
        return np.zeros(self.utilisation.shape, bool) if error is None else error > 0.0

    @property
    def speed_basis(self) -> SpeedBasis:
        """What `utilisation` rests on where it is known."""
        return speed_basis(self.track)

    def basis_of(self, row: int, rotor: int) -> SpeedBasis:
        """What a rotor's margin rests on in a row."""
        if np.isfinite(self.utilisation[row, rotor]):
            inferred = self.from_outputs[row, rotor]
            return SpeedBasis.MOTOR_OUTPUTS if inferred else SpeedBasis.MEASURED
        known = np.isfinite(self.utilisation_predicted[row, rotor])
        return SpeedBasis.PREDICTED if known else SpeedBasis.UNKNOWN

    def above_limit(self, limit: float) -> Bools:
        """(T,) rows off the ground in which the known utilisation of a rotor is more than `limit`.

        One rotor is enough, whatever is known of the others: a silent ESC hides no overload.
        """
        return self._more_than(limit, 0.0)

    def surely_above(self, limit: float) -> Bools:
        """(T,) as `above_limit`, where the whole 90 % interval of that rotor is."""
        return self._more_than(limit, -INTERVAL)

    def maybe_above(self, limit: float) -> Bools:
        """(T,) as `above_limit`, where any of the interval is."""
        return self._more_than(limit, INTERVAL)

    def _more_than(self, limit: float, errors: float) -> Bools:
        use = self.known_utilisation + errors * self.row_errors[errors > 0.0]
        with np.errstate(invalid="ignore"):
            return self.track.flying & np.any(use > limit, axis=1)


def analyse(
    track: FlightTrack,
    model: RotorModel,
    density: Floats | None = None,
    *,
    start: FlightState | None = None,
    claim: AirframeClaim | None = None,
) -> FlightAnalysis:
    """Run one flight of T rows and R rotors through the model.

    `density` (T,) kg/m³ replaces that made from the track's own pressure or altitude. A row lacks
    (is NaN in) what needs a channel that it lacks: thrust and use need rotor speed; weight,
    redundancy and trimmable loss the tank. Voltage and density have stated fallbacks.

    `claim` says on what ground the flight is one of the model's airframe; without it the model is
    taken as given, and the flight itself is asked for what speaks against it. Where something does,
    no margin is claimed: the analysis is that of an aircraft of which nothing is known.

    A track may be a window of a flight: its `time_s` counts from the flight's start, and `start` is
    `state_at` of its first row in the window before. Rows at least `model.look_back_s` after the
    window's first row (where that is not the flight's) and `model.look_ahead_s` before its last
    are as those of the whole flight.
    Raises AirframeError when the flight has another number of rotors than the model's airframe.

        >>> flight = analyse(read_log("sitl_logs/campaign/v4_m16_q2.5.tlog").track, load_model())
        >>> round(float(flight.margin.min()), 2)
        0.25
    """
    if claim is None:
        require_rotors(track, model.airframe)
        facts = VehicleFacts()
        claim = airframe_claim(track, identified_airframe(model), facts, {}, given=True)
    if claim.withheld:
        model = unknown_aircraft(track.rotor_count)
    airframe = identified_airframe(model)
    require_rotors(track, airframe)
    track = by_thermometer(track, model.thermometer)
    if density is None:
        air = track_air(track, temperature_offset(model))
        rho, density_error, density_basis = air.density, air.density_error, air.basis
    else:
        rho, density_basis = np.asarray(density, dtype=np.float64), GIVEN_AIR
        density_error = np.zeros_like(rho)
    limits = ceiling(airframe, rho, track.voltage)
    prediction = predict(model, track, rho, start=start)
    load = weight(airframe, track.tank_kg)
    use = utilisation(track.rotor_speed_rpm, limits.max_rotor_speed_rpm)
    use_predicted = utilisation(prediction.rotor_speed_rpm, limits.max_rotor_speed_rpm)
    use_error, use_beyond = utilisation_error(
        track, airframe, prediction, use, use_predicted, claim.outputs
    )
    load_known = np.isfinite(track.measured("tank_kg"))[:, None]
    return FlightAnalysis(
        track=track,
        model=model,
        density=rho,
        density_error=density_error,
        density_given=density is not None,
        density_basis=density_basis,
        voltage_basis="no airframe" if claim.withheld else limits.voltage_basis,
        prediction=prediction,
        residual_rpm=np.where(load_known, track.rotor_speed_rpm, np.nan)
        - prediction.rotor_speed_rpm,
        max_rotor_speed_rpm=limits.max_rotor_speed_rpm,
        max_thrust=limits.max_thrust,
        thrust=rotor_thrust(airframe, track.rotor_speed_rpm, rho),
        utilisation=use,
        utilisation_error=use_error,
        utilisation_beyond=use_beyond,
        utilisation_predicted=use_predicted,
        weight=load,
        redundancy_yaw_kept=redundancy(airframe, limits, load, yaw_kept=True),
        redundancy_yaw_uncontrolled=redundancy(airframe, limits, load, yaw_kept=False),
        redundancy_error=redundancy_error(track, airframe, density_error / rho, claim.outputs),
        redundancy_beyond=beyond_load(track, airframe, claim.outputs),
        trimmable_loss=trimmable_loss(airframe, limits, load),
        start=start,
        claim=claim,
    )


def heavier(analysis: FlightAnalysis, beyond_kg: float) -> FlightAnalysis:
    """The rows of a flight that carries so many kg beyond its gauge: by `for_verdict`, of a flight
    that goes on, of which only some rows are at hand."""
    if not beyond_kg > 0.0:
        return analysis
    share = analysis.weight / (analysis.weight + G0 * beyond_kg)
    return replace(
        analysis,
        weight=analysis.weight / share,
        redundancy_yaw_kept=analysis.redundancy_yaw_kept * share,
        redundancy_yaw_uncontrolled=analysis.redundancy_yaw_uncontrolled * share,
        beyond_gauge_kg=beyond_kg,
    )


def with_bad_part(analysis: FlightAnalysis) -> FlightAnalysis:
    """The rows of an aircraft of which a rotor or motor was found bad.

    What the loss of one more would mean was worked out for sound ones: that it is survived is no
    longer known; that it is not holds all the more.
    """
    kept, free = analysis.redundancy_yaw_kept, analysis.redundancy_yaw_uncontrolled
    return replace(
        analysis,
        redundancy_yaw_kept=np.where(kept < 1.0, kept, np.nan),
        redundancy_yaw_uncontrolled=np.where(free < 1.0, free, np.nan),
        trimmable_loss=np.full_like(analysis.trimmable_loss, np.nan),
        bad_part=True,
    )


def read_as_true(analysis: FlightAnalysis, rotor: int, factor: float) -> FlightAnalysis:
    """The rows with thrust and use of a rotor, from 0, as of its true speed, where its ESC reads
    `factor` times that."""
    scale = np.ones(analysis.track.rotor_count)
    scale[rotor] = factor**-2.0
    return replace(
        analysis, thrust=analysis.thrust * scale, utilisation=analysis.utilisation * scale
    )


def for_verdict(analysis: FlightAnalysis) -> FlightAnalysis:
    """The analysis of a whole flight that its verdict rests on: with the larger load where gauge or
    statement and hover thrust surely differ; else the same one."""
    track = with_load_for_verdict(
        analysis.track, identified_airframe(analysis.model), analysis.claim.outputs
    )
    if analysis.withheld or track is analysis.track:
        return analysis
    given = analysis.density if analysis.density_given else None
    made = analyse(track, analysis.model, given, start=analysis.start, claim=analysis.claim)
    beyond = (track.tank_kg - analysis.track.tank_kg)[track.flying]
    return replace(made, beyond_gauge_kg=float(np.nanmedian(beyond)))


def worst_rotor(values: Floats, badness: Floats | None = None) -> tuple[Floats, Floats]:
    """(T,) value of the rotor with the largest badness, and its index from 0, as numbers.

    `values` and `badness` are (T, R); without badness the largest value is the worst. NaN where
    none is known.
    """
    if not values.shape[1]:
        return np.full(values.shape[0], np.nan), np.full(values.shape[0], np.nan)
    badness = values if badness is None else badness
    score = np.where(np.isfinite(badness), badness, -np.inf)
    which = np.argmax(score, axis=1)
    known = np.isfinite(np.max(score, axis=1))
    rows = np.arange(values.shape[0])
    return np.where(known, values[rows, which], np.nan), np.where(known, which, np.nan)


def require_rotors(track: FlightTrack, airframe: Airframe) -> None:
    """Raise AirframeError when the flight and the airframe have different numbers of rotors."""
    if track.rotor_count != airframe.rotor_count:
        raise AirframeError(
            f"{track.name}: the flight reports {track.rotor_count} rotors and airframe "
            f"{airframe.name} has {airframe.rotor_count}; give --airframe or --model of the "
            "aircraft that flew"
        )
