"""Combine effects: from inputs to the speed of every rotor.

    N_i = sqrt(A_i / a0),  A = (D T'/T + P L) / kappa + S c

D is the base model's apparent thrust of each rotor at the (corrected) airspeed and tank mass, T the
thrust that it makes, T' the demand with its effects, L the moments with P the mixer's inverse, and
kappa the product of the effects on all rotors. If a single rotor makes less thrust, or torque is
not proportional to thrust, the autopilot adds controls c, which its mixer S shares over all rotors,
until force and moments are those that the flight requires. With four rotors each rotor then keeps
its thrust; with more rotors the mixer cannot compensate on one rotor alone, and the opposite one
changes too. In rows without one of its channels an effect has no influence, by its neutral values.

Store identified effects in a model file, and turn them into `Placed` effects.

Rotors are numbered from 1 in files, from 0 in arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from thrustmargin.models.effects import BY_KEY
from thrustmargin.models.effects.base import KAPPA_FLOOR, Array, Effect, Kind, Placed, Values
from thrustmargin.models.effects.channels import Channels
from thrustmargin.models.errors import ModelError
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.margin import mixer

MOST_AIRSPEED, AIRSPEED_STEP = 20.0, 0.1  # m/s of the table of a base model
THRUST_FLOOR = 1e-3  # N: a rotor never pulls down


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BaseTable:
    """The base model's apparent thrust on a grid of airspeed and tank mass, interpolated
    bilinearly.

    `thrust` is (I, J, R) N at `airspeed_step * i` m/s and `tank_step_kg * j` kg. There are C
    independent controls (four, or R with fewer rotors); a unit control demands `shares` of the
    rotors.
    """

    thrust: Any
    airspeed_step: float
    tank_step_kg: float
    thrust_coefficient: float
    effectiveness: Any  # (R,) thrust over apparent thrust
    moment_shares: Any  # (R, 3) N per N m of roll, pitch, yaw: the inverse of the mixer
    carried: Any  # (R, R) apparent thrust by which the rotors carry 1 N at the place of each
    shares: Any  # (R, C) the mixer: apparent thrust of each rotor, N, by control
    thrust_control: Any  # (C, R) control that compensates each rotor's thrust, by apparent thrust
    yaw_control: Any  # (C,) control that compensates a yaw moment
    yaw_rows: Any  # (R,) yaw moment of each rotor's torque, by apparent thrust

    def look_up(self, airspeed: Array, tank_kg: Array) -> Array:
        """Interpolate the apparent thrust (T, R), N, linearly at `airspeed` (T,), m/s, and
        `tank_kg` (T,).

        Constant beyond the grid; a NaN input counts as 0.
        """
        i, u = _cell(airspeed / self.airspeed_step, self.thrust.shape[0])
        j, v = _cell(tank_kg / self.tank_step_kg, self.thrust.shape[1])
        u, v, wide = u[:, None], v[:, None], self.thrust.shape[1]
        grid, at = self.thrust.reshape(-1, self.thrust.shape[2]), i * wide + j
        low = grid.take(at, 0) * (1 - v) + grid.take(at + 1, 0) * v
        high = grid.take(at + wide, 0) * (1 - v) + grid.take(at + wide + 1, 0) * v
        return low * (1 - u) + high * u


def _cell(x: Array, size: int) -> tuple[Array, Array]:
    """Return the index of the grid cell that contains x and the place in it, from 0 to 1;
    clipped to the grid."""
    x = np.minimum(np.fmax(x, 0.0), size - 1.0)
    index = np.minimum(x.astype(np.intp), size - 2)
    return index, x - index


def base_table(
    speed: Callable[[Floats, Floats], Floats],
    airframe: Airframe,
    *,
    thrust_coefficient: float,
) -> BaseTable:
    """Tabulate the base model on a grid of airspeed and tank mass, and its mixer's responses.

    `speed` is the base model: (airspeed (N,) in m/s, tank_kg (N,)) -> rotor speeds (N, R) in rpm.
    `thrust_coefficient`, N/rpm², converts them to thrust.
    """
    # An aircraft without a tank carries a payload.
    most_kg = airframe.tank_capacity_kg or float(np.nan_to_num(airframe.empty_mass)) or 1.0
    tank_step_kg = most_kg / 80.0
    speeds = np.arange(0.0, MOST_AIRSPEED + AIRSPEED_STEP, AIRSPEED_STEP)
    masses = np.arange(0.0, 1.5 * most_kg + tank_step_kg, tank_step_kg)
    airspeed, tank_kg = (g.ravel() for g in np.meshgrid(speeds, masses, indexing="ij"))
    thrust = thrust_coefficient * speed(airspeed, tank_kg) ** 2
    rows = mixer(airframe) * airframe.rotor_effectiveness
    # The autopilot's mixer knows place and spin of each rotor, not its effectiveness.
    _, size, columns = np.linalg.svd(mixer(airframe), full_matrices=False)
    shares = columns[size > 1e-9 * size.max(initial=0.0)].T
    control = np.linalg.pinv(rows @ shares)
    return BaseTable(
        thrust=thrust.reshape(speeds.size, masses.size, airframe.rotor_count),
        airspeed_step=AIRSPEED_STEP,
        tank_step_kg=tank_step_kg,
        thrust_coefficient=thrust_coefficient,
        effectiveness=airframe.rotor_effectiveness,
        moment_shares=(shares @ control)[:, 1:],
        carried=shares @ control[:, :3] @ mixer(airframe)[:3],
        shares=shares,
        thrust_control=control[:, :3] @ rows[:3],
        yaw_control=control[:, 3],
        yaw_rows=rows[3],
    )


def coefficient(placed: Sequence[Placed], x: Channels, rotors: int) -> Array:
    """Return kappa, (T, R) or (T, 1): the product of the coefficient effects, at least
    KAPPA_FLOOR."""
    every = [item for item in placed if item.effect.kind is Kind.COEFFICIENT]
    kappa = _product(every, x, rotors, lambda item: item.effect.apply)
    return np.maximum(kappa, KAPPA_FLOOR)


def _product(
    placed: Sequence[Placed], x: Channels, rotors: int, factor: Callable[[Placed], Any]
) -> Array:
    """Multiply the factors of effects, each on the rotors that it acts on.

    `factor(item)` returns the function of effect `item` that computes its factor (T,) from its
    values and the channels. Return (T, `rotors`), or (T, 1) if every effect acts on all rotors.
    """
    product = np.ones_like(x.time_s)[:, None]
    for item in placed:
        value = factor(item)(item.values, x)[:, None]
        if item.rotor is not None:
            value = 1.0 + (value - 1.0) * (np.arange(rotors) == item.rotor)
        product = product * value
    return product


def apparent_thrust(base: BaseTable, placed: Sequence[Placed], x: Channels) -> Array:
    """Return the apparent thrust (T, R), N, of every rotor with the effects `placed`.

    Apparent thrust is a0 N² with the base model's thrust coefficient a0: it is how rotor speed N is
    represented, not the real thrust. Never below THRUST_FLOOR.
    """
    x = correct_inputs(placed, x)
    thrust = base.look_up(x.airspeed, x.tank_kg)
    demand = total = thrust @ base.effectiveness
    for item in placed:
        if item.effect.kind is Kind.DEMAND and item.rotor is None:
            demand = item.effect.apply(item.values, x, demand)
    if demand is not total:
        demand = np.maximum(demand, THRUST_FLOOR)  # negative if a fall at more than g is reported
        thrust = thrust * (demand / total)[:, None]
    for item in placed:
        if item.effect.kind is Kind.DEMAND and item.rotor is not None:
            more = item.effect.apply(item.values, x, demand) - demand
            thrust = thrust + more[:, None] * base.carried[:, item.rotor]
            demand = demand + more
    for item in placed:
        if item.effect.kind is Kind.MOMENTS:
            moments = item.effect.apply(item.values, x, demand)
            thrust = thrust + np.stack(moments, 1) @ base.moment_shares.T
    every = coefficient([i for i in placed if i.rotor is None], x, thrust.shape[1])
    apart = [item for item in placed if item.effect.torque is not None]
    if apart:
        thrust = _rebalance(base, apart, x, thrust)
    return np.maximum(thrust / every, THRUST_FLOOR)


def correct_inputs(placed: Sequence[Placed], x: Channels) -> Channels:
    """Return the channels with airspeed, tank mass and total mass corrected by the input effects.

    All later effects use the corrected values, such as lift and drag in a wind that no channel
    reports.
    """
    airspeed, tank_kg = x.airspeed, x.tank_kg
    follow = sum(item.effect.temperature_offset is not None for item in placed)
    late = sum(item.values["lag"] for item in placed if item.effect.delays)
    x = x.with_changed(delay=late, density_effects=float(max(follow, 1)))
    for item in placed:
        if item.effect.kind is Kind.INPUT:
            airspeed, tank_kg = item.effect.apply(item.values, x, airspeed, tank_kg)
    if airspeed is x.airspeed and tank_kg is x.tank_kg:
        return x
    mass = x.total_mass + (tank_kg - x.tank_kg)
    return x.with_changed(airspeed=airspeed, tank_kg=tank_kg, total_mass=mass)


def _rebalance(base: BaseTable, apart: Sequence[Placed], x: Channels, thrust: Array) -> Array:
    """Return the apparent thrust (T, R) that restores the force and moments of `thrust`.

    Needed if single rotors make less thrust, or torque is not proportional to it. A loss that all
    rotors share is not compensated here.

    Controls c must compensate the loss of each of K causes: I + U V_t of them arrives, U (C, K) the
    controls that a cause reduces, V_t (K, C) its response to c, and U g_t is lacking. So c = -U (I
    + V_t U)^-1 g_t (Woodbury); the causes are the bad rotors and torque.
    """
    rotors = thrust.shape[1]
    bad = sorted({item.rotor for item in apart if item.rotor is not None})
    alone = coefficient([item for item in apart if item.rotor is not None], x, rotors)
    shared = coefficient([item for item in apart if item.rotor is None], x, rotors)
    torque = _product(apart, x, rotors, lambda item: item.effect.torque)
    twist = (torque / shared - 1.0) * base.yaw_rows
    causes = np.concatenate([base.thrust_control[:, bad], base.yaw_control[:, None]], axis=1)
    answer = base.shares @ causes  # (R, K)
    lost = alone[:, bad] - 1.0 if bad else np.empty((thrust.shape[0], 0))
    both = np.concatenate([lost[:, :, None] * answer[bad], (twist @ answer)[:, None]], axis=1)
    taken = np.concatenate([lost * thrust[:, bad], np.sum(twist * thrust, 1)[:, None]], axis=1)
    return thrust - _solve(np.eye(len(bad) + 1) + both, taken) @ answer.T


def _solve(systems: Array, right: Array) -> Array:
    """Solve systems (T, C, C) near the identity for right sides (T, C), by elimination over all
    rows.

    No pivoting, in a quarter of the time of calling LAPACK for each row.
    """
    both = np.concatenate([systems, right[:, :, None]], axis=2).transpose(1, 2, 0).copy()
    for k in range(both.shape[0]):
        row = both[k] / both[k, k]
        both -= both[:, k, None] * row
        both[k] = row
    return both[:, -1].T


def rotor_speed_rpm(base: BaseTable, placed: Sequence[Placed], x: Channels) -> Array:
    """Return the speed (T, R) rpm of every rotor with the effects."""
    return np.sqrt(apparent_thrust(base, placed, x) / base.thrust_coefficient)


def with_neutral_gaps(item: Placed) -> Placed:
    """Return the effect in a form that has no influence in rows that lack one of its channels.

    Missing values (NaN) are replaced by the effect's neutral ones, in numpy channels only. An
    effect without neutral values is returned unchanged.
    """
    effect = item.effect
    if not effect.neutral:
        return item

    def apply(p, x, *given):
        """Apply the effect with gaps filled."""
        return effect.apply(p, fill_neutral(effect, p, x), *given)

    def torque(p, x):
        """Return the torque factor with gaps filled."""
        assert effect.torque is not None
        return effect.torque(p, fill_neutral(effect, p, x))

    whole = replace(effect, apply=apply, torque=torque if effect.torque else None)
    return replace(item, effect=whole)


def fill_neutral(effect: Effect, p: Values, x: Channels) -> Channels:
    """Return the channels with the effect's neutral values in place of NaN.

    `p` are the effect's values by name. A row that lacks one of the effect's (T,) channels gets the
    neutral values of all of them; in a shift table (T, lags) only the missing entries are filled.
    """
    gap = np.zeros(x.time_s.shape, dtype=np.bool_)
    for name in effect.neutral:
        value = x.read(name)
        if isinstance(value, np.ndarray) and value.ndim == 1:
            gap |= ~np.isfinite(value)
    changed: dict[str, Any] = {}
    for name, neutral in effect.neutral.items():
        nothing = neutral(p, x) if callable(neutral) else neutral
        value = x.read(name)
        if isinstance(value, tuple):
            changed[name] = tuple(np.where(np.isfinite(v), v, nothing) for v in value)
        else:
            bad = gap if value.ndim == 1 else ~np.isfinite(value)
            changed[name] = np.where(bad, nothing, value)
    own = {name: changed.pop(name, value) for name, value in x.own.items()}
    return x.with_changed(own=own, **changed)


def outside_identified(placed: Sequence[Placed], x: Channels) -> Bools:
    """Flag the rows (T,) outside the range in which an effect was identified."""
    out = np.zeros(x.time_s.shape, dtype=np.bool_)
    for item in placed:
        if item.effect.seen is not None:
            out |= ~item.effect.seen(item.values, x)
    return out


#: Part of parameter names in older model files, and its present form.
FORMER_NAME = ("sharpening", "derivative_correction")


@dataclass(frozen=True, slots=True, kw_only=True)
class Identified:
    """The value of one parameter of an effect, with its 95 % interval."""

    value: float
    unit: str
    ci95: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectRecord:
    """An identified effect as model files and `identify` write it; rotors count from 1."""

    name: str
    rotor: int | None
    parameters: dict[str, Identified]
    variant: str = ""  # form of the effect, if it has several
    flights: tuple[str, ...] = ()  # flights on which it was found
    date: str = ""  # ISO 8601, of the identification

    def __post_init__(self) -> None:
        named = {name.replace(*FORMER_NAME): found for name, found in self.parameters.items()}
        object.__setattr__(self, "parameters", named)

    @property
    def loss(self) -> Identified | None:
        """Return the share of thrust that one rotor loses, negative for a gain; of a loss curve,
        its largest knot.

        None for an effect that is not of one rotor, or has no loss.
        """
        of_curve = [v for name, v in self.parameters.items() if name.startswith("at_")]
        losses = [self.parameters["loss"]] if "loss" in self.parameters else of_curve
        largest = max(losses, key=lambda v: v.value, default=None)
        return None if self.rotor is None else largest


def losses_of(records: Sequence[EffectRecord]) -> dict[int, Identified]:
    """Sum the share of thrust lost by each weak rotor, from 1, over all records.

    The ends of the 95 % intervals are summed as well.
    """
    losses: dict[int, Identified] = {}
    for record in records:
        if record.loss is not None and record.rotor is not None:
            one, other = record.loss, losses.get(record.rotor)
            if other is not None:
                ends = one.ci95[0] + other.ci95[0], one.ci95[1] + other.ci95[1]
                one = Identified(value=one.value + other.value, unit=one.unit, ci95=ends)
            losses[record.rotor] = one
    return losses


def placed_from(records: Sequence[EffectRecord], rotor_count: int) -> tuple[Placed, ...]:
    """Return the effects of a model file. Raises ModelError for an unknown effect, rotor, value
    or unit."""
    return tuple(_place_effect(record, rotor_count) for record in records)


def _place_effect(record: EffectRecord, rotor_count: int) -> Placed:
    """Return the effect of one record with its values, rotor from 0 (None if not of one).

    A detail that an older file lacks has no influence. Raise ModelError for an unknown effect, a
    rotor that the effect or the aircraft does not have, and a parameter that is missing, not finite
    or in another unit.
    """
    key = f"{record.name}:{record.variant}" if record.variant else record.name
    effect = BY_KEY.get(key)
    if effect is None:
        raise ModelError(
            f"it has the effect {key!r}, which this version does not know; "
            "update thrustmargin or identify the effect again"
        )
    if effect.of_one_rotor != (record.rotor is not None):
        raise ModelError(f"its effect {key} names rotor {record.rotor!r}")
    if record.rotor is not None and not 1 <= record.rotor <= rotor_count:
        raise ModelError(f"its effect {key} names rotor {record.rotor} of {rotor_count}")
    values: dict[str, float] = {}
    for parameter in effect.parameters:
        given = record.parameters.get(parameter.name)
        if given is None and parameter.detail and parameter.absent is not None:
            values[parameter.name] = parameter.absent  # older files lack this parameter
            continue
        if given is None or given.unit != parameter.unit or not np.isfinite(given.value):
            raise ModelError(f"its effect {key} needs {parameter.name} in {parameter.unit!r}")
        values[parameter.name] = given.value
    rotor = None if record.rotor is None else record.rotor - 1
    return Placed(effect=effect, values=values, rotor=rotor)
