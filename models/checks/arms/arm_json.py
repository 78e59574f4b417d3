"""Write the arms' answer as values of JSON, with the arms counted from 1."""

from __future__ import annotations

from typing import Any

from thrustmargin.models.checks.arms.arm_posterior import ArmAnswer, ArmFinding, Shaken


def answer_json(answer: ArmAnswer | None) -> dict[str, Any] | None:
    """Return an answer as a dict of JSON values; None without one.

    `shaken` is the level of vibration over the usual one, where it is too high. Sizes are shares,
    as `arm_causes` has them; `ci95` are the ends of their 95 % intervals.
    """
    if answer is None:
        return None
    return {
        "compared": list(answer.quantities),
        "earlier_flights": answer.flights,
        "days": answer.days,
        "findings": [{"arm": one.arm + 1} | _finding_json(one) for one in answer.findings],
        "shaken": None if answer.shaken is None else _shaken_json(answer.shaken),
    }


def _shaken_json(one: Shaken) -> dict[str, Any]:
    """Return the level of vibration of a shaken aircraft as a dict of JSON values."""
    return {
        "ratio": one.ratio,
        "ci95": [one.lower, one.upper],
        "standard_deviations": one.deviations,
    }


def _finding_json(one: ArmFinding) -> dict[str, Any]:
    """Return a finding as a dict of JSON values: `probability`, `causes` and `shown`.

    Each of `causes` has `cause`, `sensor` (True if only a sensor is wrong), `probability`, `size`
    and the ends `ci95` of its 95 % interval, as shares. Each of `shown` has `quantity`, the arm's
    `departure` as a share, and in `standard_deviations`.
    """
    return {
        "probability": one.probability,
        "causes": [
            {
                "cause": cause.cause,
                "sensor": cause.cause.of_sensor,
                "probability": cause.probability,
                "size": cause.size,
                "ci95": [cause.lower, cause.upper],
            }
            for cause in one.causes
        ],
        "shown": [
            {"quantity": quantity, "departure": share, "standard_deviations": apart}
            for quantity, share, apart in one.shown
        ],
    }
