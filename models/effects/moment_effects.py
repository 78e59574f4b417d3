"""Effects on the roll, pitch and yaw moments that the rotors must balance.

Centre of gravity: FRD axes, relative to the airframe file.

Drag: an aircraft leans into a wind until thrust and drag balance. The drag over its mass is the
specific force in the rotors' plane, which attitude and acceleration show without an airspeed
sensor:

    f = R^T (a - g)     roll moment = -h_roll f_right/g T     pitch moment = h_pitch f_forward/g T

R from body to NED, a from the velocity, T thrust. The height h at which that force would have to
act above the centre of gravity also contains the rotors' own moment in flow (flapping blades,
front rotors in cleaner air than rear ones), which is the larger part: an aircraft is some
centimetres high and h is about the length of an arm.

Yaw also has the rotors' own inertia. A motor that speeds its rotor up pushes the body back at once,
before the faster rotor has more drag. A yaw moment M(t) is the sum of drag and push,

    k dN + J d(dN)/dt = M      so that dN follows M as a first-order lag of J / k does,

with dN the difference in speed of the rotors of either spin, J a rotor's inertia about its axis and
k the slope of its torque over speed. For propellers of one shape the lag is proportional to the
root of their size. Roll and pitch are due to thrust, which has no such push. Source: Smeur, Chu and
de Croon 2016, Adaptive incremental nonlinear dynamic inversion for attitude control of micro air
vehicles.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from thrustmargin.models.effects.base import (
    GUESSED_TORQUE,
    USUAL_ARM,
    USUAL_MASS,
    Effect,
    Kind,
    Parameter,
    Values,
    shaping,
)
from thrustmargin.models.effects.channels import (
    LAG_STEP,
    RATE_SPAN,
    VELOCITY_SPAN,
    Channels,
    derivative_look,
    froude_time_scale,
    lag_weights,
    shifts_look,
)
from thrustmargin.models.flight import FlightTrack, Floats, body_axes
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import G0
from thrustmargin.models.physics.smoothing import derivative, moving_mean

RATIO = float(np.sqrt(2.0))
#: s, grid on which a lag is interpolated: 0.1 s on a quad of 40 g, half a second on a sprayer
SPIN_UPS = 0.025 * RATIO ** np.arange(12)


def slowed_yaw_rate(
    track: FlightTrack, airframe: Airframe, start: Floats | None = None
) -> tuple[Floats, Floats]:
    """Return the yaw rate, rad/s, after first-order lags with the K time constants SPIN_UPS, (T,
    K).

    NaN where the rate is unknown. The rate counts as linear between rows, so the steps are exact.
    Also return the state (K,) after the last row, to pass as `start` with the next rows; without
    `start` the rate was constant before.
    """
    time_s, rate = track.time_s, track.angular_rate_frd[:, 2]
    known = np.isfinite(rate)
    if not known.any():
        return np.full((time_s.size, SPIN_UPS.size), np.nan), np.zeros(SPIN_UPS.size)
    held = np.interp(time_s, time_s[known], rate[known])
    step = np.maximum(np.diff(time_s), 1e-6)[:, None]
    keep = np.exp(-step / SPIN_UPS)
    rise = (1.0 - (1.0 - keep) * SPIN_UPS / step) * np.diff(held)[:, None]
    first = np.full((1, SPIN_UPS.size), held[0]) if start is None else start[None]
    slowed = np.concatenate([first, (1.0 - keep) * held[:-1, None] + rise])
    kept, span = np.concatenate([np.zeros_like(first), keep]), 1
    while span < time_s.size:  # prefix sums: the span of rows added doubles
        slowed[span:] += kept[span:] * slowed[:-span]
        kept[span:] *= kept[:-span]
        span *= 2
    last = slowed[-1].copy()
    slowed[~known] = np.nan
    return slowed, last


def spin_up_moment(
    x: Channels, slowed: Floats, at_once: Floats, *, inertia, damping, lag: float, constant: float
) -> Floats:
    """Return the yaw moment (T,), N m, of a turn, delayed by the rotors' spin-up.

    The moment is inertia dr/dt + damping r of the yaw rate r, read `lag` s later, after a
    first-order lag of `constant`, s. `at_once` (T,) is it without spin-up and is returned for a
    `constant` of 0. `slowed` (T, K) is r after lags of SPIN_UPS, between which the result is
    interpolated; the derivative of a lagged r is (r - lagged r) / time constant.
    """
    if not constant > 0.0:
        return at_once
    rate, now = x.rate_shifts[2], lag_weights(lag)

    def lagged_moment(k: int) -> Floats:
        """Return the moment (T,), N m, after a lag with the time constant SPIN_UPS[k]."""
        own = float(SPIN_UPS[k])
        if lag < 0.0:  # rotor speeds are late: use the past columns of the table
            earlier = lag_weights(lag, time_constant=own) - lag_weights(0.0, time_constant=own)
            slow = slowed[:, k] + rate @ earlier
        else:
            left = float(np.exp(-lag / own))
            since = lag_weights(lag, time_constant=own, since=lag)
            slow = left * slowed[:, k] + (1.0 - left) * (rate @ since)
        return inertia * (rate @ now - slow) / own + damping * slow

    above = min(int(np.searchsorted(SPIN_UPS, constant)), SPIN_UPS.size - 1)
    if above == 0:
        share = constant / float(SPIN_UPS[0])
        return (1.0 - share) * at_once + share * lagged_moment(0)
    share = float(np.log(constant / SPIN_UPS[above - 1]) / np.log(RATIO))
    return (1.0 - share) * lagged_moment(above - 1) + share * lagged_moment(above)


def _offset_moment(p, x: Channels, thrust):
    """Return the moments of a centre of gravity at (x, y)."""
    return -p["y"] * thrust, p["x"] * thrust, 0.0 * thrust


def _tank_moment(p, x: Channels, thrust):
    """Return the moments of a centre of gravity that shifts in proportion to the tank level."""
    full = x.tank_kg / x.tank_capacity_kg
    return -p["y_full"] * full * thrust, p["x_full"] * full * thrust, 0.0 * thrust


def _offset_parameter(name: str) -> Parameter:
    """Return the parameter of an offset of the centre of gravity."""
    return Parameter(
        name=name,
        unit="m",
        lower=-0.5,
        upper=0.5,
        scale=0.05,
        smallest=0.0025,  # by how a battery is put in
        accuracy=0.01,  # lift of forward flight adds to each rotor's thrust, here it multiplies it
    )


CG_OFFSET = Effect(
    name="cg_offset",
    kind=Kind.MOMENTS,
    parameters=(_offset_parameter("x"), _offset_parameter("y")),
    of_every_aircraft=True,
    source="balance of moments: thrust stands off the centre of gravity by (x, y)",
    apply=_offset_moment,
)

CG_OFFSET_TANK = Effect(
    name="cg_offset",
    variant="tank",
    kind=Kind.MOMENTS,
    parameters=(_offset_parameter("x_full"), _offset_parameter("y_full")),
    needs=("tank_kg",),
    of_every_aircraft=True,
    source="balance of moments: a tank mounted off centre shifts the balance as it fills",
    apply=_tank_moment,
)


MEAN_SPAN = (
    2.0  # s of an aircraft of the F16's size: the lean into wind is slow, reports of it noisy
)
LOOK = derivative_look(VELOCITY_SPAN) + MEAN_SPAN / 2 + LAG_STEP


def lean(track: FlightTrack, airframe: Airframe, start: None = None) -> tuple[Floats, None]:
    """Return the specific force forward and right (T, 2), in g, computed from attitude and
    velocity.

    Smoothed over MEAN_SPAN Froude time scales. NaN in rows with a reported wind, where the flow's
    moment follows from the velocity. The second result is a state that is not used.
    """
    leaning = np.full((track.time_s.size, 2), np.nan)
    quick = froude_time_scale(airframe)
    force = derivative(track.time_s, track.velocity_ned, VELOCITY_SPAN * quick) - [0.0, 0.0, G0]
    forward, right, _ = body_axes(track.attitude)
    for k, axis in enumerate((forward, right)):
        along = np.sum(force * axis, axis=1) / G0
        leaning[:, k] = moving_mean(track.time_s, along, MEAN_SPAN * quick)
    leaning[np.isfinite(track.wind_ned).any(axis=1)] = np.nan
    return leaning, start


def _drag_moment(p, x: Channels, thrust):
    """Return the moments of drag that acts above the centre of gravity."""
    forward, right = x.own["drag_moment"].T
    return -p["roll"] * right * thrust, p["pitch"] * forward * thrust, 0.0 * thrust


def _height_parameter(name: str) -> Parameter:
    """Return the parameter of a height above the centre of gravity."""
    return Parameter(name=name, unit="m", lower=-4.0, upper=4.0, scale=0.5, smallest=0.05)


DRAG_MOMENT = Effect(
    name="drag_moment",
    kind=Kind.MOMENTS,
    parameters=(_height_parameter("roll"), _height_parameter("pitch")),
    needs=("drag_moment",),
    neutral={"drag_moment": 0.0},
    of_every_aircraft=True,
    source="balance of forces in wind: the force in the rotors' plane is drag, which acts at a "
    "height above the centre of gravity that holds the rotors' own moment in flow",
    # As the moment of flow: a sprayer, slow under its load, shows too little of it.
    with_tank=False,
    looks=lambda p: (LOOK, LOOK),
    own_channel=lean,
    apply=_drag_moment,
)


def flow(track: FlightTrack, airframe: Airframe, start: None = None) -> tuple[Floats, None]:
    """Return the airspeed along the horizontal directions forward and right (T, 2), m/s.

    It is velocity less wind, turned by the heading. NaN without a reported wind (still air must be
    reported too); `drag_moment` then uses `lean`. The second result is a state that is not used.
    """
    north, east, _ = (track.velocity_ned - track.wind_ned).T
    yaw = track.attitude[:, 2]
    forward = north * np.cos(yaw) + east * np.sin(yaw)
    return np.stack([forward, east * np.cos(yaw) - north * np.sin(yaw)], axis=1), start


def _flow_moment(p, x: Channels, thrust):
    """Return the moments of the flow on the rotors."""
    forward, right = x.own["flow_moment"].T
    lever = thrust * x.propeller_diameter / x.hover_induced_velocity
    return p["roll"] * right * lever, -p["pitch"] * forward * lever, 0.0 * thrust


def _gain_parameter(name: str) -> Parameter:
    """Return the parameter of a flow moment; `smallest` is due to an unreported wind of 0.5 m/s."""
    return Parameter(name=name, unit="1", lower=-1.0, upper=1.0, scale=0.1, smallest=0.01)


FLOW_MOMENT = Effect(
    name="flow_moment",
    kind=Kind.MOMENTS,
    parameters=(_gain_parameter("roll"), _gain_parameter("pitch")),
    needs=("flow_moment", "hover_induced_velocity"),
    neutral={"flow_moment": 0.0},
    of_every_aircraft=True,
    source="flapping of advancing and retreating blades, and front rotors in cleaner air than rear "
    "ones: moment = gain x thrust x propeller diameter x speed / induced velocity of hover",
    # Slow under its load, a sprayer shows too little of it: looked for there, it takes the place
    # of a speed channel that is late.
    with_tank=False,
    own_channel=flow,
    apply=_flow_moment,
)


SAMPLED = 0.04  # accuracy of the derivative of a rate that is sampled and noisy
MOST_DAMPING = 300.0  # a rate loop responds to gusts: commanded speeds act against the rate
AXES = ("roll", "pitch", "yaw")
MOST = 60.0  # kg m²
#: of MOST: the inertia about yaw of an aircraft whose whole mass sits at its rotors
AT_THE_ROTORS = USUAL_MASS * USUAL_ARM**2 / MOST


def _turning_moment(p, x: Channels, thrust):
    """Return the roll, pitch and yaw moments (T,), N m, of turning: inertia and damping at a lag.

    `p` are the effect's values by name. Moments scale with a power of the load; yaw includes the
    rotors' spin-up.
    """
    lag, loaded = p["lag"] - x.delay, (thrust / x.empty_weight) ** p["load_exponent"]
    weights = lag_weights(lag)
    tilt, yaw = (lag_weights(lag, p[f"derivative_correction_{of}"]) for of in ("tilt", "yaw"))
    axes = zip(AXES, x.rate_shifts, x.acceleration_shifts, (tilt, tilt, yaw), strict=True)
    roll, pitch, at_once = (
        acceleration @ (p[f"inertia_{axis}"] * sharpened) * loaded
        + rate @ (p[f"damping_{axis}"] * weights)
        for axis, rate, acceleration, sharpened in axes
    )
    about_yaw = spin_up_moment(
        x,
        x.own["manoeuvre_moment"],
        at_once,
        inertia=p["inertia_yaw"] * loaded,
        damping=p["damping_yaw"],
        lag=lag,
        constant=p["spin_up"],
    )
    return roll, pitch, about_yaw


def _turning_parameter(name: str, unit: str, most: float) -> Parameter:
    """Return the parameter of an inertia or damping."""
    return Parameter(
        name=name,
        unit=unit,
        lower=-most,
        upper=most,
        scale=5.0,
        smallest=0.2,  # liquid that moves, and air that the turn stirs
        accuracy=GUESSED_TORQUE if name.endswith("yaw") else SAMPLED,
        of_torque=name.endswith("yaw"),
    )


def _share_effect(
    effect: Effect, has: Sequence[Values], scatter: Mapping[str, float]
) -> Effect | None:
    """Return the effect that multiplies all turning moments by one share, as mass on the arms does.

    `effect` is the model's turning effect, `has` its values in each of the model's records (they
    add up), `scatter` the between-flight scatter by value name. Single axes do not get their own
    share: roll and pitch of an aircraft on its route are small, and would absorb late rotor speeds.
    None if the model's yaw inertia is not positive.
    """
    moments = [p.name for p in effect.parameters if not p.detail]
    whole = {name: sum(values[name] for values in has) for name in moments}
    # Yaw sets the size for all axes: rotor speeds show it best, because a yaw moment needs much
    # larger changes of thrust than roll and pitch do.
    yaw = next(p for p in effect.parameters if p.name == "inertia_yaw")
    if whole[yaw.name] <= 0.0:
        return None
    usual = yaw.smallest
    most = AT_THE_ROTORS * yaw.upper / whole[yaw.name] - 1.0
    share = Parameter(
        name="share",
        unit="1",
        lower=-1.0,
        upper=max(most, 1.0),
        scale=1.0,
        smallest=max(scatter.get(f"{effect.key}.{yaw.name}", usual), usual / 2) / whole[yaw.name],
        accuracy=SAMPLED,
    )

    def scaled_values(p: Values) -> Values:
        """Return the values of the original effect with all its moments multiplied by the share."""
        return {**has[0], **{name: p["share"] * whole[name] for name in moments}}

    return replace(
        effect,
        variant="changed",
        parameters=(share,),
        apply=lambda p, x, thrust: effect.apply(scaled_values(p), x, thrust),
        looks=lambda p: effect.looks(has[0]),
        change=None,
        kept_as=scaled_values,
    )


MANOEUVRE_MOMENT = Effect(
    name="manoeuvre_moment",
    kind=Kind.MOMENTS,
    parameters=(
        *(_turning_parameter(f"inertia_{axis}", "kg m^2", MOST) for axis in AXES),
        *(_turning_parameter(f"damping_{axis}", "N m s", MOST_DAMPING) for axis in AXES),
        shaping("load_exponent", "1", start=0.0, lower=-2.0, upper=2.0, scale=0.5),
        shaping(
            "derivative_correction_tilt", "1", start=1.0 / 12.0, lower=-0.33, upper=0.5, scale=0.2
        ),
        shaping(
            "derivative_correction_yaw", "1", start=1.0 / 12.0, lower=-0.33, upper=0.5, scale=0.2
        ),
        shaping("lag", "s", start=0.02, lower=0.0, upper=0.3, scale=0.1),
        Parameter(name="spin_up", unit="s", lower=0.0, upper=1.0, scale=0.2, detail=True),
    ),
    needs=("rate_shifts",),
    neutral={"rate_shifts": 0.0, "acceleration_shifts": 0.0, "manoeuvre_moment": 0.0},
    own_channel=slowed_yaw_rate,
    of_every_aircraft=True,
    source="Euler: moment = I d(omega)/dt + damping x omega; I goes with the load, as liquid and "
    "hidden mass change it; the derivative correction gives back what differences of a sampled "
    "rate smooth away; about yaw the rotors' own inertia acts too, by `spin_up`",
    apply=_turning_moment,
    change=_share_effect,
    looks=lambda p: shifts_look(p["lag"], derivative_look(RATE_SPAN)),
)


def _trim_moment(p, x: Channels, thrust):
    """Return the yaw moment of a tilted motor, proportional to thrust."""
    at_half_a_tank = x.empty_weight + G0 * x.tank_capacity_kg / 2.0
    return 0.0 * thrust, 0.0 * thrust, p["moment"] * thrust / at_half_a_tank


YAW_TRIM = Effect(
    name="yaw_trim",
    kind=Kind.MOMENTS,
    parameters=(
        Parameter(
            name="moment",
            unit="N m",
            lower=-20.0,
            upper=20.0,
            scale=1.0,
            smallest=0.1,  # one motor tilted by 0.1 degrees
            accuracy=GUESSED_TORQUE,
            of_torque=True,
        ),
    ),
    of_every_aircraft=True,
    source="a tilted motor turns part of its thrust into a yaw moment, in proportion to it; the "
    "moment is that of a hover with half a tank",
    one_variant=True,
    apply=_trim_moment,
)


#: times its own torque, the most with which a tilted rotor may drive its own spin: beyond it, yaw
#: control of a quad would act against itself
MOST_DRIVE = 3.0


def _upright_share(p, x: Channels):
    """Return the share (T,) of a tilted rotor's thrust that still lifts."""
    return np.cos(p["tilt"]) + 0.0 * x.time_s


def _tilted_torque(p, x: Channels):
    """Return the yaw moment (T,) of a tilted rotor over that of its torque alone."""
    turned = np.sin(p["tilt"]) * x.arm / x.torque_ratio
    return np.maximum(1.0 + turned, 1.0 - MOST_DRIVE) + 0.0 * x.time_s


#: `yaw_trim` of one arm: a rotor whose thrust the autopilot changes changes the moment too
TILTED_ARM = replace(
    YAW_TRIM,
    variant="tilted arm",
    kind=Kind.COEFFICIENT,
    parameters=(
        Parameter(
            name="tilt",
            unit="rad",
            lower=-0.15,
            upper=0.15,
            scale=0.03,
            smallest=0.0017,  # 0.1 degrees
            accuracy=GUESSED_TORQUE,
            of_torque=True,
        ),
    ),
    of_one_rotor=True,
    of_every_aircraft=False,
    source="an arm twisted about its own axis turns part of that rotor's thrust into a yaw moment, "
    "thrust x arm x sin(tilt); positive adds to the torque of the rotor",
    apply=_upright_share,
    torque=_tilted_torque,
)


def _yaw_moment(p, x: Channels, thrust):
    """Return the yaw moment of sideways drag."""
    right = x.own["weathervane"][:, 1]
    return 0.0 * thrust, 0.0 * thrust, -p["lever"] * right / x.hover_induced_velocity * thrust


WEATHERVANE = Effect(
    name="weathervane",
    kind=Kind.MOMENTS,
    parameters=(
        Parameter(
            name="lever",
            unit="m",
            lower=-0.2,
            upper=0.2,
            scale=0.02,
            smallest=0.002,  # a wind of half a m/s that nobody reports
            accuracy=GUESSED_TORQUE,
            of_torque=True,
        ),
    ),
    needs=("weathervane", "hover_induced_velocity"),
    neutral={"weathervane": 0.0},
    of_every_aircraft=True,
    source="drag that acts ahead of the centre of gravity or behind it: moment = lever x thrust x "
    "sideways speed / induced velocity of hover",
    with_tank=False,  # as the moment of flow
    own_channel=flow,
    apply=_yaw_moment,
)


EFFECTS = (
    CG_OFFSET,
    CG_OFFSET_TANK,
    DRAG_MOMENT,
    FLOW_MOMENT,
    MANOEUVRE_MOMENT,
    YAW_TRIM,
    TILTED_ARM,
    WEATHERVANE,
)
