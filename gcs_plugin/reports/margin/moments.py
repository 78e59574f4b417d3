"""The worst moments of a flight, what the vehicle was doing in them, and its rotor alarms.

A flight beside the forecast of its plan, made with what was assumed before the take-off.

Without that it is still and standard air at home's height, the battery that the parameters name,
full, and the fill that the log has at take-off. What the flight shows of the day is compared.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from thrustmargin.gcs_plugin.logs import FlightLog
from thrustmargin.gcs_plugin.logs.findings import Finding, Spoils, report_findings
from thrustmargin.gcs_plugin.reports.margin.data import JsonObject
from thrustmargin.gcs_plugin.reports.shared.page_shell import unix_text
from thrustmargin.gcs_plugin.wording.actions import Phase
from thrustmargin.gcs_plugin.wording.alarm_words import fault_words
from thrustmargin.gcs_plugin.wording.flight_words import NAMES_WRONG
from thrustmargin.gcs_plugin.wording.language import say
from thrustmargin.gcs_plugin.wording.margin_verdict import Fact, Moment
from thrustmargin.gcs_plugin.wording.plan_words import beside_words
from thrustmargin.gcs_plugin.wording.report_words import NOT_SPRAYING
from thrustmargin.mission.forecast.plan_flight import PlanConditions
from thrustmargin.mission.plan_items import MissionPlan
from thrustmargin.mission.plan_tracking.blame import Off, shown_day, which_was_off
from thrustmargin.mission.plan_tracking.stretches import (
    PlanToFly,
    conditions_before_take_off,
    flown_way,
    yaw_before,
)
from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.model.analysis import FlightAnalysis, worst_rotor
from thrustmargin.models.model.flight_day import day_before_take_off
from thrustmargin.models.model.flight_power import flight_power
from thrustmargin.models.model.output_faults import MisreadSpeed
from thrustmargin.models.model.rotor_faults import FaultEpisode
from thrustmargin.models.physics.electric_power import power_law
from thrustmargin.models.physics.smoothing import known_mean

#: Moments closer than this are one moment, s: about the length of a turn at a line end.
APART_S = 6.0
MOST_MOMENTS = 8

#: From these on a movement is named. Turn: a quarter turn in under 9 s. Speed: walking pace.
TURN_RATE = np.radians(10.0)  # rad/s
CLIMB_RATE = 0.5  # m/s
SPEED_CHANGE = 0.5  # m/s²
HOVER_SPEED = 0.5  # m/s
BANK = np.radians(15.0)  # rad
#: The movement is measured over this time around the moment, s: shorter is sensor noise.
AROUND_S = 1.0
TAKE_OFF_S = 5.0


def airborne_use(analysis: FlightAnalysis) -> Floats:
    """(T, R) known thrust utilisation; NaN on the ground."""
    return np.where(analysis.track.flying[:, None], analysis.known_utilisation, np.nan)


def worst_moments(analysis: FlightAnalysis) -> tuple[Moment, ...]:
    """The rows with the most thrust in use, worst first, each at least APART_S from the others.

    When rotors peak together the moment is listed once, with its worst rotor.
    """
    use = airborne_use(analysis)
    # One that may as well be none says nothing.
    use = np.where(analysis.use_ends[0] > 0.0, use, np.nan)
    left, _ = worst_rotor(use)
    time_s = analysis.track.time_s
    found = []
    while len(found) < MOST_MOMENTS and np.any(np.isfinite(left)):
        row = int(np.nanargmax(left))
        found.append(_moment(analysis, use, row))
        left[np.abs(time_s - time_s[row]) < APART_S] = np.nan
    return tuple(found)


def _moment(analysis: FlightAnalysis, use: Floats, row: int) -> Moment:
    track, time_s = analysis.track, float(analysis.track.time_s[row])
    begun, tankless = track.start_unix_s, not analysis.model.airframe.tank_volume_l
    rotor = int(np.nanargmax(use[row]))
    value = float(use[row, rotor])
    low, high = (float(end[row, rotor]) for end in analysis.use_ends)
    north, east, down = (float(x) for x in track.position_ned[row])
    latitude = longitude = float("nan")
    if track.origin is not None and np.isfinite(north) and np.isfinite(east):
        place = np.array([north, east, np.nan_to_num(down)])
        latitude, longitude, _ = track.origin.geodetic(place).tolist()
    return Moment(
        time_s=time_s,
        clock_utc=None if begun is None else unix_text(begun + time_s),
        rotor=rotor + 1,
        rotor_name=analysis.places[rotor],
        capacity_use=value,
        capacity_use_low=low,
        capacity_use_high=high,
        margin=1.0 - value,
        basis=analysis.basis_of(row, rotor),
        doing=doing(analysis, row),
        # An aircraft without a tank carries no 0 kg of liquid, but may carry a payload.
        tank_kg=float(track.tank_kg[row] or np.nan) if tankless else float(track.tank_kg[row]),
        ground_speed=float(np.hypot(*track.velocity_ned[row, :2])),
        airspeed=float(track.airspeed[row]),
        climb_rate=-float(track.velocity_ned[row, 2]),
        height_agl=float(track.height_agl[row]),
        north=north,
        east=east,
        latitude_deg=latitude,
        longitude_deg=longitude,
        redundancy_yaw_free=float(analysis.redundancy_yaw_uncontrolled[row]),
    )


@dataclass(frozen=True, slots=True)
class Activity:
    """One thing that the vehicle was doing at a moment."""

    kind: str  # in English, such as "braking"
    tilt_deg: float = math.nan  # of "tilted"

    @property
    def words(self) -> str:
        """Return the activity in the chosen language."""
        if math.isfinite(self.tilt_deg):
            return say("tilted {angle}°", angle=f"{self.tilt_deg:.0f}")
        return say(self.kind)


def doing(analysis: FlightAnalysis, row: int) -> tuple[str, ...]:
    """Return the words of `activities` in the chosen language."""
    return tuple(one.words for one in activities(analysis.track, row))


def activities(track: FlightTrack, row: int) -> tuple[Activity, ...]:
    """List what the vehicle did around a row, as far as the log's channels show it."""
    time_s = track.time_s
    near = np.abs(time_s - time_s[row]) <= AROUND_S / 2
    words = []
    flying = np.flatnonzero(track.flying)
    if flying.size and time_s[row] - time_s[flying[0]] < TAKE_OFF_S:
        words.append("taking off")
    elif (
        flying.size
        and time_s[flying[-1]] - time_s[row] < TAKE_OFF_S
        and flying[-1] + 1 < (time_s.size)
    ):
        words.append("landing")
    yaw_rate = known_mean(track.angular_rate_frd[near, 2])
    if abs(yaw_rate) > TURN_RATE:
        words.append(f"turning {'right' if yaw_rate > 0 else 'left'}")
    climb = -known_mean(track.velocity_ned[near, 2])
    if abs(climb) > CLIMB_RATE:
        words.append("climbing" if climb > 0 else "descending")
    speed = np.hypot(track.velocity_ned[near, 0], track.velocity_ned[near, 1])
    at, known = time_s[near] - time_s[near][0], np.isfinite(speed)
    change = np.polyfit(at[known], speed[known], 1)[0] if known.sum() > 2 else np.nan
    if abs(change) > SPEED_CHANGE:
        words.append("speeding up" if change > 0 else "braking")
    elif known_mean(speed) < HOVER_SPEED and "taking off" not in words and "landing" not in words:
        words.append("hovering")
    roll, pitch = known_mean(track.attitude[near, 0]), known_mean(track.attitude[near, 1])
    tilt = np.arccos(np.clip(np.cos(roll) * np.cos(pitch), -1.0, 1.0))
    if tilt > BANK:
        words.append("tilted")
    spraying = track.spraying[row]
    if spraying > 0.5:
        words.append("spraying")
    elif np.isfinite(spraying) and not words:
        words.append(NOT_SPRAYING)
    tilts = {"tilted": float(np.degrees(tilt))}
    return tuple(Activity(kind, tilts.get(kind, math.nan)) for kind in words)


def alarm_row(episode: FaultEpisode, names: Sequence[str]) -> JsonObject:
    """A fault of a rotor or motor, with the words of its live alarm."""
    fault = episode.fault
    return {
        "kind": fault.kind,
        "rotor": None if fault.rotors else fault.rotor + 1,
        "rotors": [rotor + 1 for rotor in fault.rotors or (fault.rotor,)],
        "from_s": episode.begin_s,
        "until_s": episode.end_s,
        "size": fault.size,
        "size_low": fault.lower,
        "size_high": fault.upper,
        "witnessed_by_outputs": fault.witnessed,
        "words": fault_words(fault, names, Phase.RECORDED),
    }


def misread_row(misread: MisreadSpeed | None) -> JsonObject | None:
    """The rotor, from 1, whose ESC reads `factor` times its speed; None without one."""
    if misread is None:
        return None
    return {
        "rotor": misread.rotor + 1,
        "factor": misread.factor,
        "witnessed_by_outputs": misread.witnessed,
    }


def look_facts(findings: Iterable[Finding]) -> Iterator[Fact]:
    """Return the findings about the log to show beside its verdict, names of rotors first."""
    order = sorted(report_findings(findings), key=lambda one: one.spoils is not Spoils.ROTOR_NAMES)
    for one in order:
        if one.spoils is Spoils.ROTOR_NAMES:
            yield Fact("rotor names", f"{NAMES_WRONG}{one.words}")
        else:
            yield Fact(one.check, one.words)


def plan_beside(
    analysis: FlightAnalysis,
    log: FlightLog,
    plan: MissionPlan,
    assumed: PlanConditions | None = None,
) -> JsonObject:
    """The stretches of `plan` as forecast and as flown, and which of what was `assumed` was off.

    The forecast draws the power that this flight measured. Raises PlanError when the plan flies
    nowhere.
    """
    measured = flight_power(analysis, log.name)
    model = analysis.model
    if measured is not None:
        model = replace(model, power=power_law([measured]))
    to_fly = PlanToFly.from_plan(plan, log.parameters, model, start_yaw=yaw_before(log.track))
    way = flown_way(analysis, plan.home)
    found = shown_day(analysis)
    origin = log.track.origin
    ground = math.nan if origin is None else origin.altitude
    given = assumed or conditions_before_take_off(
        log.parameters,
        model.airframe,
        fill_kg=found.fill_kg,
        altitude=plan.home[2] if math.isfinite(plan.home[2]) else ground,
        density=found.density,
        rest_voltage=day_before_take_off(analysis).battery_voltage.value,
    )
    made = to_fly.compare(given, way)
    off: tuple[Off, ...] = ()
    if made.stretches:
        off = which_was_off(lambda changed: to_fly.compare(changed, way), given, found)
    return {
        "words": beside_words(off, made.stretches, left_at=made.left_at),
        "left_at": made.left_at,
        "off": [
            {"what": o.what, **asdict(o.amount), "item": o.item, "mattered": o.mattered}
            for o in off
        ],
        "assumed": {
            "tank_start_kg": given.fill_kg,
            "density": given.density,
            "wind": math.hypot(*given.wind_ned),
            "limits": list(to_fly.course.limits.assumed),
        },
        "stretches": made.stretches,
    }
