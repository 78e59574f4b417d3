"""One identification against the sealed truth: right, twin, missed, wrong, covered, how far off.

A reported effect counts for a missing one when it has its name (and its rotor, where there is one),
or when it lists that name among those that the data cannot tell from it. A list of more than
`TWINS_AT_MOST` names is no answer. Each reported effect counts for one missing effect only.
A reported name that is true of nothing in the flights is wrong, unless it is natural to them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from tests.undeclared.datasets import DataSet
from tests.undeclared.recorded import RecordedSet
from tests.undeclared.truth import Missing

TWINS_AT_MOST = 3

#: (effect, parameter of the truth) -> its name in a report, in the same sign and unit. A truth
#: that is not here has no counterpart there: the gain of translational lift belongs to one form of
#: its law, and the plant's form is another.
REPORTED_AS: Mapping[tuple[str, str], str] = MappingProxyType(
    {
        ("air_density", "warmer_than_standard"): "temperature_offset",
        ("wind", "north"): "wind_north",
        ("wind", "east"): "wind_east",
        ("tank_scale", "gain"): "gain",
        ("extra_mass", "mass"): "mass",
        ("parasite_drag", "drag_area"): "drag_area",
        ("load_factor", "gain"): "gain",
        ("climb_inflow", "slope"): "slope",
        ("ground_effect", "strength"): "strength",
        ("rotor_degradation", "loss"): "loss",
        ("rotor_degradation", "onset"): "onset_time",
        ("thrust_drift", "rate"): "rate",
        ("battery_voltage", "exponent"): "exponent",
        ("cg_offset", "x"): "x",
        ("cg_offset", "y"): "y",
        ("cg_offset", "x_tank"): "x_full",
        ("cg_offset", "y_tank"): "y_full",
        ("yaw_trim", "moment"): "moment",
        ("manoeuvre_moment", "inertia_x"): "inertia_roll",
        ("manoeuvre_moment", "inertia_y"): "inertia_pitch",
        ("manoeuvre_moment", "inertia_z"): "inertia_yaw",
        ("sensor_lag", "delay"): "lag",
    }
)

Sealed = DataSet | RecordedSet
Verdict = Literal["exact", "twin", "missed"]


@dataclass(frozen=True, kw_only=True)
class Interval:
    """A parameter reported with its interval, beside the true value."""

    effect: str
    parameter: str
    truth: float
    value: float
    low: float
    high: float

    @property
    def covers(self) -> bool:
        return self.low <= self.truth <= self.high


@dataclass(frozen=True, kw_only=True)
class Score:
    """Everything that is counted of one data set."""

    kind: str
    seed: int
    base: str
    layout: str
    asked: tuple[tuple[str, str, float], ...]  # name, variant, signal in rpm
    verdicts: tuple[Verdict, ...]  # one for each asked effect
    reported: tuple[str, ...]
    wrong: tuple[str, ...]  # reported names that are true of nothing in the flights
    twins_listed: int
    says_unexplained: bool
    intervals: tuple[Interval, ...]
    unmapped: tuple[str, ...]  # parameters of found effects that the report does not state
    outside_rpm: float
    before_rmse_rpm: float
    after_rmse_rpm: float
    knowing_rmse_rpm: float
    floor_rpm: float  # as reported
    true_floor_rpm: float
    seconds: float

    @property
    def right(self) -> bool:
        """The whole answer is right: all that is asked for is found and no name is wrong.

        With an effect outside the table: it is reported as unexplained and no name is wrong.
        """
        if self.outside_rpm:
            return self.says_unexplained and not self.wrong
        return "missed" not in self.verdicts and not self.wrong

    @property
    def ratio(self) -> float:
        """Error on flights held out over that of a model that knows the truth."""
        return self.after_rmse_rpm / self.knowing_rmse_rpm

    def to_json(self) -> dict[str, Any]:
        """Plain numbers, null for those that are unknown."""
        figures = {**asdict(self), "right": self.right, "ratio": self.ratio}
        unknown = {k for k, v in figures.items() if isinstance(v, float) and not np.isfinite(v)}
        return {k: None if k in unknown else v for k, v in figures.items()}


def is_empirical(effect: Mapping[str, Any]) -> bool:
    return str(effect["name"]).startswith("unexplained")


def same(effect: Mapping[str, Any], missing: Missing) -> bool:
    rotor = effect.get("rotor")
    return effect["name"] == missing.name and (missing.rotor is None or rotor == missing.rotor + 1)


def lists(effect: Mapping[str, Any], missing: Missing) -> bool:
    twins = effect.get("indistinguishable_from", [])
    return len(twins) <= TWINS_AT_MOST and missing.name in twins


def match(
    effects: Sequence[Mapping[str, Any]], asked: Sequence[Missing]
) -> tuple[list[tuple[Verdict, Mapping[str, Any] | None]], list[Mapping[str, Any]]]:
    """The verdict and the effect for each asked one, and the reported effects left over."""
    left = [e for e in effects if not is_empirical(e)]
    answer: list[tuple[Verdict, Mapping[str, Any] | None]] = [("missed", None)] * len(asked)
    tests: tuple[tuple[Verdict, Any], ...] = (("exact", same), ("twin", lists))
    for verdict, test in tests:
        for i, missing in enumerate(asked):
            if answer[i][0] != "missed":
                continue
            hit = next((e for e in left if test(e, missing)), None)
            if hit is not None:
                left.remove(hit)
                answer[i] = (verdict, hit)
    return answer, left


def intervals_of(effect: Mapping[str, Any], missing: Missing) -> tuple[list[Interval], list[str]]:
    """The stated parameters beside their true values, and the true ones that are not stated."""
    stated, found, absent = effect["parameters"], [], []
    for parameter, truth in missing.truth.items():
        name = REPORTED_AS.get((missing.name, parameter))
        if name is None:
            continue
        if name not in stated:
            absent.append(f"{missing.name}.{parameter}")
            continue
        low, high = stated[name]["ci95"]
        found.append(
            Interval(
                effect=missing.name,
                parameter=parameter,
                truth=truth,
                value=float(stated[name]["value"]),
                low=float(low),
                high=float(high),
            )
        )
    return found, absent


def judge(
    data: DataSet | RecordedSet, result: Mapping[str, Any], seconds: float = float("nan")
) -> Score:
    """Score an identification, a dict with the schema `thrustmargin.identify/1`."""
    effects = list(result["effects"])
    verdicts, left = match(effects, data.asked)
    allowed = {m.name for m in data.missing if not m.asked}
    intervals: list[Interval] = []
    unmapped: list[str] = []
    for (verdict, effect), missing in zip(verdicts, data.asked, strict=True):
        if verdict == "exact" and effect is not None:
            stated, absent = intervals_of(effect, missing)
            intervals += stated
            unmapped += absent
    unexplained = result.get("unexplained") or {}
    return Score(
        kind=data.kind,
        seed=data.seed,
        base=data.base,
        layout=data.layout.name,
        asked=tuple((m.name, m.variant, m.signal_rpm) for m in data.asked),
        verdicts=tuple(v for v, _ in verdicts),
        reported=tuple(shown(e) for e in effects),
        wrong=tuple(shown(e) for e in left if e["name"] not in allowed),
        twins_listed=sum(len(e.get("indistinguishable_from", [])) for e in effects),
        says_unexplained=unexplained.get("mode") is not None or any(map(is_empirical, effects)),
        intervals=tuple(intervals),
        unmapped=tuple(unmapped),
        outside_rpm=data.outside_rpm,
        before_rmse_rpm=number(result, "before"),
        after_rmse_rpm=number(result, "after"),
        knowing_rmse_rpm=data.knowing_rmse_rpm,
        floor_rpm=float(result.get("floor_rpm") or np.nan),
        true_floor_rpm=data.floor_rpm,
        seconds=seconds,
    )


def shown(effect: Mapping[str, Any]) -> str:
    rotor = effect.get("rotor")
    return str(effect["name"]) + (f" {rotor}" if rotor is not None else "")


def number(result: Mapping[str, Any], when: str) -> float:
    value = result[when]["rmse_rpm"]
    return float("nan") if value is None else float(value)
