"""One answer against the sealed truth: named, listed or missed; wrong names; intervals; the rest.

The answer is the JSON of `thrustmargin.identify/1`. A change is *named* when an effect has its name
(and rotor), *listed* when it stands among the alternatives of 5 % or more, the effects of which one
is there, or the rotors mentioned. A name that belongs to no change of the set is wrong; names of
what every flight has (`NATURAL`) are counted apart.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from tests.lab.undeclared.conditions import Implant
from tests.lab.undeclared.plan import DataSet

LISTED_FROM = 0.05
#: Effects that every flight has: a model of few good flights may lack a little of them.
NATURAL = frozenset(
    ("load_factor", "manoeuvre_moment", "flow_moment", "drag_moment", "translational_lift",
     "climb_inflow", "parasite_drag", "ground_effect")
)  # fmt: skip
#: Names that say the instrument, as parts of them; what else is named on such a set is wrong.
RIGHT_INSTRUMENT: Mapping[str, tuple[str, ...]] = {
    "late ESC": ("lag", "late"),
    "1 Hz speeds": ("lag", "repeat", "slow", "held", "hold"),
    "rounded speeds": ("quant", "round"),
    "repeated speeds": ("lag", "repeat", "held", "hold"),
    "warm thermometer": ("thermometer", "temperature", "air_density"),
    "gauge drift": ("gauge", "tank"),
    "airspeed bias": ("airspeed",),
    "voltage offset": ("voltage",),
}
#: Names that are as true of a change as its own.
ALSO_TRUE: Mapping[str, tuple[str, ...]] = {
    "hung weight": ("extra_mass", "cg_offset"),
    "tilted arm": ("yaw_trim",),
}
#: Where a change outside the table shows: modes and, as parts of its name, channels; () for any.
SHOWS: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "wake": (("pitch", "collective"), ("airspeed", "velocity", "speed", "flow")),
    "flex": ((), ("tank", "load", "mass", "thrust", "time", "voltage")),
    "slosh": (("pitch",), ()),
    "jet": (("roll",), ("spray",)),
    "shed": (("collective",), ("time",)),
    "band": ((), ("tank", "load", "mass", "thrust", "time", "voltage", "speed")),
    "thermal": (("collective",), ("position", "north", "east", "climb", "heading")),
    "flap": (("pitch",), ("airspeed", "velocity", "speed")),
    "worn": ((), ("airspeed", "velocity", "speed")),
    "sail": (("roll",), ("velocity", "side", "airspeed")),
    "recoil": (("roll", "pitch"), ("spray",)),
    "swing": (("roll", "pitch"), ("acceleration",)),
}

Verdict = Literal["named", "listed", "missed"]
#: Of the first sentence: true of this set, wrong, or that nothing is missing or nothing fits.
First = Literal["right", "wrong", "nothing", "unexplained"]
Name = tuple[str, int | None]
UNEVEN = ("flex", "band", "worn")  # of the rotor of the condition


@dataclass(frozen=True, kw_only=True)
class Interval:
    """A parameter of a named change with its interval, beside the true value."""

    parameter: str
    truth: float
    low: float
    high: float

    @property
    def covers(self) -> bool:
        return self.low <= self.truth <= self.high


@dataclass(frozen=True, kw_only=True)
class Score:
    """Everything that is counted of one data set."""

    seed: int
    kind: str
    group: str
    craft: str
    flights: int
    implants: tuple[tuple[str, str, int | None, float], ...]  # kind, name, rotor from 1, size
    verdicts: tuple[Verdict, ...]
    probabilities: tuple[float, ...]  # that the answer gives each change, 0 when missed
    reported: tuple[str, ...]
    wrong: tuple[str, ...]
    natural: tuple[str, ...]  # wrong, but of what every flight has
    asked: tuple[str, ...]  # the parts that the answer asks people to look at or to set
    sound_rotors_asked: tuple[int, ...]  # of these the rotors, from 1, that nothing is wrong with
    first: First
    right_rotor: bool  # an outside change of one rotor named as that rotor's loss
    unexplained_mode: str | None
    unexplained_channel: str | None
    intervals: tuple[Interval, ...]
    falsely_excluded: int
    excluded: int
    before_rmse_rpm: float
    after_rmse_rpm: float
    floor_rpm: float
    knowing_rmse_rpm: float
    trees_rmse_rpm: float
    oracle: tuple[tuple[float, ...], ...]  # error of each estimate by flight, in the size's unit
    told: tuple[float, ...]  # size of each change over its error, of who is told the names
    others: Mapping[str, tuple[tuple[Verdict, ...], int]]  # method -> verdicts, wrong names
    seconds: float
    failed: str = ""  # what was raised in place of an answer

    @property
    def unexplained_right(self) -> bool:
        """Mode and channel of the unexplained are where this change shows."""
        modes, channels = SHOWS[self.kind]
        mode, channel = self.unexplained_mode or "", self.unexplained_channel or ""
        return (
            bool(mode)
            and (not modes or mode in modes)
            and (not channels or any(c in channel for c in channels))
        )

    def to_json(self) -> dict[str, Any]:
        figures = asdict(self)
        return {
            k: None if isinstance(v, float) and not np.isfinite(v) else v
            for k, v in figures.items()
        }


def is_it(name: Name, implant: Implant) -> bool:
    effect, rotor = name
    if implant.rotor is not None and rotor != implant.rotor + 1:
        return False
    return bool(implant.name) and effect == implant.name


def listed(result: Mapping[str, Any]) -> list[tuple[Name, float]]:
    """Names beside the accepted ones, each with its probability."""
    names: list[tuple[Name, float]] = []
    for other in result.get("alternatives") or []:
        share = float(other.get("probability") or 0.0)
        names += [(_named(e), share) for e in other.get("effects") or []]
    for group in result.get("one_of") or []:
        effects, shares = group.get("effects") or [], group.get("probabilities") or []
        names += [(_named(e), float(s)) for e, s in zip(effects, shares, strict=False)]
    for one in result.get("mentioned") or []:
        names.append((("rotor_degradation", one.get("rotor")), float(one.get("probability") or 0)))
    total: dict[Name, float] = {}
    for name, share in names:
        total[name] = total.get(name, 0.0) + share
    return list(total.items())


def _named(effect: Mapping[str, Any]) -> Name:
    return str(effect["name"]), effect.get("rotor")


def verdicts_on(
    implants: Sequence[Implant], names: Sequence[Name]
) -> tuple[tuple[Verdict, ...], list[Name]]:
    """Named or missed for each implant, and the names left over; each name answers for one."""
    left, verdicts = list(names), []
    for implant in implants:
        hit = next((n for n in left if is_it(n, implant)), None)
        if hit is not None:
            left.remove(hit)
        verdicts.append("missed" if hit is None else "named")
    return tuple(verdicts), left


def judge(
    data: DataSet,
    result: Mapping[str, Any],
    *,
    oracle: Sequence[Sequence[float]] = (),
    told: Sequence[float] = (),
    others: Mapping[str, Sequence[Name]] | None = None,
    knowing_rmse_rpm: float = float("nan"),
    trees_rmse_rpm: float = float("nan"),
    seconds: float = float("nan"),
    failed: str = "",
) -> Score:
    """Score an answer, a dict with the schema `thrustmargin.identify/1`."""
    effects = [e for e in result["effects"] if not str(e["name"]).startswith("unexplained")]
    names: list[Name] = [(str(e["name"]), e.get("rotor")) for e in effects]
    found, left = verdicts_on(data.implants, names)
    beside = listed(result)
    verdicts: list[Verdict] = []
    probabilities: list[float] = []
    for implant, verdict in zip(data.implants, found, strict=True):
        share = max((s for n, s in beside if is_it(n, implant)), default=0.0)
        if verdict == "named":
            effect = next(e for e, n in zip(effects, names, strict=True) if is_it(n, implant))
            share = float(effect.get("probability") or 1.0)
        elif share >= LISTED_FROM:
            verdict = "listed"
        verdicts.append(verdict)
        probabilities.append(share)
    instrument = (*RIGHT_INSTRUMENT.get(data.kind, ()), *ALSO_TRUE.get(data.kind, ()))
    wrong = [n for n in left if not any(part in n[0] for part in instrument)]
    uneven = uneven_rotors(data)
    weak = [i.rotor for i in data.implants if i.name == "rotor_degradation"]
    bad = {rotor + 1 for rotor in weak if rotor is not None} | uneven
    parts = [str(one["part"]) for one in result.get("actions") or []]
    unexplained = open_place(result)
    excluded = [e for e in result.get("excluded") or [] if e.get("parameter", "loss") == "loss"]
    return Score(
        seed=data.seed,
        kind=data.kind,
        group=data.group,
        craft=data.craft.name,
        flights=len(data.fit),
        implants=tuple(
            (i.kind, i.name, None if i.rotor is None else i.rotor + 1, i.size)
            for i in data.implants
        ),
        verdicts=tuple(verdicts),
        probabilities=tuple(probabilities),
        reported=tuple(map(shown, names)),
        wrong=tuple(map(shown, wrong)),
        natural=tuple(shown(n) for n in wrong if n[0] in NATURAL),
        asked=tuple(parts),
        sound_rotors_asked=tuple(
            rotor for p in parts if p.startswith("rotor ") and (rotor := int(p[6:])) not in bad
        ),
        first=first_line(data, result),
        right_rotor=any(n == "rotor_degradation" and r in uneven for n, r in wrong),
        unexplained_mode=unexplained.get("mode"),
        unexplained_channel=unexplained.get("channel"),
        intervals=tuple(intervals_of(data.implants, effects)),
        falsely_excluded=sum(
            e["name"] == i.name and e.get("rotor") == (i.rotor or 0) + 1 and i.size > e["above"]
            for e in excluded
            for i in data.implants
            if i.kind == "rotor"
        ),
        excluded=len(excluded),
        before_rmse_rpm=_rmse(result, "before"),
        after_rmse_rpm=_rmse(result, "after"),
        floor_rpm=float(result.get("floor_rpm") or np.nan),
        knowing_rmse_rpm=knowing_rmse_rpm,
        trees_rmse_rpm=trees_rmse_rpm,
        oracle=tuple(tuple(map(float, row)) for row in oracle),
        told=tuple(told),
        others={
            method: (verdicts_on(data.implants, of)[0], len(verdicts_on(data.implants, of)[1]))
            for method, of in (others or {}).items()
        },
        seconds=seconds,
        failed=failed,
    )


def first_line(data: DataSet, result: Mapping[str, Any]) -> First:
    """What the first sentence of an answer is worth; of "either ... or" one that is true is."""
    effects = sorted(result["effects"], key=lambda e: e.get("rotor") is None)
    groups = [[_named(e) for e in g["effects"]] for g in result.get("one_of") or []]
    rotors = [[("rotor_degradation", m["rotor"])] for m in result.get("mentioned") or []]
    rest = [*without_a_name(result), *filter(None, [result.get("likeliest")])]
    likeliest = [] if open_place(result) else [[_named(e)] for e in rest]
    for names in [*([_named(e)] for e in effects), *rotors, *groups, *likeliest][:1]:
        true = any(is_it(n, i) for n in names for i in data.implants)
        return "right" if true or uneven_rotors(data) & {r for _, r in names} else "wrong"
    return "unexplained" if open_place(result) else "nothing"


def open_place(result: Mapping[str, Any]) -> Mapping[str, Any]:
    """Mode and channel of what no effect explains, else of a cause that is said first without a
    name; empty where there is none."""
    places = [result.get("unexplained") or {}, *without_a_name(result)[:1]]
    return next((one for one in places if one.get("mode") and not one.get("minor")), {})


def without_a_name(result: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Causes without a name that are said first: not where nothing is likelier to be missing."""
    none = [one for one in result.get("alternatives") or [] if not one.get("effects")]
    likely = sum(float(one["probability"]) for one in none) < 0.5
    return list(result.get("unnamed_causes") or []) if likely else []


def uneven_rotors(data: DataSet) -> set[int]:
    """The rotors, from 1, that lose thrust by a law of no table."""
    own = {int(str(i.condition["rotor"])): i.kind for i in data.implants if i.kind in UNEVEN}
    beside = {(r + 1) % data.craft.rotors for r, kind in own.items() if kind == "worn"}
    return {r + 1 for r in {*own, *beside}}


def intervals_of(
    implants: Sequence[Implant], effects: Sequence[Mapping[str, Any]]
) -> list[Interval]:
    """The stated parameters of the named changes beside their true values."""
    found = []
    for implant in implants:
        for effect in effects:
            if not is_it((str(effect["name"]), effect.get("rotor")), implant):
                continue
            for parameter, truth in implant.truth.items():
                stated = effect["parameters"].get(parameter)
                if stated is not None and None not in stated["ci95"]:
                    low, high = map(float, stated["ci95"])
                    found.append(Interval(parameter=parameter, truth=truth, low=low, high=high))
            break
    return found


def shown(name: Name) -> str:
    return name[0] + (f" {name[1]}" if name[1] is not None else "")


def _rmse(result: Mapping[str, Any], when: str) -> float:
    value = result[when]["rmse_rpm"]
    return float("nan") if value is None else float(value)
