"""Determine when the vehicle was off the ground."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.signals import Signals, best, known_rows, last_before
from thrustmargin.models.checks.held import RISEN, HeldSoFar, drop_held, flag_held, may_hover
from thrustmargin.models.flight import Bools, Floats, FlyingBy
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import G0, pressure_altitude
from thrustmargin.models.physics.flight_phases import stretches
from thrustmargin.models.physics.smoothing import known_means
from thrustmargin.models.provenance import Provenance, SourceKind
from thrustmargin.models.statement import Statement, Value

NAN = float("nan")

#: MAV_LANDED_STATE: on the ground, in the air, taking off, landing.
ON_GROUND, IN_AIR, TAKING_OFF, LANDING = 1, 2, 3, 4
#: m above the place of take-off or landing below which the legs may still touch
CLEAR = 0.2
#: share of the thrust in cruise below which a rotor only idles
IDLE_SHARE = 0.5
#: Output, or share of the thrust in cruise, at or below which motors idle: autopilots spin armed
#: motors at up to a tenth, and the least output in hover that they accept is an eighth.
IDLE_OUTPUT = 0.1
#: Share of gravity in the specific force, and m/s of climb, of an aircraft that rests on its legs.
AT_REST, STEADY = 0.9, 1.0
#: s at idle after which an aircraft is on the ground
IDLE_S = 3.0
#: s between two reports of the landed state
HEARD_S = 3.0
#: Rows from which an output that never changes is no control of anything.
FEWEST_ROWS = 20


@dataclass(frozen=True, slots=True, eq=False)
class Airborne:
    """The rows off the ground (T,), the kind of evidence, and its source."""

    flying: Bools
    by: FlyingBy
    source: Provenance


def airborne(
    signals: Signals,
    clock_s: Floats,
    channels: Mapping[str, Floats],
    airframe: Airframe | None = None,
) -> Airborne:
    """Flag which of T rows are off the ground; also return the kind of evidence and its source.

    `clock_s` (T,) is the vehicle's clock; `channels`, on these rows, must include rotor_speed_rpm
    and throttle, (T, R), unless `signals` report the vehicle disarmed throughout. The last row is
    on the ground if a landing is reported after it: many logs end with that report, less than a row
    later.
    """
    result = _airborne(signals, clock_s, channels, airframe)
    if not result.flying[-1:].any() or not _down_after(signals, float(clock_s[-1])):
        return result
    flying = result.flying.copy()
    flying[-1] = False
    return replace(result, flying=flying)


def _disarmed_since(signals: Signals, landed: Signal, clock_s: Floats) -> Bools:
    """Flag rows (T,) where the newest report of disarming is later than that of the landed state.

    A crashed vehicle reports no landing. `landed` is the signal of the landed state; all times are
    of the vehicle's clock, s. False throughout without reports of arming.
    """
    armed = best(signals, "armed")
    if armed is None:
        return np.zeros(clock_s.size, dtype=np.bool_)
    off_s = armed.time_s[known_rows(armed.values) & (armed.values <= 0)]
    reported_s = landed.time_s[known_rows(landed.values)]
    off, reported = (
        np.append(-np.inf, times)[np.searchsorted(times, clock_s, side="right")]
        for times in (off_s, reported_s)
    )
    return off > reported


def _down_after(signals: Signals, end: float) -> bool:
    """Return True if the landed state was last reported as on the ground, at `end` s or later.

    True too if the vehicle was last reported as disarmed then. Times are of the vehicle's clock;
    the best source of each counts. False without any report.
    """
    for channel, down in (("landed", (ON_GROUND,)), ("armed", (0.0,))):
        heights = best(signals, channel)
        if heights is None or not heights.time_s.size:
            continue
        if heights.time_s[-1] >= end and heights.values[-1] in down:
            return True
    return False


def _airborne(
    signals: Signals,
    clock_s: Floats,
    channels: Mapping[str, Floats],
    airframe: Airframe | None,
) -> Airborne:
    """Flag which of T rows are off the ground, with the test that decided; rows disarmed or with
    idle outputs never are.

    The rest follow the landed state and the height; without a landed state, thrust above IDLE_SHARE
    of that in cruise by rotor speeds or outputs; without these, a height of more than 1 m above
    home. No row is flagged without any of these, with constant outputs, with rotors too slow to
    lift, or if the height never rose. Stretches in which the aircraft is held are on the ground.
    `clock_s` (T,) is the vehicle's clock, s; `channels` are on these rows.
    """
    on = _motors_on(signals, clock_s)
    if not on.any():
        return _grounded(clock_s, FlyingBy.DISARMED)
    height, speeds = channels.get("height_agl"), channels["rotor_speed_rpm"]
    output, squares = known_means(channels["throttle"]), known_means(np.square(speeds))
    driven = np.isfinite(output) & on
    idle = driven & (output <= IDLE_OUTPUT)
    if driven.any() and idle.sum() == driven.sum():
        return _grounded(clock_s, FlyingBy.IDLE_OUTPUTS)
    turning = on & (squares > 0.0)
    if turning.any():  # whatever the landed state: with a tenth of its thrust it falls
        cruise = np.percentile(squares[turning], 75)
        idle |= turning & (squares <= IDLE_OUTPUT * cruise)
        idle |= turning & (squares <= IDLE_SHARE * cruise) & _borne(channels, squares.size)
    on = on & ~_idle_throughout(on & ~idle, clock_s)
    landed = best(signals, "landed")
    if landed is not None:
        state = last_before(landed, clock_s)
        known = known_rows(landed.values)
        first, first_s = landed.values[known][:2], landed.time_s[known][:1]
        # The state just before the first report equals it, unless reports are sent only on changes.
        if first.size == 2 and first[0] == first[1]:
            close = ~np.isfinite(state) & (first_s - clock_s <= HEARD_S)
            state = np.where(close, first[0], state)
        reported = np.isin(state, (IN_AIR, TAKING_OFF, LANDING)) & on
        reported &= ~_disarmed_since(signals, landed, clock_s)
        if height is None:
            return Airborne(reported, FlyingBy.LANDED_STATE, _by_landed_state(landed))
        body = _body(channels, squares, output)
        flying = _clear_of_ground(reported, height)
        if reported.any() and not flying.any():
            return _grounded(clock_s, FlyingBy.NEVER_ROSE)
        flying &= drop_held(reported, stretches(reported), clock_s, body)
        if reported.any() and not flying.any():
            return _grounded(clock_s, FlyingBy.HELD)
        source = _flying_by("landed state and height", landed.source, clear=CLEAR)
        return Airborne(flying, FlyingBy.LANDED_STATE, source)
    measured = bool(np.isfinite(speeds).any())
    if not measured and np.count_nonzero(driven) >= FEWEST_ROWS:
        # Nothing hovers at one output: even in still air every motor is always corrected.
        spread = np.ptp(channels["throttle"][driven], axis=0)
        if np.all(spread[np.isfinite(spread)] == 0):
            return _grounded(clock_s, FlyingBy.CONSTANT_OUTPUTS)
    thrust, by = output, FlyingBy.MOTOR_OUTPUTS
    if measured:
        thrust, by = squares, FlyingBy.ROTOR_SPEEDS
        # Where outputs are known a wrong unit of the speeds would do the same: then a height must
        # deny it.
        sure = not driven.any() or (height is not None and bool(np.isfinite(height).any()))
        if sure and _too_slow(thrust[on], speeds.shape[1], height, airframe):
            return _grounded(clock_s, FlyingBy.SLOW_ROTORS)
    lifting = thrust[on]
    if not on[0] and height is not None and _stayed_down(height, on):
        return _grounded(clock_s, FlyingBy.NEVER_ROSE)
    if np.any(lifting > 0):
        cruise = float(np.nanpercentile(lifting, 75))
        flying = on & (thrust > IDLE_SHARE * cruise) & (thrust > 0.0)
        body = _body(channels, may_hover(squares, speeds.shape[1], airframe))
        free = drop_held(flying, stretches(on), clock_s, body)
        if flying.any() and not free.any():
            return _grounded(clock_s, FlyingBy.HELD)
        source = _flying_by("thrust in cruise", by=by.value, share=IDLE_SHARE)
        return Airborne(free, by, source)
    if height is not None and np.isfinite(height).any():
        return Airborne(on & (height > RISEN), FlyingBy.HEIGHT, _flying_by("above home"))
    return _grounded(clock_s, FlyingBy.NOT_KNOWN)


def _grounded(clock_s: Floats, by: FlyingBy) -> Airborne:
    """Return no row off the ground, for the reason `by`."""
    none = np.zeros(clock_s.size, dtype=np.bool_)
    return Airborne(none, by, _flying_by(f"grounded: {by.value}"))


def _flying_by(kind: str, *parts: Provenance, **values: Value) -> Provenance:
    """Return the source of the rows off the ground: a remark of `kind` with `values`, derived from
    `parts`.
    """
    remark = Statement(kind, values=tuple(values.items()))
    return Provenance(kind=SourceKind.INFERRED, parts=parts, remarks=(remark,))


def _by_landed_state(landed: Signal) -> Provenance:
    """Return the source of the rows off the ground by the landed state alone."""
    return _flying_by("landed state", landed.source)


def _borne(channels: Mapping[str, Floats], rows: int) -> Bools:
    """Flag rows (T,) in which the ground may bear the aircraft: no fall, and no climb or sink.

    `channels` are on these rows, T = `rows`. The specific force is above AT_REST g and the vertical
    speed below STEADY m/s. False where either is unknown. An aircraft in the air with half of the
    thrust in cruise would fall, or sink fast.
    """
    nothing = np.full((rows, 3), NAN)
    force = np.linalg.norm(channels.get("specific_force_frd", nothing), axis=1)
    climb = channels.get("velocity_ned", nothing)[:, 2]
    return (force > AT_REST * G0) & (np.abs(climb) < STEADY)


def _motors_on(signals: Signals, clock_s: Floats) -> Bools:
    """Flag rows (T,) where the vehicle is not reported as disarmed; all without any such report.

    A row is not flagged either if the vehicle was disarmed since the row before.
    """
    armed = best(signals, "armed")
    if armed is None:
        return np.ones(clock_s.size, dtype=np.bool_)
    state = last_before(armed, clock_s)
    rows = known_rows(armed.values)
    known = armed.values[rows]
    # Before its first report the state was the reported one.
    on = np.where(np.isfinite(state), state, known[0]) > 0
    # Disarmed and armed again in a pause of the log, the row after it is the first of another time.
    off_s = armed.time_s[rows][known <= 0]
    on[1:] &= np.diff(np.searchsorted(off_s, clock_s, side="right")) == 0
    return on


def _idle_throughout(above_idle: Bools, clock_s: Floats) -> Bools:
    """Flag rows (T,) not above idle that are more than IDLE_S s from the nearest row above idle.

    `above_idle` (T,) flags the latter, `clock_s` (T,), s, ascends. A shorter time at idle may be a
    fast descent. All rows are flagged if none is above idle.
    """
    when = clock_s[above_idle]
    if when.size == 0:
        return ~above_idle
    nearest = np.searchsorted(when, clock_s)
    before = clock_s - when[np.maximum(nearest - 1, 0)]
    after = when[np.minimum(nearest, when.size - 1)] - clock_s
    return ~above_idle & (np.minimum(np.abs(before), np.abs(after)) > IDLE_S)


def _stayed_down(height: Floats, on: Bools) -> bool:
    """Return True if, in all armed rows, the height is at most CLEAR m above the last known height
    before arming.

    `height` (T,) is in m, NaN where unknown; `on` (T,) flags armed rows. Arming is at the first
    flagged row. Return False if no height is known before arming, or none while armed.
    """
    first = int(np.argmax(on))
    ground, later = height[:first], height[first:][on[first:]]
    known, risen = ground[np.isfinite(ground)], later[np.isfinite(later)]
    return bool(known.size and risen.size and risen.max() <= known[-1] + CLEAR)


def _too_slow(
    squares: Floats, rotors: int, height: Floats | None, airframe: Airframe | None
) -> bool:
    """Return True if the largest of `squares` lifts under half the empty weight, and nothing rose.

    `squares` (T,), rpm², is the mean over the rotors; `height` (T,), m, rose if above RISEN. False
    without airframe or speeds.
    """
    if airframe is None or not np.isfinite(squares).any():
        return False
    most = airframe.thrust_coefficient * rotors * float(np.nanmax(squares))
    rose = height is not None and np.isfinite(height).any() and float(np.nanmax(height)) > RISEN
    return most < IDLE_SHARE * airframe.empty_mass * G0 and not rose


@dataclass(frozen=True, slots=True)
class GroundContact:
    """The state of the last time on the ground, for the next batch of rows."""

    on_ground: bool = False  # the vehicle has been heard on the ground
    height: float = NAN  # m, of the ground: the first height after it reported to fly
    clear: bool = False  # it has been CLEAR above that


def airborne_so_far(
    signals: Signals,
    clock_s: Floats,
    channels: Mapping[str, Floats],
    airframe: Airframe | None,
    contact: GroundContact,
    before: HeldSoFar,
) -> tuple[Bools, Provenance, GroundContact, HeldSoFar]:
    """Flag rows (T,) off the ground from past rows only; return source and two new states too.

    `contact` and `before` are the states that the last call returned. `clock_s` (T,) is the
    vehicle's clock, s; `channels`, on these rows, must include rotor_speed_rpm and throttle, (T,
    R). Unlike in `airborne`, the last moments before a landing count as flying, half the empty
    weight replaces the unknown cruise thrust, and an armed vehicle without rotor speeds counts as
    flying, so that it is watched.
    """
    landed = best(signals, "landed")
    state = np.full(clock_s.size, NAN) if landed is None else last_before(landed, clock_s)
    armed = best(signals, "armed")
    motors_on = np.full(clock_s.size, NAN) if armed is None else last_before(armed, clock_s)
    speeds = channels["rotor_speed_rpm"]
    # Zero is no measurement: most ESCs report it while they have not measured.
    turning = (np.abs(speeds) > 0.0).any(axis=1) & (airframe is not None)
    heights = channels.get("height_agl", np.full(clock_s.size, NAN))
    flying = np.where(np.isfinite(motors_on), motors_on > 0, heights > RISEN)
    if airframe is not None:
        thrust = airframe.thrust_coefficient * np.nansum(np.square(speeds), axis=1)
        flying = np.where(turning, thrust > IDLE_SHARE * airframe.empty_mass * G0, flying)
    for row in np.flatnonzero(np.isfinite(state)).tolist():
        flying[row] = int(state[row]) in (IN_AIR, TAKING_OFF, LANDING)
        if not flying[row]:
            contact = GroundContact(on_ground=True)
        elif contact.on_ground and not contact.clear and np.isfinite(heights[row]):
            # First heard in the air, where the ground is cannot be known.
            ground = heights[row] if np.isnan(contact.height) else contact.height
            clear = bool(heights[row] > ground + CLEAR)
            contact = GroundContact(on_ground=True, height=float(ground), clear=clear)
            flying[row] = clear
        elif contact.on_ground and not contact.clear:
            flying[row] = np.isnan(contact.height)
    output = known_means(channels["throttle"])
    idle = output <= IDLE_OUTPUT
    flying &= ~idle | np.isfinite(state) | turning
    flying &= ~(motors_on == 0)
    source = _flying_by("speeds else armed") if landed is None else _by_landed_state(landed)
    squares = known_means(np.square(speeds))
    if landed is None:
        body = _body(channels, may_hover(squares, speeds.shape[1], airframe))
    else:
        body = _body(channels, squares, output)
    down, now = flag_held(
        before,
        clock_s,
        flying.astype(np.bool_),
        motors_on == 0,
        body,
        clear=CLEAR if landed is None else -np.inf,
    )
    return flying.astype(np.bool_) & ~down, source, contact, now


def _clear_of_ground(flying: Bools, height: Floats) -> Bools:
    """Return a copy of `flying` (T,) without rows at the ends of its stretches that are not clear
    of ground.

    Clear is more than CLEAR m above the height (T,), m, of the stretch's first or last known row.
    No row is removed where the log begins or ends in the air, nor from a stretch that is never
    clear or without a known height.
    """
    result = flying.copy()
    for first, end in stretches(flying):
        part = height[first:end]
        known = np.flatnonzero(np.isfinite(part))
        if known.size == 0:
            continue
        if first > 0 or part[known[0]] <= RISEN:
            up = np.flatnonzero(part > part[known[0]] + CLEAR)
            if up.size == 0:
                continue
            result[first : first + up[0]] = False
        if end < flying.size:
            above = np.flatnonzero(part > part[known[-1]] + CLEAR)
            if above.size:
                result[first + above[-1] + 1 : end] = False
    return result


def _body(channels: Mapping[str, Floats], squares: Floats, output: Floats | None = None) -> Floats:
    """Return the columns (T, 15) that `checks.held` takes, NaN where a channel is missing.

    These are height_agl, attitude (3), velocity_ned (3), the mean square of the rotor speeds,
    output, specific_force_frd (3), asked_attitude (2) and the altitude of the pressure, m.
    `squares` (T,) is one mean square of all rotors' speeds, and its zeros become NaN: a stopped
    rotor reports nothing. `output` (T,) is NaN if not given.
    """
    nothing = np.full((squares.size, 3), NAN)
    return np.column_stack(
        (
            channels.get("height_agl", nothing[:, 0]),
            channels.get("attitude", nothing),
            channels.get("velocity_ned", nothing),
            np.where(squares > 0.0, squares, NAN),
            nothing[:, 0] if output is None else output,
            channels.get("specific_force_frd", nothing),
            channels.get("asked_attitude", nothing[:, :2]),
            pressure_altitude(channels.get("pressure", nothing[:, 0])),
        )
    )
