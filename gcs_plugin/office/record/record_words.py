"""Word the record of a job: titles of its fields, its liquid, and what rules require."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from thrustmargin.gcs_plugin.wording.language import number

#: Field of the record -> its title, which is also the question on a terminal.
TITLES: Mapping[str, str] = {
    "product": "product, full name",
    "registration": "registration or authorisation number of the product",
    "active": "active constituents",
    "rate": "dose, such as 1.5 L/ha",
    "crop": "crop or situation",
    "crop_code": "EPPO code of the crop",
    "growth_stage": "growth stage, BBCH",
    "use_type": "type of use, such as area",
    "field": "name of the field",
    "land_address": "address of the land",
    "customer": "name of the person served",
    "customer_address": "address of the person served",
    "customer_contact": "phone or e-mail of the person served",
    "pilot": "name of the pilot",
    "pilot_address": "address of the pilot",
    "pilot_certificate": "certificate number of the pilot",
    "pilot_skill_date": "date on which the pilot passed the knowledge and skill test",
    "aircraft": "registration mark, else serial number, of the aircraft",
    "equipment": "nozzles and other spray equipment, with what reduces drift",
    "wind": "wind, such as 3 m/s from 240°",
    "temperature": "temperature of the air, °C",
    "humidity": "relative humidity, %",
    "inversion": "temperature inversion: yes or no",
    "permit": "number of the approved application plan or permit",
    "planned_start": "planned start, date and time",
    "flight_authorisation": "number of the authorisation to fly",
    "aerial_reason": "why not from the ground",
    "date": "date",
    "start": "start, UTC",
    "finish": "finish, UTC",
    "start_local": "start, local",
    "finish_local": "finish, local",
    "area": "area treated",
    "area_at_least": "area treated, at least",
    "field_area": "area of the field",
    "area_outside_field": "treated outside the field",
    "swath": "swath",
    "quantity": "spray liquid applied",
    "product_quantity": "quantity of the product applied",
    "quantity_kg": "spray liquid applied, by weight",
    "spray_volume": "spray volume",
    "location": "place",
    "autopilot_serial": "serial number of the autopilot",
}


NO_RULE = "No rule was named with --rule, so none was checked."
NO_SHAPEFILE = (
    "no shapefile, for pyshp is not installed; the GeoJSON has the same ground. To have it run: "
    "{line}"
)


#: Heading of the list of unused logs and vehicles.
LEFT_OUT = "Not in this record"


def same_flight(name: str) -> str:
    """Return why a log is left out: it records the same flight as the log `name`."""
    return f"the same flight as {name}, which counts once"


def other_vehicles(chosen: int, others: Sequence[int]) -> str:
    """Return why other vehicles of a log are left out: the vehicle `chosen` was read."""
    ids = ", ".join(map(str, others))
    return f"vehicle {ids} of the log: vehicle {chosen} is read; --vehicle chooses another"


def liquid_words(
    estimates: list[Mapping[str, Any]], differing: list[Mapping[str, Any]]
) -> Iterator[str]:
    """Yield a line for each estimate of the liquid, and for each pair of estimates that disagree.

    `estimates` are `Liquid` as dicts; `differing` are all pairs, as `differences` returns them.
    """
    for one in estimates:
        half_width = f" ± {number(one['within_kg'], 'kg')}" if one["within_kg"] else ""
        yield f"by {one['by']}: {number(one['kg'], 'kg')}{half_width} ({one['source']})"
    for two in differing:
        first, second = two["between"]
        if not two["agree"]:
            difference = number(abs(two["difference_kg"]), "kg")
            order = (second, first) if two["difference_kg"] > 0.0 else (first, second)
            yield f"{order[0]} shows {difference} more than {order[1]}: find out which is wrong"


def missing_words(rules: list[Mapping[str, Any]]) -> Iterator[str]:
    """Yield a line for each item that a rule requires and the record lacks, and for a late record.

    `rules` is the list "rules" of `JobRecord.as_json`.
    """
    for rule in rules:
        for item in rule["missing"]:
            lacking = ", ".join(TITLES.get(name, name) for name in item["fields"])
            when = f"; due where {item['when']}" if item["when"] else ""
            yield f"{rule['title']}: {item['asks']} (missing: {lacking}{when})"
        if rule["late"]:
            yield f"{rule['title']}: the record was due {rule['due_utc']}"
