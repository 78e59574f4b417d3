"""What a learnt model predicts on a grid of airspeed and tank level: the points of Figure 10."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from thrustmargin.models.errors import ModelError
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.model.predict import Basis, predict
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.margin import weight
from thrustmargin.models.physics.matching import same_aircraft

#: m/s and shares of the tank at which the network is asked for Figure 10: the paper's three speeds
#: and its three payloads 4, 10 and 16 of 16 kg.
FIGURE_AIRSPEEDS = (2.0, 4.0, 6.0)
FIGURE_TANK_SHARES = (0.25, 0.625, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NetworkPoints:
    """Rotor speeds that a learnt model predicts at P airspeeds and tank levels."""

    title: str  # of the aircraft whose flights taught it, which may be a simulated one
    airspeed: Floats  # (P,) m/s
    tank_kg: Floats  # (P,) kg
    rotor_speed_rpm: Floats  # (P, R)
    load: Floats  # (P,) N that a rotor carries
    left_out: int  # points outside the model's training domain


def network_points(airframe: Airframe, model: RotorModel) -> NetworkPoints:
    """What the model's network predicts at the figure's airspeeds and shares of the tank.

    The model is asked in the air of its training, and Eq. 1 carries its speeds over to the air of
    its airframe's thrust curve, in which the figure is drawn. Raises ModelError when it was made
    for another aircraft, or when its network covers none of the points.
    """
    if not same_aircraft(airframe, model.airframe):
        raise ModelError(
            f"the model was made for {model.airframe.name}, not for {airframe.name}; "
            "give --model a file trained on this aircraft"
        )
    speed, share = (
        g.ravel() for g in np.meshgrid(FIGURE_AIRSPEEDS, FIGURE_TANK_SHARES, indexing="ij")
    )
    tank = share * airframe.tank_capacity_kg
    rows = speed.size
    still = np.zeros((rows, 3))
    track = FlightTrack.of(
        name="Figure 10",
        time_s=np.arange(rows, dtype=np.float64),
        rotor_count=airframe.rotor_count,
        airspeed=speed,
        tank_kg=tank,
        velocity_ned=np.stack([speed, still[:, 0], still[:, 0]], axis=1),
        wind_ned=still,
    )
    predicted = predict(model, track, np.full(rows, model.reference_density))
    to_curve = np.sqrt(model.reference_density / model.airframe.reference_density)
    learnt = np.asarray(predicted.basis) == Basis.NETWORK
    if not np.any(learnt):
        raise ModelError(
            f"the model for {model.airframe.name} has no network that covers these speeds and "
            "tank levels; train one with `thrustmargin train`"
        )
    return NetworkPoints(
        title=model.airframe.title,
        airspeed=speed[learnt],
        tank_kg=tank[learnt],
        rotor_speed_rpm=predicted.rotor_speed_rpm[learnt] * to_curve,
        load=weight(airframe, tank[learnt]) / airframe.rotor_count,
        left_out=int(np.count_nonzero(~learnt)),
    )
