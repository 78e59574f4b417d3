"""Moments that turning takes: inertia and damping. FRD axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

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
    RATE_SPAN,
    Channels,
    derivative_look,
    lag_weights,
    shifts_look,
)
from thrustmargin.models.effects.spin_up import slowed_yaw_rate, spun_up

SAMPLED = 0.04  # what the derivative of a rate that is sampled and noisy is good for
MOST_DAMPING = 300.0  # a rate loop answers gusts: where speeds are commands, against the rate
AXES = ("roll", "pitch", "yaw")
MOST = 60.0  # kg m²
#: of MOST: the inertia about yaw of an aircraft whose whole mass sits at its rotors
AT_THE_ROTORS = USUAL_MASS * USUAL_ARM**2 / MOST


def _turned(p, x: Channels, thrust):
    lag, loaded = p["lag"] - x.delay, (thrust / x.empty_weight) ** p["load_exponent"]
    weights = lag_weights(lag)
    tilt, yaw = (lag_weights(lag, p[f"derivative_correction_{of}"]) for of in ("tilt", "yaw"))
    axes = zip(AXES, x.rate_shifts, x.acceleration_shifts, (tilt, tilt, yaw), strict=True)
    roll, pitch, at_once = (
        acceleration @ (p[f"inertia_{axis}"] * sharpened) * loaded
        + rate @ (p[f"damping_{axis}"] * weights)
        for axis, rate, acceleration, sharpened in axes
    )
    about_yaw = spun_up(
        x,
        x.own["manoeuvre_moment"],
        at_once,
        inertia=p["inertia_yaw"] * loaded,
        damping=p["damping_yaw"],
        lag=lag,
        constant=p["spin_up"],
    )
    return roll, pitch, about_yaw


def _turning(name: str, unit: str, most: float) -> Parameter:
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


def _changed(effect: Effect, has: Sequence[Values], scatter: Mapping[str, float]) -> Effect | None:
    """All moments of turning by one share more or less, as mass on arms and booms makes them.

    Not each axis by itself: roll and pitch of an aircraft on its route hardly show, and with values
    of their own would take what late rotor speeds do. An inertia is not below none.
    """
    moments = [p.name for p in effect.parameters if not p.detail]
    whole = {name: sum(values[name] for values in has) for name in moments}
    # What is known of yaw stands for all: an arm turns by thrust, yaw by a few per cent of it, so
    # that rotor speeds show yaw many times as well.
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

    def kept(p: Values) -> Values:
        return {**has[0], **{name: p["share"] * whole[name] for name in moments}}

    return replace(
        effect,
        variant="changed",
        parameters=(share,),
        apply=lambda p, x, thrust: effect.apply(kept(p), x, thrust),
        looks=lambda p: effect.looks(has[0]),
        change=None,
        kept_as=kept,
    )


MANOEUVRE_MOMENT = Effect(
    name="manoeuvre_moment",
    kind=Kind.MOMENTS,
    parameters=(
        *(_turning(f"inertia_{axis}", "kg m^2", MOST) for axis in AXES),
        *(_turning(f"damping_{axis}", "N m s", MOST_DAMPING) for axis in AXES),
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
    apply=_turned,
    change=_changed,
    looks=lambda p: shifts_look(p["lag"], derivative_look(RATE_SPAN)),
)

EFFECTS = (MANOEUVRE_MOMENT,)
