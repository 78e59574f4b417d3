"""The flight that goes on, kept whole, so that its answer is what a report would say of it so far.

The rows are those of the monitor, which are the file's (tests: test_live_is_the_file.py); load and
speeds are inferred anew over all of them, as of a file. A flight begins at the first row heard, and
anew at the first take-off after a stay of LONG_DOWN on the ground, or one in which it was disarmed,
or its tank or battery became fuller, as a file is divided.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from thrustmargin.gcs_plugin.live.alarms.alarm import AlarmEvent
from thrustmargin.gcs_plugin.live.alarms.listed_alarms import Alarms
from thrustmargin.gcs_plugin.live.rows.vehicle_state import VehicleState
from thrustmargin.gcs_plugin.telemetry.sorties import LONG_DOWN, LOOK, REST, serviced
from thrustmargin.gcs_plugin.wording.answer import FlightAnswer, answer_of
from thrustmargin.models.checks.loss_of_control import before_loss, loss_of_control
from thrustmargin.models.checks.motor_order import check_motor_order
from thrustmargin.models.checks.output_evidence import output_evidence
from thrustmargin.models.flight import FlightTrack, Floats, joined
from thrustmargin.models.model.advice import Advice, advise
from thrustmargin.models.model.airframe_claim import AirframeClaim
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.inferred.prepared import prepared
from thrustmargin.models.model.predict import flown_airframe
from thrustmargin.models.model.rotor_faults import FaultHistory
from thrustmargin.models.model.rotor_model import RotorModel

#: s of the vehicle's clock between two answers, and the share by which its rows have grown: more
#: rows take longer, and change the answer less.
AGAIN_S, GROWN = 5.0, 0.05
STOOD = 600.0  # s on the ground before the first take-off that are kept


@dataclass(frozen=True, kw_only=True, eq=False)
class FlightSoFar:
    """One flight up to a row; its answer is worked out when a screen asks for it."""

    track: FlightTrack  # as measured
    parameters: Mapping[str, float]
    model: RotorModel
    claim: AirframeClaim
    faults: FaultHistory
    limit: float  # share of a rotor's largest thrust that may last
    goes_on: bool  # it has not landed

    @cached_property
    def advice(self) -> Advice:
        """As of a report of these rows."""
        craft = None if self.claim.withheld else flown_airframe(self.model)
        claim, track = self.claim, prepared(self.track, craft, self.parameters)
        if craft is not None:
            # The claim was decided in the first climb, where outputs show more than the weight.
            claim = replace(claim, outputs=output_evidence(self.track, craft, self.parameters))
        made = advise(
            analyse(track, self.model, claim=claim),
            limit=self.limit,
            names_known=craft is None or _names_known(track, self.model),
            history=self.faults,
            goes_on=self.goes_on,
        )
        return made.advice

    @cached_property
    def answer(self) -> FlightAnswer:
        """The same in words."""
        return answer_of(self.advice, float(self.track.time_s[-1]))


def _names_known(track: FlightTrack, model: RotorModel) -> bool:
    flown = before_loss(track, loss_of_control(track))
    return check_motor_order(flown, flown_airframe(model)).verdict in ("agrees", "unclear")


class SortieRows:
    """Follows the rows of one start of a vehicle; `now` is its flight as it was made last."""

    def __init__(self, model: RotorModel, alarms: Alarms) -> None:
        self._model, self._alarms = model, alarms
        self._earlier = len(alarms.fault_history)  # changes before this start of the vehicle
        self._parts: list[FlightTrack] = []
        self._zero_s = self._begin_s = 0.0  # clock when the track's time is 0; of the flight
        self._flown = self._disarmed = False
        self._landed_s = math.nan
        self._stay: tuple[float, float] | None = None  # landing and take-off, until it is checked
        self._made_s = -math.inf
        self._said: tuple[AirframeClaim, VehicleState] | None = None
        self.now: FlightSoFar | None = None  # None before the first take-off

    def add(
        self,
        track: FlightTrack,
        clock_s: Floats,
        claim: AirframeClaim,
        state: VehicleState,
        events: Sequence[AlarmEvent],
    ) -> None:
        """Take the next rows as they were measured, at `clock_s` (T,) of the vehicle; `events` is
        what the alarms found in them."""
        self._zero_s = float(clock_s[0] - track.time_s[0])
        self._said = claim, state
        end_s, flying = float(track.time_s[-1]), np.flatnonzero(track.flying)
        if flying.size:
            self._take_off(float(track.time_s[flying[0]]))
        self._parts.append(track)
        if self._stay is not None and end_s >= self._stay[1] + LOOK:
            self._parts = [joined([(part, slice(None)) for part in self._parts])]
            if serviced(self._parts[0], self._parts[0].time_s, *self._stay):
                self._begin(*self._stay)
            self._stay = None
        landed = self._flown and not track.flying[-1]
        if landed:
            self._disarmed |= not state.armed
            self._landed_s = end_s if math.isnan(self._landed_s) else self._landed_s
        due_s = max(AGAIN_S, GROWN * (end_s - self._begin_s))
        if not self._flown:
            self._keep(end_s - STOOD)
        elif landed and self._anew(end_s):
            self._keep(end_s - REST)  # the flight itself stays in `now`
        elif (
            self._landed_s == end_s
            or end_s - self._made_s >= due_s
            or any(event.raised for event in events)
        ):
            self.make()

    def make(self) -> None:
        """The flight up to the last row."""
        if not self._flown or self._said is None:
            return
        claim, state = self._said
        whole = joined([(part, slice(None)) for part in self._parts])
        self._parts = [whole]
        track = whole
        if self._begin_s > 0.0:
            track = replace(whole, time_s=whole.time_s - self._begin_s)
        zero_s = self._zero_s + self._begin_s
        self._made_s = float(whole.time_s[-1])
        self.now = FlightSoFar(
            track=track,
            parameters=state.parameters,
            model=self._model,
            claim=claim,
            faults=_since(self._alarms.fault_history[self._earlier :], zero_s),
            limit=self._alarms.settings.max_utilisation,
            goes_on=bool(track.flying[-1]),
        )

    def _anew(self, time_s: float) -> bool:
        """Whether a take-off now would begin another flight."""
        long = LONG_DOWN if not self._disarmed else REST
        return time_s - self._landed_s >= long

    def _take_off(self, time_s: float) -> None:
        if self._flown and (self._disarmed or time_s - self._landed_s >= LONG_DOWN):
            self._begin(self._landed_s, time_s)
        elif self._flown and self._landed_s < time_s:
            self._stay = self._landed_s, time_s
        self._flown, self._disarmed, self._landed_s = True, False, math.nan

    def _begin(self, down_s: float, up_s: float) -> None:
        """The flight after a stay is another, with the ground that is nearer to it."""
        self._keep(max(up_s - REST, 0.5 * (down_s + up_s)))
        self._begin_s = float(self._parts[0].time_s[0]) if self._parts else up_s
        self._made_s = -math.inf

    def _keep(self, since_s: float) -> None:
        """Forget the rows before a time."""
        kept = [part for part in self._parts if part.time_s[-1] >= since_s]
        if kept and kept[0].time_s[0] < since_s:
            kept[0] = kept[0].rows(kept[0].time_s >= since_s)
        self._parts = kept


def _since(history: FaultHistory, zero_s: float) -> FaultHistory:
    """Changes of the vehicle's clock as s of a flight that began at `zero_s`; what stood then
    stands from its first row on."""
    before = [faults for clock_s, faults in history if clock_s < zero_s]
    stood = [(0.0, before[-1])] if before and before[-1] else []
    return [*stood, *((c - zero_s, faults) for c, faults in history if c >= zero_s)]
