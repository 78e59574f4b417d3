"""The flight in progress, kept whole, so that its answer is that of a report of the flight so far.

The rows are those of the monitor; load and speeds are inferred anew over all of them, as for a
file. SETTLED seconds after the landing the answer is the report's (landed_flight.py). A flight
begins at the first row heard, and anew at the first take-off after LONG_DOWN s on the ground, or
after a stay in which it was disarmed, or its tank or battery became fuller, as a file is divided.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from thrustmargin.gcs_plugin.live.alarms.alarm import AlarmEvent
from thrustmargin.gcs_plugin.live.alarms.listed_alarms import Alarms
from thrustmargin.gcs_plugin.live.rows.vehicle_state import VehicleState
from thrustmargin.gcs_plugin.logs.tlog import AUTOPILOTS
from thrustmargin.gcs_plugin.telemetry.first_contact import first_contact
from thrustmargin.gcs_plugin.telemetry.flight_log import LONG_DOWN, LOOK, REST, serviced
from thrustmargin.gcs_plugin.wording.answer import FlightAnswer, answer_of
from thrustmargin.gcs_plugin.wording.language import spoken
from thrustmargin.gcs_plugin.wording.report_words import FirstContact
from thrustmargin.models.checks.instruments import without_frozen
from thrustmargin.models.checks.loss_of_control import before_loss, loss_of_control
from thrustmargin.models.checks.motor_order import MotorOrder, check_motor_order
from thrustmargin.models.checks.output_evidence import OutputEvidence, output_evidence
from thrustmargin.models.flight import FlightTrack, Floats, join_tracks
from thrustmargin.models.model.advice import Advice, advise
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.inferred.load_inference import fill_channels, with_load_for_verdict
from thrustmargin.models.model.rotor_faults import FaultHistory
from thrustmargin.models.model.rotor_model import RotorModel, identified_airframe

#: s of the vehicle's clock between two verdicts, and the share by which its rows have grown: more
#: rows take longer, and change the verdict less.
AGAIN_S, GROWN = 5.0, 0.05
SETTLED = 5.0  # s on the ground after which a flight is over, for as long as none follows
STOOD = 600.0  # s on the ground before the first take-off that are kept


@dataclass(frozen=True, slots=True, eq=False)
class FlightAdvice:
    """The advice of a flight's report, or of a flight so far."""

    advice: Advice
    contact: FirstContact | None  # of an aircraft that is not known


@dataclass(frozen=True, kw_only=True, eq=False)
class FlightSoFar:
    """A flight up to a row; its advice is computed when a screen needs it."""

    track: FlightTrack  # as reported
    state: VehicleState
    model: RotorModel
    airframe_match: AirframeMatch
    faults: FaultHistory
    limit: float  # share of a rotor's largest thrust that may last
    goes_on: bool  # it has not landed
    reported: Callable[[], FlightAdvice | None] = lambda: None  # of one that is over

    @property
    def advice(self) -> Advice:
        """Return the advice on the flight so far; after its end, the advice of its report."""
        return (self.reported() or self.so_far).advice

    @property
    def parameters(self) -> Mapping[str, float]:
        """Return the autopilot's parameters by name."""
        return self.state.parameters

    @cached_property
    def measured(self) -> FlightTrack:
        """Return the track without the readings of frozen instruments, as the reading of a log
        removes them."""
        return without_frozen(self.track, identified_airframe(self.model), self.parameters)

    @cached_property
    def outputs(self) -> OutputEvidence | None:
        """Return the load by the motor outputs of all rows; None where no margin is claimed.

        The airframe_match was decided in the first climb, where outputs show more than the weight.
        """
        if self.airframe_match.no_verdict:
            return None
        return output_evidence(self.measured, identified_airframe(self.model), self.parameters)

    @cached_property
    def _prepared(self) -> FlightTrack:
        craft = None if self.airframe_match.no_verdict else identified_airframe(self.model)
        return fill_channels(self.measured, craft, self.parameters)

    @cached_property
    def beyond_gauge_kg(self) -> float:
        """Return the median mass, kg, by which hover thrust exceeds gauge or statement, in flight.

        0 if that is not significant, or without a verdict.
        """
        if self.airframe_match.no_verdict:
            return 0.0
        track = with_load_for_verdict(self._prepared, identified_airframe(self.model), self.outputs)
        beyond = (track.tank_kg - self._prepared.tank_kg)[track.flying]
        return 0.0 if track is self._prepared else float(np.nanmedian(beyond))

    @cached_property
    def order(self) -> MotorOrder | None:
        """Return the order of the motors by the flight's manoeuvres; None where no margin is
        claimed."""
        if self.airframe_match.no_verdict:
            return None
        flown = before_loss(self._prepared, loss_of_control(self._prepared))
        return check_motor_order(flown, identified_airframe(self.model))

    @property
    def other_order(self) -> bool:
        """Return True if the motors are in another order, or in other places, than the
        airframe's."""
        return self.order is not None and self.order.verdict not in ("agrees", "unclear")

    def shown_by(self, airframe_match: AirframeMatch) -> AirframeMatch:
        """Return the match with motor outputs and motor order replaced by those from all rows of
        the flight.
        """
        open_pairs = () if self.order is None else self.order.open_pairs
        return replace(
            airframe_match,
            outputs=self.outputs,
            other_order=self.other_order,
            open_pairs=open_pairs,
        )

    @cached_property
    def so_far(self) -> FlightAdvice:
        """Return the advice of a report of these rows, with the faults that alarms found."""
        track, state = self._prepared, self.state
        made = advise(
            analyse(track, self.model, airframe_match=self.shown_by(self.airframe_match)),
            limit=self.limit,
            history=self.faults,
            in_progress=self.goes_on,
        )
        pilot = AUTOPILOTS.get(state.autopilot, "unknown")
        known = self.measured, self.airframe_match, state.parameters, state.facts
        return FlightAdvice(made.advice, first_contact(*known, autopilot=pilot, recorded=False))

    @property
    def settled(self) -> bool:
        """Return True if the flight has ended and its report is ready."""
        return self.reported() is not None

    @property
    def answer(self) -> FlightAnswer:
        """Return the answer of the flight in words of the current language.

        Until its report is ready it includes the time up to which it is valid.
        """
        made = spoken(), self.settled
        if made not in self._answers:
            advice = (self.reported() if self.settled else None) or self.so_far
            until_s = math.nan if self.settled else float(self.track.time_s[-1])
            self._answers[made] = answer_of(advice.advice, advice.contact, until_s)
        return self._answers[made]

    @cached_property
    def _answers(self) -> dict[tuple[str, bool], FlightAnswer]:
        """Return the cache of answers, by language and `settled`."""
        return {}


#: Returns the verdict of a flight that is over, once it is known.
Over = Callable[[FlightSoFar], Callable[[], FlightAdvice | None]]


class SortieRows:
    """The rows since a vehicle's start, divided into flights; `now` is the newest flight.

    `over` is called once for each flight that has ended, and returns a function for its report's
    advice.
    """

    def __init__(self, model: RotorModel, alarms: Alarms, over: Over) -> None:
        self._model, self._alarms, self._over = model, alarms, over
        self._reported = False  # `now` is over, and read as a file
        self._earlier = len(alarms.fault_history)  # changes before this start of the vehicle
        self._parts: list[FlightTrack] = []
        self._zero_s = self._begin_s = 0.0  # clock when the track's time is 0; of the flight
        self._flown = self._disarmed = False
        self._landed_s = math.nan
        self._stay: tuple[float, float] | None = None  # landing and take-off, until it is checked
        self._made_s = -math.inf
        self._said: tuple[AirframeMatch, VehicleState] | None = None
        self.now: FlightSoFar | None = None  # None before the first take-off

    def add(
        self,
        track: FlightTrack,
        clock_s: Floats,
        airframe_match: AirframeMatch,
        state: VehicleState,
        events: Sequence[AlarmEvent],
    ) -> None:
        """Add the vehicle's next rows, and compute the flight's result anew if due.

        `clock_s` (T,) is the vehicle's clock, s, at the rows of `track` (T at least 1).
        `airframe_match` and `state` are the latest decision on the airframe and the vehicle's
        reports. A raised alarm among `events`, those of these rows, makes the result due at once.
        """
        self._zero_s = float(clock_s[0] - track.time_s[0])
        self._said = airframe_match, state
        end_s, flying = float(track.time_s[-1]), np.flatnonzero(track.flying)
        if flying.size:
            self._take_off(float(track.time_s[flying[0]]))
        self._parts.append(track)
        if self._stay is not None and end_s >= self._stay[1] + LOOK:
            self._parts = [join_tracks([(part, slice(None)) for part in self._parts])]
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
        elif landed and self._begins_another_flight(end_s):
            self._keep(end_s - REST)  # the flight itself stays in `now`
        elif landed and end_s - self._landed_s >= SETTLED:
            self.settle()
        elif (
            self._landed_s == end_s
            or end_s - self._made_s >= due_s
            or any(event.raised for event in events)
        ):
            self.make()

    def settle(self) -> None:
        """End the flight, because it has landed or the recording ends, and request its report."""
        if self._reported:
            return
        self.make()
        if self.now is not None:
            self._reported, self.now = True, replace(self.now, reported=self._over(self.now))

    def restate(self) -> None:
        """Replace the sizes in fault alarms by those of the ended flight's report, once it is
        ready."""
        if self.now is None or not self._alarms.of_parts:
            return
        if (reported := self.now.reported()) is not None:
            advice = reported.advice
            self._alarms.restate([one.fault for one in advice.faults], advice.places)

    def make(self) -> None:
        """Set `now` to the flight up to the last row; nothing happens before the first take-off."""
        if not self._flown or self._said is None:
            return
        airframe_match, state = self._said
        whole = join_tracks([(part, slice(None)) for part in self._parts])
        self._parts = [whole]
        track = whole
        if self._begin_s > 0.0:
            track = replace(whole, time_s=whole.time_s - self._begin_s)
        zero_s = self._zero_s + self._begin_s
        self._made_s = float(whole.time_s[-1])
        self.now = FlightSoFar(
            track=track,
            state=state,
            model=self._model,
            airframe_match=airframe_match,
            faults=_since(self._alarms.fault_history[self._earlier :], zero_s),
            limit=self._alarms.settings.max_utilisation,
            goes_on=bool(track.flying[-1]),
        )

    @property
    def found_bad(self) -> bool:
        """Return True if a rotor or motor was found bad in the flight, or before it and not
        cleared."""
        found = () if self.now is None else self.now.faults
        return self._alarms.of_parts or any(faults for _, faults in found)

    @property
    def kept_s(self) -> float:
        """Return the time, s, from the first to the last stored row."""
        return float(self._parts[-1].time_s[-1] - self._parts[0].time_s[0]) if self._parts else 0.0

    def _begins_another_flight(self, time_s: float) -> bool:
        """Return True if a take-off at `time_s`, s of the track's time, would begin another flight.

        It would after REST s on the ground if the vehicle was disarmed there, else after LONG_DOWN
        s.
        """
        long = LONG_DOWN if not self._disarmed else REST
        return time_s - self._landed_s >= long

    def _take_off(self, time_s: float) -> None:
        if self._flown and (self._disarmed or time_s - self._landed_s >= LONG_DOWN):
            self._begin(self._landed_s, time_s)
        elif self._flown and self._landed_s < time_s:
            self._stay = self._landed_s, time_s
        self._flown, self._disarmed, self._landed_s = True, False, math.nan
        self._reported = False

    def _begin(self, down_s: float, up_s: float) -> None:
        """Begin another flight after a stay on the ground, `down_s` to `up_s`, track's s.

        Of the stay the later half is kept, at most REST s.
        """
        self._keep(max(up_s - REST, 0.5 * (down_s + up_s)))
        self._begin_s = float(self._parts[0].time_s[0]) if self._parts else up_s
        self._made_s = -math.inf

    def _keep(self, since_s: float) -> None:
        """Drop the rows before a time."""
        kept = [part for part in self._parts if part.time_s[-1] >= since_s]
        if kept and kept[0].time_s[0] < since_s:
            kept[0] = kept[0].rows(kept[0].time_s >= since_s)
        self._parts = kept


def _since(history: FaultHistory, zero_s: float) -> FaultHistory:
    """Return changes at the vehicle's clock as s of a flight that began at `zero_s`.

    A fault that was active then is active from the flight's first row.
    """
    before = [faults for clock_s, faults in history if clock_s < zero_s]
    stood = [(0.0, before[-1])] if before and before[-1] else []
    return [*stood, *((c - zero_s, faults) for c, faults in history if c >= zero_s)]
