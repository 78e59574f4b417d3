"""The rows that the page shows: residuals before and after with their place and channels.

Every row is one that its values were not found on: fitted flights are cross-validated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.wording.channel_words import CHANNEL_WORDS
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.identification.problem import Problem
from thrustmargin.models.identification.unseen_errors import Unseen

LEAST_VARIATION = 0.02  # of its median, below which nothing can be seen to go with a channel


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rows:
    """T rows of F flights and R rotors.

    Channels are in the units of CHANNEL_WORDS; those not reported throughout or that hardly vary
    are left out.
    """

    names: tuple[str, ...]  # (F,)
    roles: tuple[str, ...]  # (F,) "fit" or "held_out"
    flight: NDArray[np.intp]  # (T,)
    time_s: Floats  # (T,) since the start of the log
    north: Floats  # (T,) m, NaN unknown
    east: Floats  # (T,)
    before_rpm: Floats  # (T, R)
    after_rpm: Floats  # (T, R)
    before_modes: Floats  # (T, R) rpm
    after_modes: Floats  # (T, R)
    mode_names: tuple[str, ...]
    rotor_names: tuple[str, ...]
    channels: Mapping[str, Floats]

    def of(self, flight: int) -> NDArray[np.intp]:
        return np.flatnonzero(self.flight == flight)

    def rmse_rpm(self, flight: int) -> tuple[float, float]:
        """Before and after, of one flight."""
        mine = self.of(flight)
        return _rms(self.before_rpm[mine]), _rms(self.after_rpm[mine])

    def seconds(self, flight: int) -> float:
        """From the first to the last row of one flight."""
        return float(np.ptp(self.time_s[self.of(flight)]))

    def worst_first(self) -> list[int]:
        """Flights by their error before, the largest first."""
        sizes = [self.rmse_rpm(f)[0] for f in range(len(self.names))]
        return sorted(range(len(self.names)), key=lambda f: -sizes[f])


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def rows_of(unseen: Sequence[Unseen], tracks: Sequence[FlightTrack]) -> Rows:
    """Put the residuals of fitted and held-out flights under each other, with their places."""
    first = unseen[0].problem
    offsets = np.cumsum([0, *(u.problem.flights for u in unseen)])
    before = np.concatenate([u.before_rpm for u in unseen])
    after = np.concatenate([u.after_rpm for u in unseen])
    places = [
        _places(u.problem, tracks[offset : offset + u.problem.flights])
        for u, offset in zip(unseen, offsets[:-1], strict=True)
    ]
    directions = first.modes.directions
    channels = {}
    for name, (_, _, factor) in CHANNEL_WORDS.items():
        values = np.concatenate([np.asarray(getattr(u.problem.channels, name)) for u in unseen])
        if np.isfinite(values).all() and _varies(values):
            channels[name] = values * factor
    return Rows(
        names=tuple(n for u in unseen for n in u.problem.names),
        roles=tuple(u.role for u in unseen for _ in u.problem.names),
        flight=np.concatenate(
            [u.problem.flight + k for u, k in zip(unseen, offsets[:-1], strict=True)]
        ),
        time_s=np.concatenate([u.problem.channels.time_s for u in unseen]),
        north=np.concatenate([p[0] for p in places]),
        east=np.concatenate([p[1] for p in places]),
        before_rpm=before,
        after_rpm=after,
        before_modes=before @ directions,
        after_modes=after @ directions,
        mode_names=first.modes.names,
        rotor_names=first.model.airframe.rotor_names,
        channels=channels,
    )


def _varies(values: Floats) -> bool:
    low, middle, high = np.quantile(values, [0.01, 0.5, 0.99])
    return bool(high - low > LEAST_VARIATION * abs(middle) and high - low > 1e-9)


def _places(problem: Problem, tracks: Sequence[FlightTrack]) -> tuple[Floats, Floats]:
    """North and east of a problem's rows, found again in the tracks by their time."""
    north, east = (np.full(problem.flight.size, np.nan) for _ in range(2))
    for f, track in enumerate(tracks):
        mine = np.flatnonzero(problem.flight == f)
        since = track.time_s - track.time_s[0]
        at = np.searchsorted(since, problem.channels.time_s[mine] - 1e-6)
        north[mine], east[mine] = track.position_ned[at, 0], track.position_ned[at, 1]
    return north, east
