"""Instruments that stand still in flight, found while it goes on.

The same function as of a file, over what was flown since the take-off: so it says nothing before a
reading stood for a minute, and of a tank gauge nothing before thrust shows that the aircraft became
lighter. Rows that were shown stay as they were. A reading that moves again is one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from thrustmargin.models.checks.instruments import (
    Stand,
    drop_readings,
    frozen_channels,
    without_broken_voltage,
)
from thrustmargin.models.checks.voltage import VoltageSoFar
from thrustmargin.models.flight import FlightTrack, join_tracks
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.provenance import Reason

STEP, EVERY = 0.5, 10.0  # s between two rows of the evidence, and between two looks
LANDED = 5.0  # s on the ground after which a new flight begins


class FrozenWatch:
    """The frozen instruments of one vehicle in flight; `airframe` is the model's."""

    def __init__(self, airframe: Airframe) -> None:
        self._airframe = airframe
        self._begin()

    def _begin(self) -> None:
        self._flown: list[FlightTrack] = []  # rows in flight, in order
        self._frozen: dict[str, Stand] = {}
        self._last_s = self._looked_s = -np.inf
        self._voltage = VoltageSoFar()

    def without_frozen(self, track: FlightTrack, parameters: Mapping[str, float]) -> FlightTrack:
        """Return new rows, in order, without a broken voltage and without channels that are frozen
        by then.
        """
        time_s = track.time_s
        if self._flown and time_s[0] <= self._last_s:  # it was started anew
            self._begin()
        track, self._voltage = without_broken_voltage(track, self._voltage)
        steps = np.floor(time_s / STEP)
        new = np.diff(steps, prepend=np.floor(self._last_s / STEP)) > 0
        rows = np.flatnonzero(new & track.flying)
        if rows.size:
            if time_s[rows[0]] - self._last_s > LANDED or self._other(track):
                self._begin()
            self._flown.append(track.rows(rows))
            self._last_s = float(time_s[rows[-1]])
        if self._flown and self._last_s - self._looked_s >= EVERY:
            self._looked_s = self._last_s
            self._flown = [join_tracks([(part, slice(None)) for part in self._flown])]
            found = frozen_channels(self._flown[0], self._airframe, parameters)
            self._frozen = {c: stand for c, stand in found.items() if stand.rows[-1]}
        moving = [c for c, stood in self._frozen.items() if _moves(track, c, stood)]
        self._frozen = {c: stood for c, stood in self._frozen.items() if c not in moving}
        whole = np.ones(time_s.size, dtype=np.bool_)
        return drop_readings(track, {c: replace(s, rows=whole) for c, s in self._frozen.items()})

    def _other(self, track: FlightTrack) -> bool:
        return bool(self._flown) and self._flown[-1].rotor_count != track.rotor_count


def _moves(track: FlightTrack, channel: str, stood: Stand) -> bool:
    """Return whether a frozen reading moves again; False for one that only contradicts others.

    A contradicting reading did move all along, and is checked at the next look.
    """
    if stood.reason is not Reason.FROZEN:
        return False
    values = getattr(track, channel)
    return bool(np.any(np.isfinite(values) & (values != stood.value)))
