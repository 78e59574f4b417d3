"""What only the owner of an aircraft knows: which of it is missing, and the questions for it.

What the vehicle has answered is not asked for. Each question offers a default, which is a guess.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import isfinite, pi, sin
from typing import TYPE_CHECKING, Any

from thrustmargin.gcs_plugin.commands.airframe.stated import OTHER, OwnerStatement, stated
from thrustmargin.gcs_plugin.commands.shared.options import UsageError
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
from thrustmargin.models.errors import DataError

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.telemetry.reported_airframe import ReportedAirframe

EXAMPLE = (
    "thrustmargin airframe new --from flight.BIN --mass 18 --arm 0.74 --tank-litres 0 "
    "--power-set hobbywing-x6-plus --out my-aircraft.toml"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Question:
    """What only the owner knows: the option that says it, and when the vehicle has not."""

    field: str
    option: str
    words: str
    needed: Callable[[OwnerStatement, ReportedAirframe], bool]
    default: Callable[[OwnerStatement, ReportedAirframe], Any]
    read: Callable[[str], Any] = float


def _thrust_known(owner: OwnerStatement, reported: ReportedAirframe) -> bool:
    return owner.max_thrust_kgf is not None or "nameplate_max_thrust" in reported.quantities


def _typical_thrust(owner: OwnerStatement, reported: ReportedAirframe) -> float:
    """kgf of the sets that ship at this propeller's diameter: thrust goes with its square."""
    from thrustmargin.models.physics.airframe_draft import power_sets

    diameter = stated(owner, reported)["propeller_diameter"].value
    known = sorted(
        s.quantities["nameplate_max_thrust"].value / s.quantities["propeller_diameter"].value ** 2
        for s in power_sets().values()
    )
    return round(known[len(known) // 2] * diameter**2 / 9.80665, 1)


def _typical_arm(owner: OwnerStatement, reported: ReportedAirframe) -> float:
    """m at which the tips of neighbouring propellers are a tenth of their diameter apart."""
    import numpy as np

    from thrustmargin.models.physics.motor_layouts import bearings, motor_layouts

    layout = motor_layouts()[str(owner.layout or reported.layout)]
    arms = len(np.unique(np.round(bearings(layout.place))))
    return round(
        1.1 * stated(owner, reported)["propeller_diameter"].value / (2 * sin(pi / arms)), 2
    )


def _hover_mass(owner: OwnerStatement, reported: ReportedAirframe) -> float:
    """kg by the hover throttle that the autopilot learnt; a third of all thrust without one."""
    from thrustmargin.models.physics.motor_layouts import motor_layouts

    share = reported.hover_throttle if isfinite(reported.hover_throttle) else 1.0 / 3.0
    rotors = len(reported.rotors or motor_layouts()[str(owner.layout or reported.layout)].spin)
    top = stated(owner, reported)["nameplate_max_thrust"].value
    return round(share * rotors * top / 9.80665, 1)


#: Layout offered for so many rotors.
_USUAL = {6: "hexa-x", 8: "octo-x", 10: "deca-x", 12: "dodecahexa-x"}
_QUESTIONS = (
    _Question(
        field="layout",
        option="--layout {default}",
        words="layout of the motors; the vehicle does not say",
        needed=lambda owner, reported: owner.layout is None and reported.layout is None,
        default=lambda _, reported: _USUAL.get(reported.rotor_count, "quad-x"),
        read=str,
    ),
    _Question(
        field="power_set",
        option="--power-set NAME, or --propeller 24x8 with --max-thrust-kgf 11.8",
        words="motor and propeller, a name of `thrustmargin airframe list` or other",
        needed=lambda owner, reported: (
            owner.power_set is None
            and owner.propeller is None
            and not _thrust_known(owner, reported)
        ),
        default=lambda *_: "hobbywing-x6-plus",
        read=str,
    ),
    _Question(
        field="propeller",
        option="--propeller 24x8",
        words="diameter x pitch of the propeller in inches",
        needed=lambda owner, reported: (
            owner.propeller is None
            and owner.power_set in (None, OTHER)
            and (owner.power_set == OTHER or _thrust_known(owner, reported))
        ),
        default=lambda *_: "24x8",
        read=str,
    ),
    _Question(
        field="max_thrust_kgf",
        option="--max-thrust-kgf 11.8",
        words="kgf of one rotor at full throttle, by the maker's data sheet",
        needed=lambda owner, reported: (
            owner.power_set in (None, OTHER)
            and owner.propeller is not None
            and not _thrust_known(owner, reported)
        ),
        default=_typical_thrust,
    ),
    _Question(
        field="cells",
        option="--cells 14",
        words="battery cells in series; the vehicle does not say",
        needed=lambda owner, reported: (
            owner.cells is None and "nominal_voltage" not in reported.quantities
        ),
        default=lambda *_: 14,
        read=int,
    ),
    _Question(
        field="arm",
        option="--arm 0.74 or --wheelbase 1.48",
        words="m from the centre to a motor, or from motor to motor across",
        needed=lambda owner, reported: (
            owner.arm is None and owner.wheelbase is None and "arm" not in reported.quantities
        ),
        default=_typical_arm,
    ),
    _Question(
        field="mass",
        option="--mass 18",
        words="kg, ready to fly with its battery and without liquid",
        needed=lambda owner, _: owner.mass is None,
        default=_hover_mass,
    ),
    _Question(
        field="tank_litres",
        option="--tank-litres 16",
        words="L of the full tank; 0 when it carries no liquid",
        needed=lambda owner, _: owner.tank_litres is None,
        default=lambda *_: 0.0,
    ),
)


def _written(question: _Question, owner: OwnerStatement, reported: ReportedAirframe) -> str:
    """The option as one would write it; a default stands in it where it depends on nothing else."""
    if "{default}" not in question.option:
        return question.option
    return question.option.format(default=question.default(owner, reported))


def require_all(owner: OwnerStatement, reported: ReportedAirframe) -> None:
    """Raise UsageError that names every option that is missing, or a layout that is not known."""
    from thrustmargin.models.physics.motor_layouts import motor_layouts

    missing = [q for q in _QUESTIONS if q.needed(owner, reported)]
    if missing:
        listed = "".join(f"\n  {_written(q, owner, reported)}: {q.words}" for q in missing)
        reported_count = reported.layout is None and reported.rotor_count
        hint = f"\nThe vehicle reports {reported_count} rotors." if reported_count else ""
        raise UsageError(
            f"what the vehicle cannot know is missing:{listed}{hint}\nExample: {EXAMPLE}"
        )
    if reported.rotors is None and reported.layout not in motor_layouts():
        raise UsageError(f"no layout {reported.layout!r}; known are {', '.join(motor_layouts())}")
    if owner.arm is not None and owner.wheelbase is not None:
        raise UsageError("--arm and --wheelbase say the same; give one of them")


def asked(owner: OwnerStatement, reported: ReportedAirframe) -> OwnerStatement:
    """`owner` with an answer to every question that is open; an empty answer takes the default.

    Raises DataError when the answers end before the questions.
    """
    for question in _QUESTIONS:
        if question.needed(owner, reported):
            owner = _answered(question, owner, reported)
    return owner


def _answered(
    question: _Question, owner: OwnerStatement, reported: ReportedAirframe
) -> OwnerStatement:
    default = question.default(owner, reported)
    while True:
        try:
            answer = input(f"{question.words} [{default}]: ").strip()
        except EOFError as error:
            written = _written(question, owner, reported)
            raise DataError(f"no answer; give {written}") from error
        try:
            value = question.read(answer) if answer else default
            candidate = replace(owner, **{question.field: value})
            if not answer:
                candidate = replace(candidate, defaults=owner.defaults | {question.field})
            stated(candidate, reported)
        except (ValueError, UsageError) as error:
            Terminal(soft_wrap=True).print(str(error))
            continue
        return candidate
