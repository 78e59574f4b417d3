"""Prepare new rows of one vehicle for their analysis: what is measured, known and inferred.

`FrozenWatch` finds instruments that stand still in flight, while it goes on.
The same function as of a file, over what was flown since the take-off: so it says nothing before a
reading stood for a minute, and of a tank gauge nothing before thrust shows that the aircraft became
lighter. Rows that were shown stay as they were. A reading that moves again is one.

`RowPreparation` also decides whether the vehicle is of the airframe, and infers speeds and load.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from thrustmargin.gcs_plugin.live.rows.vehicle_telemetry import LiveRows
from thrustmargin.gcs_plugin.live.watch.airframe_watch import AirframeWatch
from thrustmargin.models.checks.instruments import (
    Stand,
    drop_readings,
    frozen_channels,
    without_broken_voltage,
)
from thrustmargin.models.checks.voltage import VoltageSoFar
from thrustmargin.models.flight import FlightTrack, join_tracks
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.model.inferred.load_inference import Inferred, fill_channels_so_far
from thrustmargin.models.model.inferred.output_speed import OutputCalibration
from thrustmargin.models.model.rotor_model import RotorModel, identified_airframe
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.provenance import Reason
from thrustmargin.models.vehicle_facts import VehicleFacts

STEP, EVERY = 0.5, 10.0  # s between two rows of the evidence, and between two looks
LANDED = 5.0  # s on the ground after which a new flight begins
#: s of rows that are analysed in one go, at most: what is decided from time to time is not late.
PART = 5.0


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
        """Return the next rows with NaN for a broken voltage and for channels frozen by now.

        Channels are checked every EVERY s; one that moves again is returned from this call on. Rows
        that begin no later than the last ones begin a new flight.
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
    """Return True if a reading that `stood` describes as frozen takes another value in `track`.

    False for one dropped because it contradicts others: it was never still, and the next check
    tests it.
    """
    if stood.reason is not Reason.FROZEN:
        return False
    values = getattr(track, channel)
    return bool(np.any(np.isfinite(values) & (values != stood.value)))


class RowPreparation:
    """The rows of one vehicle before their analysis, in order; the options are AirframeWatch's."""

    def __init__(self, model: RotorModel, *, given: bool, source: str) -> None:
        self._known = identified_airframe(model)
        self._frozen = FrozenWatch(self._known)
        self._airframe = AirframeWatch(model, given=given, source=source)
        self._inferred = Inferred()

    @property
    def airframe_match(self) -> AirframeMatch:
        """Return the last result of matching the vehicle with the airframe."""
        return self._airframe.airframe_match

    @property
    def outputs(self) -> OutputCalibration:
        """Return what the rows so far show of the speed that each motor output makes."""
        return self._inferred.outputs

    def restart(self) -> None:
        """Forget what the rows so far show: others follow that do not go on from them."""
        self._inferred = Inferred()

    def parts(self, rows: LiveRows) -> Iterator[LiveRows]:
        """Yield the rows in parts of at most PART s that begin where the airframe is compared.

        So a decision between two rows does not depend on how many rows came at once.
        """
        while True:
            time_s, due_s = rows.track.time_s, self._airframe.due_s
            cut = int(np.searchsorted(time_s, time_s[0] + PART))
            if due_s > time_s[0]:
                cut = min(cut, int(np.searchsorted(time_s, due_s)))
            elif flying := np.flatnonzero(rows.track.flying[1:]).tolist():
                cut = min(cut, 1 + flying[0])
            if cut >= time_s.size:
                yield rows
                return
            yield rows.rows(slice(0, cut))
            rows = rows.rows(slice(cut, None))

    def prepare(
        self, new: LiveRows, facts: VehicleFacts, parameters: Mapping[str, float]
    ) -> LiveRows:
        """Return new rows without frozen readings; with inferred ones if the airframe matches.

        The match, `airframe_match`, is decided first, and holds from their first row on. `facts`
        and `parameters` are the vehicle's own reports.
        """
        reported = new.track
        measured = self._frozen.without_frozen(reported, parameters)
        found = measured.statements[len(reported.statements) :]
        notes = (*new.notes, *found)
        airframe_match = self._airframe.look(measured, facts, parameters)
        airframe = None if airframe_match.no_verdict else self._known
        track, self._inferred = fill_channels_so_far(measured, airframe, parameters, self._inferred)
        return replace(new, track=track, notes=notes)
