"""What a wind does that the good flights reported and these flights do not.

An airspeed sensor says how fast the air comes, the wind from where. Where it comes from decides how
much of it goes through the leaning rotors (axial inflow), and what speeding up against drag takes.
Without a reported wind both are worked out for still air. Over a flight that leaves an error that
goes with heading and lean, and drag, climb inflow and late channels together imitate it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.identification.rows.candidates import predicted
from thrustmargin.models.identification.rows.reduced import Reduced, reduce_flights

#: the channels that the direction of the air decides; moments of flow have a channel of their own,
#: which is not known at all without a wind
OF_DIRECTION = (
    *("advance_ratio", "climb_ratio", "load_factor", "load_factor_shifts"),
    "manoeuvre_load_shifts",
)


def unreported_wind(reduced: Reduced, tracks: Sequence[FlightTrack]) -> Floats:
    """(N, R, 2) rpm in modes by a wind from south and one from west, as strong as the strongest of
    the good flights; no column where these flights report the wind, or the good ones did not."""
    domain = reduced.model.training_domain
    strongest = np.nan if domain is None else domain.wind_speed[1]
    lacking = [not np.isfinite(track.wind_ned).any() for track in tracks]
    columns = np.zeros((*reduced.measured_rpm.shape, 0))
    if not strongest > 0.0 or not any(lacking):
        return columns
    still = predicted(reduced, ())
    for wind in strongest * np.eye(3)[:2]:
        blown = [
            replace(track, wind_ned=np.tile(wind, (track.time_s.size, 1))) if lacks else track
            for track, lacks in zip(tracks, lacking, strict=True)
        ]
        channels = reduce_flights(reduced.model, blown, delays=False).channels
        moved = replace(
            reduced.channels, **{name: getattr(channels, name) for name in OF_DIRECTION}
        )
        change = np.nan_to_num(predicted(replace(reduced, channels=moved), ()) - still)
        columns = np.concatenate([columns, change[:, :, None]], axis=2)
    return columns
