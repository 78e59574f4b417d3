"""Compute the standard error of thrust utilisation from rotor speeds, load and guessed quantities.

    by speed      (s(ln u) - s_o)² = (2 s_N/N)² + s_c²           u = (N/N_max)²
    by prediction (s(ln u) - s_o)² = (s_m/m)² + s_g² + s_c² (+ the network's own interval)
    redundancy    (s(ln r) - s_o)² = (s_m/m)² + s_g² + s_c² + (s_rho/rho)²

s_N and s_m are standard errors of rotor speed and mass, 0 if measured (for a mass by hover thrust,
only the part that the largest thrust does not share); s_c of the ceiling, if its rotor speed or
voltage is guessed or the battery's is unknown; s_g of a guessed mass or thrust curve. Where the
largest thrust is a data sheet's and curve and speed are guessed to match it, only the data sheet's
error counts for the two. Air density
affects redundancy only: by speed it cancels, and the network predicts in the air of its training.

s_o is the thrust that motor outputs show beyond the rotor speeds, or beyond the reported load where
the number depends on that, or the excess of a battery voltage over a full one: too little to know
which is wrong, but enough to extend the 90 % interval (checks/output_evidence.py). It is no random
error, so it is added linearly and to one side: more thrust in use, less in reserve.
"""

from __future__ import annotations

import numpy as np

from thrustmargin.models.checks.output_evidence import OutputEvidence
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.model.rotor_model import Prediction
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import track_air
from thrustmargin.models.provenance import Meaning

#: Standard errors on either side of the 90 % interval that every screen shows.
INTERVAL = 1.645
#: Share of thrust by which a guessed quantity may be off: makers' thrusts of one power class, and
#: hover masses of one frame size, differ by this standard deviation.
GUESS = 0.1
#: Share by which the largest thrust may differ from the maker's by rounding of the file's numbers.
DERIVED = 0.02
#: Share by which a battery of unknown voltage may be off its nominal one: 3.4 to 4.2 V a cell.
VOLTAGE_ERROR = 0.05
#: Standard errors as shares, where not guessed: of a thrust curve, and of an empty mass.
CURVE_ERROR, MASS_ERROR = 0.03, 0.005


def shared_error(track: FlightTrack, airframe: Airframe, load: Floats) -> Floats:
    """Return the part (T,), kg, of an inferred load's standard error that cancels in the
    redundancy.

    An error of thrust curve, air density or empty mass shifts the weight inferred by thrust and the
    largest thrust alike, so their ratio does not change. `load` (T,) is in kg.
    """
    curve = GUESS if "thrust_coefficient" in airframe.guessed else CURVE_ERROR
    mass = GUESS if "empty_mass" in airframe.guessed else MASS_ERROR
    air = track_air(track)
    of_thrust = np.hypot(curve, air.density_error / air.density) * (airframe.empty_mass + load)
    return np.hypot(of_thrust, mass * airframe.empty_mass)


def guessed_variance(airframe: Airframe, *names: str) -> float:
    """Return the variance of ln thrust due to the quantities `names`, where the airframe guesses
    them.

    A guess counts with its own `thrust_error`, or with GUESS if the file states none.
    """
    total = 0.0
    for quantity in (airframe.quantities[name] for name in names):
        own = quantity.thrust_error if quantity.thrust_error > 0.0 else GUESS
        total += own**2 if quantity.guessed else 0.0
    return total


def from_data_sheet(airframe: Airframe) -> bool:
    """Return True if the largest thrust, coefficient times N_max², is that of the data sheet,
    within DERIVED.

    The airframe file then guesses thrust coefficient and largest rotor speed, but not the maker's
    thrust, from which the speed was computed: both errors cancel in the largest thrust, and only
    the data sheet's remains.
    """
    quantities = airframe.quantities
    reached = airframe.thrust_coefficient * airframe.max_rotor_speed_rpm**2
    return (
        quantities["thrust_coefficient"].guessed
        and quantities["max_rotor_speed_rpm"].guessed
        and not quantities["nameplate_max_thrust"].guessed
        and abs(reached / airframe.nameplate_max_thrust - 1.0) <= DERIVED
    )


def largest_thrust_variance(airframe: Airframe) -> float:
    """Return the variance of ln a N_max², the largest thrust at the ceiling's voltage."""
    if from_data_sheet(airframe):
        return guessed_variance(airframe, "max_rotor_speed_rpm", "ceiling_voltage")
    names = ("thrust_coefficient", "max_rotor_speed_rpm", "ceiling_voltage")
    return guessed_variance(airframe, *names)


def ceiling_variance(airframe: Airframe, voltage: Floats) -> Floats:
    """Return the variance (T,) of ln N_max² at battery voltage `voltage` (T,) V, NaN if unknown."""
    guesses = guessed_variance(airframe, "max_rotor_speed_rpm", "ceiling_voltage")
    if from_data_sheet(airframe):  # N_max² = T_max/a has the error of both
        guesses += guessed_variance(airframe, "thrust_coefficient")
    return guesses + _voltage_variance(airframe, voltage)


def _voltage_variance(airframe: Airframe, voltage: Floats) -> Floats:
    """Return the variance (T,) of ln of the largest thrust due to an unknown battery voltage."""
    unknown = 2.0 * airframe.ceiling_voltage_exponent * VOLTAGE_ERROR
    return np.where(voltage > 0.0, 0.0, unknown**2)


def load_error(track: FlightTrack, airframe: Airframe) -> Floats:
    """Return the standard error (T,) of ln(weight over largest thrust).

    It combines, as independent, the load's error (left out where the track states none), the
    guessed quantities of the airframe, and a voltage that is unknown (not above 0). A load that
    hover thrust shows shares the thrust curve's error with the largest thrust: the shared part is
    subtracted. NaN for an unknown aircraft.
    """
    guesses = guessed_variance(airframe, "empty_mass") + largest_thrust_variance(airframe)
    guesses += _voltage_variance(airframe, track.voltage)
    if "tank_kg" not in track.standard_errors:
        guesses += 0.0 * airframe.empty_mass  # NaN for an unknown aircraft
        return np.sqrt(guesses)
    tank = np.nan_to_num(track.standard_errors["tank_kg"])
    load = np.nan_to_num(track.tank_kg)
    variance = tank**2
    if track.source("tank_kg").meaning is Meaning.HOVER_THRUST:
        # A load that hover thrust shows is off as the curve is, and so is the largest thrust.
        variance = np.maximum(variance - shared_error(track, airframe, load) ** 2, 0.0)
        guesses = ceiling_variance(airframe, track.voltage)
    share = np.sqrt(variance) / (airframe.empty_mass + load)
    return np.sqrt(share**2 + guesses)


def beyond_load(track: FlightTrack, airframe: Airframe, outputs: OutputEvidence | None) -> float:
    """Return the thrust that motor outputs show beyond the load, as a standard error of ln thrust.

    0 without outputs or surplus. The error of a load inferred from hover thrust includes the
    surplus already; then only the part by a largest thrust assumed too high is returned.
    """
    if outputs is None:
        return 0.0
    hover = track.source("tank_kg").meaning is Meaning.HOVER_THRUST
    if hover or np.isnan(outputs.load_kg):
        return outputs.ceiling_high / INTERVAL
    return outputs.share_beyond(airframe.empty_mass + outputs.load_kg) / INTERVAL


def redundancy_error(
    track: FlightTrack,
    airframe: Airframe,
    density_share: Floats,
    outputs: OutputEvidence | None = None,
) -> Floats:
    """Return the standard error (T,) of ln redundancy towards lower values.

    It includes the surplus of `beyond_load`. `density_share` (T,) is the standard error of ln
    density; it is left out where hover thrust shows the load, because density then shifts load and
    largest thrust alike.
    """
    shared = track.source("tank_kg").meaning is Meaning.HOVER_THRUST
    error = np.hypot(load_error(track, airframe), 0.0 if shared else density_share)
    return error + beyond_load(track, airframe, outputs)


def utilisation_error(
    track: FlightTrack,
    airframe: Airframe,
    prediction: Prediction,
    utilisation: Floats,
    utilisation_predicted: Floats,
    outputs: OutputEvidence | None = None,
) -> tuple[Floats, Floats]:
    """Return the upward standard error (T, R) of the utilisation, and its one-sided part (T, R).

    The one-sided part is the thrust that motor outputs show beyond load or speeds; the downward
    standard error is the difference of both. Rows with any rotor speed have the error of the
    speeds, other rows that of the prediction; NaN where the utilisation is unknown.
    """
    speed = track.rotor_speed_rpm
    error = track.standard_errors.get("rotor_speed_rpm", np.zeros_like(speed))
    with np.errstate(invalid="ignore", divide="ignore"):
        of_speed = np.nan_to_num(2.0 * error / speed)
        half = (prediction.upper_rpm - prediction.lower_rpm) / 2.0
        of_network = np.nan_to_num(2.0 * half / INTERVAL / prediction.rotor_speed_rpm)
        ceiling = ceiling_variance(airframe, track.voltage)[:, None]
        # At full output all is in use, wherever the ceiling is.
        ceiling = np.where((error > 0.0) & (utilisation >= 1.0 - 1e-9), 0.0, ceiling)
        load = load_error(track, airframe)[:, None]
        beyond = beyond_load(track, airframe, outputs)
        # Speeds made from outputs were calibrated by the load.
        of_outputs = 0.0 if outputs is None else outputs.share_beyond_speeds / INTERVAL
        of_outputs = np.where(error > 0.0, beyond, of_outputs)
    any_speed = np.any(np.isfinite(utilisation), axis=1)[:, None]
    use = np.where(any_speed, utilisation, utilisation_predicted)
    scatter = np.where(any_speed, np.sqrt(of_speed**2 + ceiling), np.hypot(load, of_network))
    one_sided = use * np.where(any_speed, of_outputs, beyond)
    return use * scatter + one_sided, one_sided
