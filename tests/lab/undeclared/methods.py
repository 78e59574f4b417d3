"""What other methods make of the same flights: an oracle, three sparse regressions, boosted trees.

All start from the same residual of the same model. The oracle is told which effects a set has and
what each would do; its error from flight to flight says what could be seen at all. The regressions
get one column for each textbook effect, by the airframe's geometry alone, on means of one second;
they name an effect that is half as strong again as on any four good flights of the aircraft. The
trees predict the residual from the channels, and are scored on flights that they have not seen.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence

import numpy as np
from pysindy import STLSQ  # pyright: ignore[reportMissingImports]
from sklearn.ensemble import (  # pyright: ignore[reportMissingImports]
    HistGradientBoostingRegressor,
)
from sklearn.linear_model import LassoCV  # pyright: ignore[reportMissingImports]

from tests.lab.undeclared.crafts import GRAVITY, Craft
from tests.lab.undeclared.rotor_aero import Array
from thrustmargin.models.flight import FlightTrack

BLOCK = 10  # rows of a mean
ABOVE_GOOD = 1.5  # an effect is named from so much of the most that good flights show of it
Name = tuple[str, int | None]  # effect and rotor from 1


def oracle_errors(signals: Sequence[Sequence[Array]], residuals: Sequence[Array]) -> Array:
    """(K, F) error of each effect's estimated size in each flight, as a share of its true size.

    NaN where the effect does nothing to that flight's rotor speeds.
    """
    errors = np.full((len(signals), len(residuals)), np.nan)
    for f, residual in enumerate(residuals):
        rows = np.isfinite(residual).all(axis=1)
        columns = np.stack([s[f][rows].ravel() for s in signals], axis=1)
        moved = np.sqrt(np.mean(columns**2, axis=0)) > 1e-6
        if rows.any() and moved.any():
            found = np.linalg.lstsq(columns[:, moved], residual[rows].ravel(), rcond=None)[0]
            errors[moved, f] = found - 1.0
    return errors


def density_slope(
    tracks: Sequence[FlightTrack], dense: Sequence[float], residuals: Sequence[Array]
) -> float:
    """How much of air density the model misses, 1 for all: from good flights whose air is known."""
    moved = [
        float(np.nanmean(-0.5 * t.rotor_speed_rpm * d)) for t, d in zip(tracks, dense, strict=True)
    ]
    left = [float(np.nanmean(r)) for r in residuals]
    return float(np.polyfit(moved, left, 1)[0])


def columns_of(craft: Craft, track: FlightTrack) -> dict[Name, Array]:
    """(T, R) rpm that a unit of each textbook effect adds, by geometry, weight and channels."""
    inverse = np.linalg.pinv(
        np.stack([np.ones(craft.rotors), -craft.position[:, 1], craft.position[:, 0], craft.spin])
    )  # spin in place of torque: a yaw column has no unit
    speed, tank = track.rotor_speed_rpm, np.nan_to_num(track.tank_kg)
    hover = float(np.nanmedian(speed))
    thrust = (craft.empty_mass + tank) * GRAVITY
    t = track.time_s
    air, up = np.nan_to_num(track.airspeed), -np.nan_to_num(track.velocity_ned[:, 2])
    p, q, r = np.nan_to_num(track.angular_rate_frd).T
    dp, dq, dr = (np.gradient(v, t) for v in (p, q, r))
    force = np.nan_to_num(track.specific_force_frd)
    load = np.linalg.norm(force, axis=1) / GRAVITY - 1.0
    sag = np.nan_to_num(track.voltage / np.nanmean(track.voltage) - 1.0)
    near = (craft.radius / np.maximum(np.nan_to_num(track.height_agl, nan=99.0), 0.3)) ** 2
    yaw = np.nan_to_num(track.attitude[:, 2])

    def wrench(mode: int, values: Array) -> Array:
        """A demand in a control mode, shared by the mixer, as rpm through N²."""
        share = values[:, None] * inverse[:, mode]
        return 0.5 * hover * craft.rotors * share / (craft.typical_mass * GRAVITY)

    arm = craft.arm
    columns: dict[Name, Array] = {
        ("extra_mass", None): wrench(0, 0.0 * t + GRAVITY * (1.0 + load)),
        ("tank_scale", None): wrench(0, GRAVITY * tank),
        ("air_density", None): wrench(0, thrust),
        ("thrust_drift", None): wrench(0, thrust * t),
        ("battery_voltage", None): wrench(0, thrust * sag),
        ("parasite_drag", None): wrench(0, air**4),
        ("translational_lift", None): wrench(0, thrust * air**2),
        ("climb_inflow", None): wrench(0, thrust * up),
        ("ground_effect", None): wrench(0, thrust * near),
        ("load_factor", None): wrench(0, thrust * load),
        ("wind", None): wrench(0, thrust * air * np.cos(yaw)),
        ("wind", 0): wrench(0, thrust * air * np.sin(yaw)),
        ("cg_offset", None): wrench(2, thrust * arm),
        ("cg_offset", 0): wrench(1, thrust * arm),
        ("cg_offset", -1): wrench(2, tank * arm),
        ("cg_offset", -2): wrench(1, tank * arm),
        ("yaw_trim", None): wrench(3, 0.0 * t + 1.0),
        ("manoeuvre_moment", None): wrench(1, dp),
        ("manoeuvre_moment", 0): wrench(2, dq),
        ("manoeuvre_moment", -1): wrench(3, dr),
        ("manoeuvre_moment", -2): wrench(3, r),
        ("flow_moment", None): wrench(2, force[:, 0]),
        ("flow_moment", 0): wrench(1, force[:, 1]),
        ("sensor_lag", None): np.gradient(np.nan_to_num(speed), t, axis=0),
    }
    effect = np.stack([np.ones(craft.rotors), -craft.position[:, 1], craft.position[:, 0],
                       craft.spin])  # fmt: skip
    for j in range(craft.rotors):
        lost = inverse @ effect[:, j]
        column = thrust[:, None] / craft.rotors * lost
        columns["rotor_degradation", j + 1] = 0.5 * hover * column / thrust.mean() * craft.rotors
    return columns


def blocks(values: Array) -> Array:
    """(T/10, ...) means of ten rows; NaN where one of them is."""
    whole = len(values) // BLOCK * BLOCK
    return values[:whole].reshape(-1, BLOCK, *values.shape[1:]).mean(axis=1)


class Sparse:
    """Ridge with the largest |t|, lasso and STLSQ, with limits from good flights of a craft."""

    METHODS: tuple[str, ...] = ("ridge", "lasso", "stlsq")

    def __init__(
        self, craft: Craft, good: Sequence[FlightTrack], residuals: Sequence[Array]
    ) -> None:
        self.craft = craft
        groups = [slice(first, first + 4) for first in range(0, len(good) - 3, 2)]
        found = [self.strengths(good[g], residuals[g]) for g in groups]
        self.limit = {
            (m, n): ABOVE_GOOD * max(f[m][n] for f in found) for m in found[0] for n in found[0][m]
        }

    def names(
        self, tracks: Sequence[FlightTrack], residuals: Sequence[Array]
    ) -> dict[str, list[Name]]:
        """What each method names; ridge names its strongest column only."""
        answer: dict[str, list[Name]] = {}
        for method, by_name in self.strengths(tracks, residuals).items():
            over = [n for n, s in by_name.items() if s > self.limit[method, n]]
            over.sort(key=lambda n: -by_name[n])
            answer[method] = over[:1] if method == "ridge" else over
        return answer

    def strengths(
        self, tracks: Sequence[FlightTrack], residuals: Sequence[Array]
    ) -> dict[str, dict[Name, float]]:
        """How strongly each method holds to each effect: |t|, or rpm of its column."""
        parts, wanted = [], []
        for track, residual in zip(tracks, residuals, strict=True):
            target = blocks(residual)
            rows = np.isfinite(target).all(axis=1)
            columns = columns_of(self.craft, track)
            parts.append(np.stack([blocks(c)[rows].ravel() for c in columns.values()], axis=1))
            wanted.append(target[rows].ravel())
        names = list(columns)
        x, y = np.concatenate(parts), np.concatenate(wanted)
        x = x / np.maximum(np.sqrt(np.mean(x**2, axis=0)), 1e-12)
        flights = np.repeat(np.arange(len(wanted)), [len(w) for w in wanted])
        gram = x.T @ x + 1e-3 * len(x) * np.eye(x.shape[1])
        ridge = np.linalg.solve(gram, x.T @ y)
        spread = np.sqrt(np.diag(np.linalg.inv(gram)) * np.mean((y - x @ ridge) ** 2))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            folds = [(np.flatnonzero(flights != f), np.flatnonzero(flights == f))
                     for f in np.unique(flights)]  # fmt: skip
            lasso = LassoCV(alphas=20, cv=folds, fit_intercept=False, max_iter=2000).fit(x, y).coef_
            optimizer = STLSQ(threshold=0.002 * float(np.median(np.abs(tracks[0].rotor_speed_rpm))))
            sparse = np.ravel(optimizer.fit(x, y[:, None]).coef_)
        values = {"ridge": ridge / spread, "lasso": lasso, "stlsq": sparse}
        answer: dict[str, dict[Name, float]] = {}
        for method, coefficients in values.items():
            strongest: dict[Name, float] = {}
            for (effect, rotor), c in zip(names, coefficients, strict=True):
                key = (effect, rotor if effect == "rotor_degradation" else None)
                strongest[key] = max(strongest.get(key, 0.0), abs(float(c)))
            answer[method] = strongest
        return answer


def tree_errors(
    fit: Sequence[FlightTrack],
    held_out: Sequence[FlightTrack],
    residuals: Mapping[str, Sequence[Array]],
) -> float:
    """RMS in rpm on the flights held out, after boosted trees on channels of the flights to fit."""
    x, y = _table(fit, residuals["fit"])
    new, truth = _table(held_out, residuals["held_out"])
    left = []
    for rotor in range(y.shape[1]):
        trees = HistGradientBoostingRegressor(max_iter=150, learning_rate=0.08, min_samples_leaf=40)
        left.append(truth[:, rotor] - trees.fit(x[::3], y[::3, rotor]).predict(new))
    return float(np.sqrt(np.mean(np.square(left))))


def _table(tracks: Sequence[FlightTrack], residuals: Sequence[Array]) -> tuple[Array, Array]:
    inputs, wanted = [], []
    for track, residual in zip(tracks, residuals, strict=True):
        rows = np.isfinite(residual).all(axis=1)
        rates = np.gradient(track.angular_rate_frd, track.time_s, axis=0)
        body = [track.airspeed, track.tank_kg, track.voltage, track.height_agl, track.time_s]
        table = np.column_stack(
            [*body, track.velocity_ned, track.attitude, track.angular_rate_frd, rates,
             track.specific_force_frd]
        )  # fmt: skip
        inputs.append(table[rows])
        wanted.append(residual[rows])
    return np.concatenate(inputs), np.concatenate(wanted)
