"""Result types of `identify`, and their JSON ("thrustmargin.identify/1")."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from thrustmargin.models.checks.arms.arm_posterior import ArmAnswer
from thrustmargin.models.effects.thrust_effects import ROTOR_DEGRADATION
from thrustmargin.models.effects.unnamed import CONSTANT, KNOTS, NAME, place_of
from thrustmargin.models.flight import Floats
from thrustmargin.models.identification.answer.constant_shares import ConstantShares
from thrustmargin.models.identification.answer.held_out_errors import (
    Errors,
    ExcessError,
    HeldOutResidual,
    excess_error,
)
from thrustmargin.models.identification.certainty import CHOICE
from thrustmargin.models.identification.rows.candidates import Term
from thrustmargin.models.identification.rows.problem import Problem
from thrustmargin.models.json_values import to_json_values
from thrustmargin.models.model.rotor_model import RotorModel


@dataclass(frozen=True, slots=True, kw_only=True)
class SetWeight:
    """A set of effects that together explain the flights, and its posterior probability."""

    probability: float
    terms: tuple[Term, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class OneOf:
    """Confounded effects: at least one of them is present, each with its probability."""

    terms: tuple[Term, ...]
    probabilities: tuple[float, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Excluded:
    """The size of an unseen effect above which these flights exclude it at 95 %."""

    term: Term
    parameter: str
    unit: str
    above: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Mentioned:
    """A rotor whose degradation is neither reported nor excluded by the flights."""

    rotor: int  # 0-based
    probability: float
    loss: float
    ci95: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Unexplained:
    """The unexplained residual, with the mode that has most of it."""

    mode: int
    channel: str
    channels: tuple[str, ...]  # `channel` first, then others that fit about as well
    share: float  # share of the unexplained variance
    rms_rpm: float
    wanders: bool = False  # slow noise within flights, along no channel but time
    rotor: int | None = None  # rotor (0-based) with an uneven loss, which acts in all modes
    #: too small to be listed first or to request an action; an uneven loss of a rotor never is
    minor: bool = False


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ReportedEffect:
    """A reported effect with values and 95 % limits (F, parameters); shared values repeat over
    F."""

    term: Term
    value: Floats
    lower: Floats
    upper: Floats
    rmse_before_rpm: float
    rmse_after_rpm: float
    probability: float = 1.0

    def __repr__(self) -> str:
        main = [(k, p) for k, p in enumerate(self.term.effect.parameters) if not p.detail]
        values = ", ".join(
            f"{p.name} {self.value[self.flight, k]:.2g}{'' if p.unit == '1' else f' {p.unit}'} "
            f"({self.lower[self.flight, k]:.2g} to {self.upper[self.flight, k]:.2g})"
            for k, p in main
        )
        return f"{self.term.words}: {values}"

    @property
    def flight(self) -> int:
        """Return the index of the flight with the largest value, which represents the effect.

        0 for an effect without per-flight values.
        """
        own = [k for k, p in enumerate(self.term.effect.parameters) if p.per_flight]
        return int(np.argmax(np.abs(self.value[:, own[0]]))) if own else 0

    def parameters(self, names: tuple[str, ...]) -> dict[str, Any]:
        """Return a dict of each parameter's value, unit and 95 % interval (`ci95`), for JSON.

        The value of a per-flight parameter is that of flight `self.flight`, whose name is added as
        `flight`; `per_flight` and `per_flight_ci95` list those of all flights, in the order of
        their `names`.
        """
        out: dict[str, Any] = {}
        for k, p in enumerate(self.term.effect.parameters):
            f = self.flight
            entry: dict[str, Any] = {
                "value": float(self.value[f, k]),
                "unit": p.unit,
                "ci95": [float(self.lower[f, k]), float(self.upper[f, k])],
            }
            if p.per_flight:
                entry["flight"] = names[f]
                entry["per_flight"] = [float(v) for v in self.value[:, k]]
                ends = zip(self.lower[:, k], self.upper[:, k], strict=True)
                entry["per_flight_ci95"] = [[float(low), float(high)] for low, high in ends]
            out[p.name] = entry
        return out

    def to_json(self, names: tuple[str, ...], *, followed: bool = False) -> dict[str, Any]:
        """Return the effect as JSON: `name`, `variant`, `rotor` (from 1, or None), `probability`,
        `parameters`, `rmse_before_rpm`, `rmse_after_rpm`, `source`, `already_followed`.

        `names` are the flights'. `followed`: the airspeed channel already contains the effect, so
        it is not added to the model.
        """
        return {
            "name": self.term.effect.name,
            "variant": self.term.effect.variant,
            "rotor": None if self.term.rotor is None else self.term.rotor + 1,
            "probability": self.probability,
            "parameters": self.parameters(names),
            "rmse_before_rpm": self.rmse_before_rpm,
            "rmse_after_rpm": self.rmse_after_rpm,
            "source": self.term.effect.source,
            "already_followed": followed,
        }


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OpenCause:
    """An unnamed cause that enters the new model: a curve along a channel, or an effect that is not
    certain enough to be reported."""

    found: ReportedEffect
    alike: tuple[str, ...]  # other channels along which a curve would fit about as well
    rms_rpm: float  # RMS of the change in these flights

    @property
    def place(self) -> tuple[str, str] | None:
        """Return (control axis or "rotor", channel) of a curve; None for an effect."""
        effect = self.found.term.effect
        return place_of(effect) if effect.name == NAME else None

    @property
    def range(self) -> tuple[float, float] | None:
        """Return the range of the curve's channel in which it was fitted; None for a constant or an
        effect."""
        if self.place is None or self.place[1] == CONSTANT:
            return None
        low, high = self.found.value[0, KNOTS:]
        return float(low), float(high)

    def to_json(self, names: tuple[str, ...]) -> dict[str, Any]:
        """Return the cause as JSON: an effect's keys, `rms_rpm`, and of a curve `mode`, `channel`,
        `alike` and `range`.

        `names` are the flights'. Mode, channel and range are None for an effect that is no curve.
        """
        mode, channel = self.place or (None, None)
        of_curve = {"mode": mode, "channel": channel, "alike": list(self.alike)}
        of_curve["range"] = self.range and list(self.range)
        return {**self.found.to_json(names), **of_curve, "rms_rpm": self.rms_rpm}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Identification:
    """Everything that an identification found, with the rows it was found on."""

    model: RotorModel
    problem: Problem
    found: tuple[ReportedEffect, ...]
    arms: ArmAnswer  # what the arms' own figures say, given the rotors of `found` and `misread`
    left: Unexplained | None  # unexplained residual, in the mode with most of it
    closest: tuple[Term, ...]  # effects that resemble it, which are not reported
    unseen: tuple[HeldOutResidual, ...]  # of the fitted flights, then of held-out flights if any
    before: Errors  # of the last of `unseen`
    after: Errors
    residual_after_rpm: Floats  # (T, R) on the rows of `problem`
    #: (T, R) with effects of later flights only, values fitted without each row's flight
    residual_transferable_rpm: Floats
    floor_rpm: float
    sensor_noise_rpm: float
    #: losses of rotors that by the arms' figures are speeds read too high: no part is bad, and they
    #: do not enter the new model
    misread: tuple[ReportedEffect, ...] = ()
    alternatives: tuple[SetWeight, ...] = ()  # most probable first
    one_of: tuple[OneOf, ...] = ()
    excluded: tuple[Excluded, ...] = ()
    mentioned: tuple[Mentioned, ...] = ()
    #: effects of some flights that predict the others worse, which are not reported
    contradicted: tuple[Term, ...] = ()
    gaining: frozenset[int] = frozenset()  # rotors (0-based) that make more thrust than expected
    open_causes: tuple[OpenCause, ...] = ()  # unnamed causes that enter the new model
    followed: tuple[ReportedEffect, ...] = ()  # effects that a channel reports to the model already
    #: constant differences of motor outputs, of unknown cause
    constant_shares: ConstantShares | None = None
    #: effect -> lacking channels
    untried: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def held_out(self) -> Problem | None:
        """Return the rows of the held-out flights; None without any."""
        return self.unseen[-1].problem if len(self.unseen) > 1 else None

    def __repr__(self) -> str:
        problem, held_out = self.problem, self.held_out
        flights = "flights that were not used"
        if held_out is None:
            flights = "each flight" if problem.flights > 1 else "each fifth"
            flights += " left out in turn"
        return "\n".join(
            [
                f"{self.model.airframe.name}, {problem.flights} "
                f"flight{'s' if problem.flights > 1 else ''}: rotor speed error "
                f"{self.before.rmse_rpm:.1f} -> {self.after.rmse_rpm:.1f} rpm, {flights}",
                *(repr(f) for f in self.found),
                *([] if self.found else ["no effect is named"]),
                *(f"{f!r}, which its arm shows to be a wrong speed" for f in self.misread),
                *(f"{f!r}, which a channel reports already" for f in self.followed),
                *self._unexplained_words(),
            ]
        )

    def _unexplained_words(self) -> list[str]:
        """Return a line that describes the unexplained residual; empty without one."""
        what = self.unexplained()
        if not what["mode"]:
            return []
        where = what["mode"]
        if what["rotor"]:
            where = f"rotor {what['rotor']}"
        return [
            f"unexplained: {where} along {what['channel']}, "
            f"{100 * what['fraction_of_variance']:.0f} % of the variance left"
        ]

    @property
    def nothing_probability(self) -> float:
        """Return the probability of no effect at all; 1 where no set was scored."""
        weighed = bool(self.alternatives)
        return sum(
            (w.probability for w in self.alternatives if not w.terms), 0.0 if weighed else 1.0
        )

    @property
    def most_probable(self) -> tuple[Term, float] | None:
        """Return the most probable effect that is not reported, with its probability, or None.

        It acts on no single rotor and has a probability above CHOICE. Cross-validation did not
        confirm it, so it asks for no action.
        """
        sets = self.alternatives
        terms = [t for one in sets for t in one.terms if t.rotor is None and t.effect.name != NAME]
        reported = [one.term for one in self.reported]
        likely = [
            (sum(one.probability for one in sets if term in one.terms), term)
            for term in terms
            if term not in reported
        ]
        probability, term = max(likely, key=lambda one: one[0], default=(0.0, None))
        return None if term is None or probability <= CHOICE else (term, probability)

    @property
    def reported(self) -> tuple[ReportedEffect, ...]:
        """Return the effects to add to the model, then winds that airspeed contains, which are
        not added."""
        return (*self.found, *self.followed)

    @property
    def excess(self) -> ExcessError | None:
        """Return the error beyond that of sound flights if no effect is reported; else None.

        None for motor outputs, which differ between sound flights by more than rotor speeds do.
        """
        if self.found or self.misread or self.problem.of_outputs:
            return None
        return excess_error(self.model.good_flights, self.after, self.floor_rpm)

    def to_json(self, *, model_in: str = "", model_out: str = "") -> dict[str, Any]:
        """Return the content of the identify command's JSON, schema "thrustmargin.identify/1"; NaN
        becomes None.

        It has the flights with their role, the errors before and after, and the effects: reported,
        alternative, excluded, mentioned, contradicted and unnamed ones. `excess_error` is the error
        beyond that of sound flights, or None. `errors_from` is "held_out"
        with held-out flights, else "cross_validation". `model_in` and `model_out` are the paths of
        the model files read and written.
        """
        rows = np.bincount(self.problem.flight)
        flights = [
            {"log": n, "role": "fit", "samples": int(s)}
            for n, s in zip(self.problem.names, rows, strict=True)
        ]
        if self.held_out is not None:
            unused = np.bincount(self.held_out.flight)
            flights += [
                {"log": n, "role": "held_out", "samples": int(s)}
                for n, s in zip(self.held_out.names, unused, strict=True)
            ]
        effects = [f.to_json(self.problem.names) for f in self.found]
        effects += [f.to_json(self.problem.names, followed=True) for f in self.followed]
        return to_json_values(
            {
                "schema": "thrustmargin.identify/1",
                "model": {"in": model_in, "out": model_out},
                "flights": flights,
                "errors_from": "held_out" if self.held_out is not None else "cross_validation",
                "before": self.before,
                "after": self.after,
                "effects": effects,
                "misread": [f.to_json(self.problem.names) for f in self.misread],
                "alternatives": [
                    {"probability": w.probability, "effects": [_term_json(t) for t in w.terms]}
                    for w in self.alternatives
                ],
                "one_of": [
                    {"effects": [_term_json(t) for t in o.terms], "probabilities": o.probabilities}
                    for o in self.one_of
                ],
                "excluded": [
                    {
                        **_term_json(e.term),
                        "parameter": e.parameter,
                        "unit": e.unit,
                        "above": e.above,
                    }
                    for e in self.excluded
                ],
                "likeliest": self.most_probable
                and {**_term_json(self.most_probable[0]), "probability": self.most_probable[1]},
                "mentioned": [_mention_json(m) for m in self.mentioned],
                "standing_shares": self.constant_shares
                and _shares_json(self.constant_shares, self.problem.names),
                "not_tried": self.untried,
                "from_motor_outputs": self.problem.of_outputs,
                "contradicted": [_term_json(t) for t in self.contradicted],
                "unexplained": self.unexplained(),
                "excess_error": self.excess and _excess_json(self.excess),
                "unnamed_causes": [one.to_json(self.problem.names) for one in self.open_causes],
                "floor_rpm": self.floor_rpm,
                "sensor_noise_rpm": self.sensor_noise_rpm,
            }
        )

    def unexplained(self) -> dict[str, Any]:
        """Return the unexplained residual as JSON.

        The keys are share of variance, RMS in rpm, mode, channels, rotor (1-based) and closest
        effects. Without one, share and RMS are 0, mode, channel and rotor None, and channels empty.
        """
        unexplained = self.left
        return {
            "fraction_of_variance": unexplained.share if unexplained else 0.0,
            "mode": self.problem.modes.names[unexplained.mode] if unexplained else None,
            "channel": unexplained.channel if unexplained else None,
            "channels": list(unexplained.channels) if unexplained else [],
            "wanders": bool(unexplained) and unexplained.wanders,
            "minor": bool(unexplained) and unexplained.minor,
            "rms_rpm": unexplained.rms_rpm if unexplained else 0.0,
            "rotor": None
            if unexplained is None or unexplained.rotor is None
            else unexplained.rotor + 1,
            "closest": [term.words for term in self.closest],
        }


def weak_rotors(found: Iterable[ReportedEffect]) -> frozenset[int]:
    """Return the rotors, from 0, with a loss or gain of thrust among reported effects."""
    of_loss = (one.term for one in found if one.term.effect.name == ROTOR_DEGRADATION.name)
    return frozenset(term.rotor for term in of_loss if term.rotor is not None)


def _term_json(term: Term) -> dict[str, Any]:
    """Return name, variant and rotor (1-based) of an effect as JSON."""
    rotor = None if term.rotor is None else term.rotor + 1
    return {"name": term.effect.name, "variant": term.effect.variant, "rotor": rotor}


def _shares_json(shares: ConstantShares, names: tuple[str, ...]) -> dict[str, Any]:
    """Return constant thrust shares as JSON, rotors counted from 1 and the flight by its name."""
    rotors = [{**to_json_values(one), "rotor": (one.rotor or 0) + 1} for one in shares.weak_rotors]
    flight = None if shares.flight is None else names[shares.flight]
    return {**to_json_values(shares), "flight": flight, "weak_rotors": rotors}


def _excess_json(excess: ExcessError) -> dict[str, Any]:
    """Return an error beyond that of sound flights as JSON, with the rotors counted from 1."""
    return to_json_values(excess) | {"rotors": [rotor + 1 for rotor in excess.rotors]}


def _mention_json(loss: Mentioned) -> dict[str, Any]:
    """Return a mentioned rotor as JSON, with the name of the effect and the rotor
    counted from 1."""
    return {"name": ROTOR_DEGRADATION.name} | to_json_values(loss) | {"rotor": loss.rotor + 1}
