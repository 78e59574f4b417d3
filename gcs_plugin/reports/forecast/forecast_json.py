"""A plan's forecast as JSON, schema thrustmargin.forecast/1; null where a number is not known."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from typing import Any

from thrustmargin.gcs_plugin.wording.plans.forecast_words import assumed_words, verdict
from thrustmargin.mission.ahead.plan_forecast import PlanForecast


def json_text(made: PlanForecast) -> str:
    """The forecast; kg, s, Wh and shares of thrust."""
    use, weakest = made.advised.advice.use, made.weakest
    sorties = () if made.needs.short_of else made.needs.sorties  # no split is possible
    content: dict[str, Any] = {
        "schema": "thrustmargin.forecast/1",
        "verdict": {"level": made.level.value, "words": verdict(made)},
        "conditions": asdict(made.given),  # `report --assumed` reads them
        "flight_s": made.flight_s,
        "tank_end_kg": float(made.flight.track.tank_kg[-1]),
        "energy_wh": sum(s.energy_wh for s in made.needs.sorties),
        "utilisation": {
            "typical": use.lasting_most,
            "peak": use.peak,
            "peak_interval": None if weakest is None else list(weakest.interval),
        },
        "weakest": None
        if weakest is None
        else {
            "item": weakest.item,
            "what": weakest.kind,
            "utilisation": weakest.utilisation,
            "manoeuvre": weakest.manoeuvre,
            "load": weakest.load,
            "wind": weakest.wind,
            "battery": weakest.battery,
        },
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
        "point_of_no_return": {
            "item": made.way_back.item,
            "time_s": made.way_back.time_s,
            "distance": made.way_back.distance,
            "spare_wh": made.way_back.spare_wh,
        },
        "sorties_short_of": made.needs.short_of or None,
        "legs": [
            {
                "item": leg.item,
                "kind": leg.kind,
                "seconds": leg.seconds,
                "utilisation_mean": leg.utilisation_mean,
                "utilisation_peak": leg.utilisation_peak,
                "interval": list(leg.interval),
                "tank_end_kg": leg.tank_end_kg,
            }
            for leg in made.legs
        ],
        "plan_faults": [{"fault": f.fault, "items": list(f.items)} for f in made.findings],
        "assumed": list(assumed_words(made)),
        "not_understood": [
            {"item": n.item, "command": n.command, "why": n.why, "touches": list(n.touches)}
            for n in made.not_understood
        ],
    }
    return json.dumps(_plain(content), indent=1, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return round(value, 6) if math.isfinite(value) else None
    return value
