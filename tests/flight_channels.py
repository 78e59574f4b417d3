"""The channels of a flight: compared one by one, and given another number of rotors."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from thrustmargin.models.flight import TRACK_CHANNELS, FlightTrack


def assert_same_channels(
    one: FlightTrack,
    other: FlightTrack,
    *,
    rtol: float = 0.0,
    atol: float = 0.0,
    but: Collection[str] = (),
) -> None:
    """Compare every channel but those of `but`; numbers are equal within the tolerances."""
    for name in TRACK_CHANNELS:
        if name not in but:
            mine, theirs = getattr(one, name), getattr(other, name)
            np.testing.assert_allclose(mine, theirs, rtol=rtol, atol=atol, err_msg=name)


def reported_channels(track: FlightTrack) -> set[str]:
    return {name for name in TRACK_CHANNELS if track.reports(name)}


def with_rotor_count(track: FlightTrack, rotors: int) -> FlightTrack:
    """Give every rotor the values of the first, for another number of rotors."""
    each = [name for name, channel in TRACK_CHANNELS.items() if channel.per_rotor]
    return replace(track, **{n: np.tile(getattr(track, n)[:, :1], rotors) for n in each})
