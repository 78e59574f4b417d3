"""A plan's forecast as JSON, schema thrustmargin.forecast/1; null where a number is not known."""

from __future__ import annotations

from dataclasses import asdict

from thrustmargin.gcs_plugin.reports.shared import written
from thrustmargin.gcs_plugin.wording.plans.forecast_words import assumed_words, verdict
from thrustmargin.mission.ahead.plan_forecast import PlanForecast


def json_text(made: PlanForecast) -> str:
    """The forecast; kg, s, Wh and shares of thrust."""
    use, weakest = made.advised.advice.use, made.weakest
    sorties = () if made.needs.short_of else made.needs.sorties  # no split is possible
    content = {
        "schema": "thrustmargin.forecast/1",
        "verdict": {"level": made.level, "words": verdict(made)},
        "conditions": made.given,  # `report --assumed` reads them
        "flight_s": made.flight_s,
        "tank_end_kg": float(made.flight.track.tank_kg[-1]),
        "energy_wh": sum(s.energy_wh for s in made.needs.sorties),
        "utilisation": {
            "typical": use.lasting_most,
            "peak": use.peak,
            "peak_interval": weakest and weakest.interval,
        },
        "weakest": weakest and {"what": weakest.kind, **asdict(weakest)},
        "largest_fill_kg": made.largest_fill_kg,
        "rotor_loss_survivable_below_kg": made.survivable_below_kg,
        "sorties": [
            {
                "items": [s.first_item, s.last_item],
                "refill": s.last_item if k + 1 < len(sorties) else None,
                "litres": s.kg / made.advised.analysis.model.airframe.liquid_density,
                "hectares": s.lines * made.swath / 1e4,
                "minutes": s.seconds / 60.0,
                "energy_wh": s.energy_wh,
            }
            for k, s in enumerate(sorties)
        ],
        "point_of_no_return": made.way_back,
        "sorties_short_of": made.needs.short_of or None,
        "legs": made.legs,
        "plan_faults": made.findings,
        "assumed": assumed_words(made),
        "not_understood": made.not_understood,
    }
    return written.json_text(content, digits=8)
