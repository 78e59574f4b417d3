"""How well thrust utilisation is known: from rotor speeds, load, and what the airframe guesses.

    by speed      (s(ln u) - s_o)² = (2 s_N/N)² + s_c²           u = (N/N_max)²
    by prediction (s(ln u) - s_o)² = (s_m/m)² + s_g² + s_c² (+ the network's own interval)
    redundancy    (s(ln r) - s_o)² = (s_m/m)² + s_g² + s_c² + (s_rho/rho)²

s_N, s_m standard errors of rotor speed and mass, 0 where they were measured (of one that hover
thrust shows, only what the largest thrust does not share); s_c of the ceiling where its rotor speed
or voltage is guessed, or the battery's not known, s_g of a guessed mass or thrust curve. The
density of the air is in redundancy only: by speed it cancels, and the network predicts in the air
that it learnt in.

s_o is what the motor outputs show beyond the rotor speeds, or beyond the reported load where that
is what the number rests on, or a battery beyond a full one: too little to say which is wrong,
enough that the 90 % interval reaches there (checks/output_evidence.py). It is no scatter: it is
added as it is, and to one side, for it shows that more is in use and less can be held.
"""

from __future__ import annotations

import numpy as np

from thrustmargin.models.checks.output_evidence import OutputEvidence
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.model.inferred.load_inference import shared_error
from thrustmargin.models.model.predict import Prediction
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.provenance import Meaning

#: Standard errors of one 90 % interval, which is what every screen shows.
INTERVAL = 1.645
#: Share of thrust by which a guessed quantity may be off: makers' thrusts of one power class, and
#: hover masses of one frame size, differ by about so much (one standard deviation).
GUESS = 0.1
#: Share by which a battery of unknown voltage may be off its nominal one: 3.4 to 4.2 V a cell.
VOLTAGE_ERROR = 0.05


def guessed_variance(airframe: Airframe, *names: str) -> float:
    """Variance of ln thrust from those of the airframe's quantities that are guessed."""
    quantities = airframe.quantities
    return GUESS**2 * sum(quantities[name].guessed for name in names)


def ceiling_variance(airframe: Airframe, voltage: Floats) -> Floats:
    """(T,) variance of ln of the largest thrust at the battery's `voltage` (T,) V; NaN unknown."""
    guesses = guessed_variance(airframe, "max_rotor_speed_rpm", "ceiling_voltage")
    unknown = 2.0 * airframe.ceiling_voltage_exponent * VOLTAGE_ERROR
    return guesses + np.where(voltage > 0.0, 0.0, unknown**2)


def load_error(track: FlightTrack, airframe: Airframe) -> Floats:
    """(T,) standard error of ln(weight over largest thrust), for redundancy and prediction."""
    guesses = guessed_variance(airframe, "empty_mass", "thrust_coefficient")
    if "tank_kg" not in track.standard_errors:
        guesses += 0.0 * airframe.empty_mass  # NaN of an aircraft that is not known
        return np.sqrt(guesses + ceiling_variance(airframe, track.voltage))
    tank = np.nan_to_num(track.standard_errors["tank_kg"])
    load = np.nan_to_num(track.tank_kg)
    variance = tank**2
    if track.source("tank_kg").meaning is Meaning.HOVER_THRUST:
        # A load that hover thrust shows is off as the curve is, and so is the largest thrust.
        variance = np.maximum(variance - shared_error(track, airframe, load) ** 2, 0.0)
        guesses = 0.0
    share = np.sqrt(variance) / (airframe.empty_mass + load)
    return np.sqrt(share**2 + guesses + ceiling_variance(airframe, track.voltage))


def beyond_load(track: FlightTrack, airframe: Airframe, outputs: OutputEvidence | None) -> float:
    """Standard error, as a share, by what motor outputs lift beyond the reported load; 0.

    A load that hover thrust shows has that in its own error, but for a ceiling that is too high.
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
    """(T,) standard error of ln redundancy to the low side, `beyond_load` with it; `density_share`
    (T,) is that of ln density.

    Where hover thrust shows the load, density shifts it and the largest thrust alike.
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
    """(T, R) standard error of the known utilisation to the high side, and the part of it that the
    low side has not; NaN where it is unknown.

    That is the one by speed in rows with any, and else the predicted one.
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
        # Speeds that were made of the outputs rest on the load.
        of_outputs = 0.0 if outputs is None else outputs.share_beyond_speeds / INTERVAL
        of_outputs = np.where(error > 0.0, beyond, of_outputs)
    any_speed = np.any(np.isfinite(utilisation), axis=1)[:, None]
    use = np.where(any_speed, utilisation, utilisation_predicted)
    scatter = np.where(any_speed, np.sqrt(of_speed**2 + ceiling), np.hypot(load, of_network))
    one_sided = use * np.where(any_speed, of_outputs, beyond)
    return use * scatter + one_sided, one_sided
