"""When a flight leaves open whether a rotor is weak."""

import numpy as np
import pytest

from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.model.model_misfit import Caveat, caveats


@pytest.mark.parametrize(
    ("unsought_s", "by_outputs_s", "found"),
    [
        (0.0, 0.0, ()),
        (19.0, 0.0, ()),
        (21.0, 0.0, (Caveat.ROTORS_NOT_SOUGHT,)),
        (21.0, 79.0, (Caveat.ROTORS_NOT_SOUGHT,)),
        (0.0, 19.0, ()),
        (0.0, 21.0, (Caveat.ROTORS_BY_OUTPUTS,)),
        (11.0, 11.0, (Caveat.ROTORS_BY_OUTPUTS,)),
    ],
)
def test_a_fifth_of_a_flight_without_rotor_speeds_is_a_caveat(unsought_s, by_outputs_s, found):
    """Of 100 s in flight."""
    zero = np.zeros(101)
    track = FlightTrack.of(
        name="flight",
        time_s=np.arange(101.0),
        rotor_count=4,
        airspeed=zero,
        tank_kg=zero,
    )
    assert track.flying_s == pytest.approx(100.0, abs=1.0)
    assert (
        caveats(
            track,
            beyond_gauge_kg=0.0,
            model_fails=False,
            unsought_s=unsought_s,
            by_outputs_s=by_outputs_s,
        )
        == found
    )
