"""What steady hover says of an aircraft of known mass: its thrust coefficient and its trim.

In hover the rotors carry the mass m [kg] at a tilt theta:
    a = m g rho_ref / (rho cos theta sum e_i N_i²)
with N [rpm] measured rotor speeds, e effectiveness, rho the air's density. The answer is the mean
over flights; its interval is by leaving out whole flights, or ten-second blocks of a single one,
for rows of one hover follow each other. Wind is not known: in it a rotor makes more at a speed.

The trim of rotor i is the thrust that it is asked for over its share of a level, balanced aircraft:
    (e_i N_i² / sum e N²) / (e_i s_i / sum e s),   s the smallest s with B diag(e) s = (1, 0, 0, 0)
and B the mixer. What it does not distinguish: a load off centre, a motor not level and a weak
propeller. Summed with the arms it is where the weight seems to be, and a standing yaw moment.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.allocation import mixer
from thrustmargin.models.physics.atmosphere import G0, track_air
from thrustmargin.models.physics.flight_phases import hover_rows
from thrustmargin.models.scores import Estimate, jackknife

BLOCK_S = 10.0
FEWEST_ROWS = 50  # five seconds of hover, in all


@dataclass(frozen=True, slots=True, kw_only=True)
class HoverFit:
    """Thrust curve and trim of R rotors from steady hover, each with its 95 % interval."""

    coefficient: Estimate  # N/rpm² at reference_density
    reference_density: float  # kg/m³, the median of the hover
    density_error: float  # kg/m³, its standard error, which the coefficient's interval leaves out
    air: str  # what the density is from, in the first flight
    trim: tuple[Estimate, ...]  # thrust of a rotor over its share on a balanced aircraft
    load_place: tuple[Estimate, Estimate]  # m, x and y frd at which the weight seems to hang
    yaw_split: Estimate  # thrust of the rotors that turn CCW minus CW, over all of it
    flights: tuple[str, ...]  # that have hover
    rows: int


def fit_hover(
    tracks: Sequence[FlightTrack],
    airframe: Airframe,
    *,
    mass: float | None = None,
) -> HoverFit:
    """Thrust coefficient and trim from the steady hover of flights with measured rotor speeds.

    `mass` kg of the aircraft as it flew; without it the airframe's empty mass and the tank's
    content. Of the airframe only its rotors' places, spin and effectiveness are used, and its empty
    mass.
    Raises DataError when there is too little steady hover with every rotor's speed.
    """
    parts, airs = [], []
    for number, track in enumerate(tracks):
        if track.rotor_count != airframe.rotor_count:
            raise DataError(
                f"{track.name}: {track.rotor_count} rotors, but the airframe has "
                f"{airframe.rotor_count}; give flights of this aircraft"
            )
        air = track_air(track)
        airs.append(air)
        density = air.density
        load = track.measured("tank_kg")
        carried = np.full(density.shape, mass) if mass else airframe.empty_mass + load
        upright = np.cos(track.attitude[:, 0]) * np.cos(track.attitude[:, 1])
        weight = carried * G0 / upright
        squares = airframe.rotor_effectiveness * track.rotor_speed_rpm**2
        use = hover_rows(track) & np.isfinite(weight) & np.isfinite(density)
        use &= np.all(track.rotor_speed_rpm > 0.0, axis=1)
        times = track.time_s[use]
        when = np.floor((times - times[:1]) / BLOCK_S) if times.size else times
        flight = np.full(times.size, float(number))
        parts.append(np.column_stack([flight, when, weight[use], density[use], squares[use]]))
    table = np.concatenate(parts) if parts else np.empty((0, 4 + airframe.rotor_count))
    if len(table) < FEWEST_ROWS:
        if all(not np.isfinite(track.tank_kg).any() for track in tracks) and mass is None:
            raise DataError("what is on board is not known; give --load KG")
        raise DataError(
            f"{len(table)} rows of steady hover with the speed of every rotor, {FEWEST_ROWS} are "
            "needed: give a flight that hovers for ten seconds or more, with ESC telemetry"
        )
    flight, when, weight, density, squares = *table[:, :4].T, table[:, 4:]
    hovered = np.unique(flight)
    # A part of a block at the end of a single flight would count as a whole one.
    block = flight if hovered.size > 1 else np.minimum(when, max(when[-1] - 1.0, 0.0))
    reference = float(np.median(density))
    collective = squares.sum(axis=1)
    share = squares / collective[:, None]
    apparent = weight * reference / density
    matrix = mixer(airframe)
    level = np.linalg.pinv(matrix * airframe.rotor_effectiveness) @ [1.0, 0.0, 0.0, 0.0]
    expected = airframe.rotor_effectiveness * level
    expected /= expected.sum()

    def figures(kept: np.ndarray) -> Floats:
        """Coefficient, trims, place of the load, split of the pairs: means over flights."""
        means = []
        for one in np.unique(flight[kept]):
            rows = kept & (flight == one)
            shares = share[rows].mean(axis=0)
            coefficient = apparent[rows].sum() / collective[rows].sum()
            roll, pitch, yaw = matrix[1:] @ shares
            means.append(
                [coefficient, *(shares / expected), pitch, -roll, yaw / airframe.torque_ratio]
            )
        return np.array(means, dtype=np.float64).mean(axis=0)

    found = [
        Estimate(value=float(value), low=float(low), high=float(high))
        for value, low, high in zip(*jackknife(figures, block), strict=True)
    ]
    rotors = airframe.rotor_count
    return HoverFit(
        coefficient=found[0],
        reference_density=reference,
        density_error=float(np.median(airs[int(hovered[0])].density_error)),
        air=airs[int(hovered[0])].basis,
        trim=tuple(found[1 : 1 + rotors]),
        load_place=(found[1 + rotors], found[2 + rotors]),
        yaw_split=found[3 + rotors],
        flights=tuple(tracks[int(number)].name for number in hovered),
        rows=len(table),
    )
