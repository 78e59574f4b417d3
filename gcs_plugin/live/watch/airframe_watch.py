"""Decide, once a flight, whether a vehicle that flies now is of the airframe; explain unknown
figures.

The comparison is the one for a file, over the last minute in flight, at most every 2.5 s. It
decides on the ground and in the first seconds of a flight, and the decision stays: a later
contradiction (a battery that collapses) is a finding and takes no margin away. An aircraft that was
not recognised is compared again during the flight. By how much outputs and battery let the ceiling
be too high is checked for the whole flight, with the battery's voltage from before take-off.

`unknown_figures` gives the reason for every figure that the screens cannot show.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.live.watch.outlook import Outlook
from thrustmargin.gcs_plugin.wording import live_words as words
from thrustmargin.gcs_plugin.wording.alarm_words import ONE_LOST
from thrustmargin.models.checks.speed_readings import FEWEST_ROWS
from thrustmargin.models.checks.voltage import ceiling_too_high, highest_voltages
from thrustmargin.models.flight import FlightTrack, join_tracks
from thrustmargin.models.model.airframe_match import AirframeMatch, match_airframe
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.rotor_model import RotorModel, identified_airframe
from thrustmargin.models.statement import state
from thrustmargin.models.vehicle_facts import VehicleFacts

NOT_YET = state("not yet")  # why no margin is claimed before the first seconds in flight


def unknown_figures(analysis: FlightAnalysis, outlook: Outlook) -> dict[str, words.WhyUnknown]:
    """Return each figure that is unknown in the newest row, by its name, with the reason; empty if
    all are known.

    Figures by rotor speed are unknown only in flight. Where no airframe is recognised, only a
    missing rotor speed in flight is listed.
    """
    row = -1
    track = analysis.track
    tank_unknown = math.isnan(track.tank_kg[row])
    speeds = bool(np.isfinite(track.rotor_speed_rpm[row]).any())
    measured = speeds and not analysis.from_outputs[row].all()
    predicted = bool(np.isfinite(analysis.margin_predicted[row]).any())
    why_predicted = words.NO_LOAD if tank_unknown else words.NO_AIRSPEED
    why_predicted = words.BAD_PART if analysis.bad_part else why_predicted
    found: dict[str, words.WhyUnknown] = {}
    if track.flying[row] and not speeds:
        found[words.MEASURED_MARGIN] = words.NO_SPEEDS
    if analysis.no_verdict:
        return found
    if not predicted:
        found[words.PREDICTED_MARGIN] = why_predicted
    if math.isnan(analysis.redundancy_yaw_uncontrolled[row]):
        found[ONE_LOST] = words.BAD_PART if analysis.bad_part else words.NO_LOAD
    if tank_unknown:
        found[words.TANK] = words.NO_LOAD
    if track.flying[row] and not measured:
        found[words.TANK_BY_THRUST] = words.NO_MEASURED
    if math.isnan(outlook.seconds_to_empty):
        found[words.TIME_TO_EMPTY] = words.NO_LOAD if tank_unknown else words.NO_FLOW
    if math.isnan(outlook.margin_ahead):
        placed = np.isfinite(track.position_ned[row]).all()
        without = words.NO_MISSION if outlook.route is None and placed else words.NO_POSITION
        without = words.BAD_PART if outlook.route and not outlook.sound else without
        found[words.REMAINING_ROUTE] = words.NO_LOAD if tank_unknown and outlook.route else without
    if math.isnan(outlook.margin_full):
        found[words.FULL_MARGIN] = words.BAD_PART if analysis.bad_part else words.NO_AIRSPEED
    return found


def unknown_lines(
    figures: Mapping[str, words.WhyUnknown], asked: Collection[str] = ()
) -> Iterable[str]:
    """Yield one sentence for each reason, with all figures that are unknown for it.

    `figures` maps a figure's name to its reason, `asked` are the options by which the vehicle is
    already asked for messages.
    """
    for reason in dict.fromkeys(figures.values()):
        names = [name for name, why in figures.items() if why == reason]
        yield words.unknown_words(names, reason.text(asked))


#: s between two rows of the evidence, between two looks, and that the evidence reaches back
STEP, EVERY, REACH = 0.25, 2.5, 60.0
#: Looks on end that must speak for it: to speak against an airframe, and for it again.
AGAINST, FOR = 2, 4
OPENING = 12.0  # s in flight in which it is decided
LANDED = 5.0  # s on the ground after which a new flight begins


class AirframeWatch:
    """Repeated decision whether one vehicle is of the model's airframe (`airframe_match`).

    `given`: the user named the airframe, so it is trusted from the start. `source` is the link, for
    the command suggested to the user.
    """

    def __init__(self, model: RotorModel, *, given: bool, source: str) -> None:
        self._airframe = identified_airframe(model)
        self._given = given
        self._source = source
        #: The evidence in order: tracks, and of each the rows.
        self._parts: list[tuple[FlightTrack, NDArray[np.intp]]] = []
        self._last_s = -np.inf  # of its last row
        self._looked_s = self._taken_s = -np.inf
        self._volts = np.empty(0)  # the most that the battery read, V
        self._other_rotors = False  # reported last
        self._against = 0  # looks on end that spoke against what is decided
        self._opened_s = np.inf  # first row of this flight
        self._ground_s = -np.inf  # first row on the ground; NaN in flight
        self.airframe_match = self._first()

    def _first(self) -> AirframeMatch:
        if self._given:
            return AirframeMatch(airframe=self._airframe.name, source=self._source)
        return AirframeMatch(basis="not known", no_verdict=(NOT_YET,), source=self._source)

    def look(
        self, track: FlightTrack, facts: VehicleFacts, parameters: Mapping[str, float]
    ) -> AirframeMatch:
        """Add new rows, in order of time, and return the match that holds from the first on.

        `facts` and `parameters` are what the vehicle has reported so far. Another rotor count
        contradicts at once. The match must not depend on how many rows come at once: the caller
        splits rows at `due_s`.
        """
        if track.rotor_count != self._airframe.rotor_count:  # certain, and at once
            if not self._other_rotors:
                now = match_airframe(track, self._airframe, facts, parameters, given=self._given)
                self.airframe_match = replace(now, source=self._source)
                self._other_rotors, self._parts, self._last_s = True, [], -np.inf
            return self.airframe_match
        if self._other_rotors:
            self._other_rotors, self.airframe_match = False, self._first()
        due = track.time_s[0] >= self.due_s or track.time_s[0] <= self._last_s
        first = slice(0, 1) if due else slice(None)
        self._take(track.rows(first))
        if due and self._parts:
            self._look(facts, parameters)
        if due:
            self._take(track.rows(slice(1, None)))
        return self.airframe_match

    @property
    def due_s(self) -> float:
        """Return the track's time, s, from which the next row causes a new comparison; -inf
        before the first."""
        return self._looked_s + EVERY

    def _take(self, track: FlightTrack) -> None:
        if track.time_s.size:
            self._volts = highest_voltages(np.append(self._volts, track.voltage), self._airframe)
            self._gather(track)

    def _look(self, facts: VehicleFacts, parameters: Mapping[str, float]) -> None:
        """Compare the last minute in flight with the airframe and update the decision.

        Nothing is decided with fewer than FEWEST_ROWS rows.
        """
        self._looked_s = self._taken_s
        since = self._last_s - REACH
        evidence = join_tracks([(t, rows[t.time_s[rows] > since]) for t, rows in self._parts])
        self._parts = [(evidence, np.arange(evidence.time_s.size))]
        if evidence.time_s.size >= FEWEST_ROWS:
            trusted = self._given or self.airframe_match.basis == "recognised"
            now = match_airframe(evidence, self._airframe, facts, parameters, given=trusted)
            if now.outputs is not None:
                high = ceiling_too_high(self._volts, self._airframe)
                now = replace(now, outputs=replace(now.outputs, ceiling_high=high))
            self._decide(replace(now, source=self._source))

    def _gather(self, track: FlightTrack) -> None:
        time_s, flying = track.time_s, track.flying
        self._taken_s = float(time_s[-1])
        if time_s[0] <= self._last_s:  # it was started anew
            self._parts, self._looked_s, self._last_s = [], -np.inf, -np.inf
            self._opened_s, self._ground_s = np.inf, -np.inf
        for run in np.split(np.arange(time_s.size), np.flatnonzero(np.diff(flying)) + 1):
            began_s = float(time_s[run[0]])
            if not flying[run[0]]:
                self._ground_s = began_s if np.isnan(self._ground_s) else self._ground_s
                continue
            if began_s - self._ground_s > LANDED:
                self._parts, self._opened_s, self._against = [], began_s, 0
            self._ground_s = np.nan
            steps = np.floor(time_s[run] / STEP)
            rows = run[np.diff(steps, prepend=np.floor(self._last_s / STEP)) > 0]
            if rows.size:
                self._parts.append((track, rows))
                self._last_s = float(time_s[rows[-1]])

    def _decide(self, now: AirframeMatch) -> None:
        before = self.airframe_match
        if before.no_verdict == (NOT_YET,):
            self.airframe_match = now
            return
        held = not before.no_verdict and self._last_s - self._opened_s > OPENING
        misfits = before.misfit or before.no_verdict
        if bool(now.no_verdict) == bool(misfits):
            self._against = 0
            if not (before.no_verdict or now.no_verdict):
                self.airframe_match = replace(before, outputs=now.outputs)
            return
        self._against += 1
        if self._against < (AGAINST if now.no_verdict else FOR):
            return
        self._against = 0
        if held:
            now = replace(before, misfit=now.no_verdict)
        elif before.basis == "recognised":  # and was given by nobody
            now = replace(now, basis="not known")
        self.airframe_match = now
