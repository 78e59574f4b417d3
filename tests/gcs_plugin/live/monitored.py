"""For tests of the monitor: its model, its recordings, and whether rows agree."""

from pathlib import Path

import numpy as np

from thrustmargin.models.flight import TRACK_CHANNELS, FlightTrack
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

AIRFRAME = load_airframe("topxgun-f16-sitl")
MODEL = physics_model(AIRFRAME)


def same(ours: FlightTrack, theirs: FlightTrack, after: float = 1.0) -> None:
    """Rows agree in every channel.

    In the first second another source may stand in live, and the origin settles at take-off.
    """
    assert np.allclose(ours.time_s, theirs.time_s, rtol=0, atol=1e-4)
    start = ours.time_s > after
    airborne = np.arange(ours.time_s.size) >= int(np.argmax(theirs.flying))
    for channel in TRACK_CHANNELS:
        settled = start & airborne if channel == "position_ned" else start
        one, other = getattr(ours, channel)[settled], getattr(theirs, channel)[settled]
        assert np.array_equal(one, other, equal_nan=True), channel


def recording_in(folder: Path) -> Path:
    (session,) = folder.iterdir()
    return session
