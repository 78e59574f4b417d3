"""The arms' answer of a flight as JSON: arms, causes and figures, counted from 1."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.reports.margin.data import JsonObject
    from thrustmargin.models.arms.posterior import ArmAnswer


def arm_rows(answer: ArmAnswer | None) -> JsonObject | None:
    """What the figures of the arms show, and from how many earlier flights; None without them."""
    if answer is None:
        return None
    return {
        "compared": list(answer.quantities),
        "earlier_flights": answer.flights,
        "days": answer.days,
        "findings": [
            {
                "arm": one.arm + 1,
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
            for one in answer.findings
        ],
    }
