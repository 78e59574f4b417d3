"""Write the arms' answer as values of JSON, with the arms counted from 1."""

from __future__ import annotations

from typing import Any

from thrustmargin.models.checks.arms.arm_posterior import ArmAnswer, ArmFinding


def answer_json(answer: ArmAnswer | None) -> dict[str, Any] | None:
    """Return an answer as a dict of JSON values; None without one.

    Keys: `compared` (quantities), `earlier_flights` and `days` (their numbers), `findings` (each as
    in `_finding_json`, with its `arm` from 1) and `aircraft` (a finding that is of no single arm,
    or None).
    """
    if answer is None:
        return None
    return {
        "compared": list(answer.quantities),
        "earlier_flights": answer.flights,
        "days": answer.days,
        "findings": [{"arm": one.arm + 1} | _finding_json(one) for one in answer.findings],
        "aircraft": None if answer.aircraft is None else _finding_json(answer.aircraft),
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
