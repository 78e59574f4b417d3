"""Build the record of a job as data: fields with value, unit and source, and the laws' demands."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, tzinfo
from enum import StrEnum
from functools import cache, partial
from importlib import resources
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.office.record.applied import Applied, Liquid, differences
from thrustmargin.gcs_plugin.reports.shared import UnusedLog
from thrustmargin.gcs_plugin.reports.shared.page_shell import software_version, utc_text
from thrustmargin.gcs_plugin.telemetry.recording import FlightLog
from thrustmargin.gcs_plugin.wording.check_words import in_english
from thrustmargin.mission.outline import FieldOutline
from thrustmargin.models.errors import DataError
from thrustmargin.models.json_values import to_json_values
from thrustmargin.models.provenance import Meaning, SourceKind


@dataclass(frozen=True, slots=True)
class RuleItem:
    """An item that a rule requires: its words, the fields that answer it, and its condition."""

    asks: str
    fields: Sequence[str]
    when: str = ""  # condition under which it is required, in words; empty: always


@dataclass(frozen=True, slots=True)
class JobRule:
    """A country's rule: its title, items, how long the record must be stored, and when it is
    due."""

    name: str
    title: str
    keep: str
    items: tuple[RuleItem, ...]
    due_hours: int | None = None


@cache
def job_rules() -> Mapping[str, JobRule]:
    """Return the rules of rules.toml by name."""
    text = (resources.files(__package__ or "") / "rules.toml").read_text("utf-8")
    rules = {}
    for name, rule in tomllib.loads(text).items():
        items = tuple(RuleItem(**item) for item in rule.pop("items"))
        rules[name] = JobRule(name=name, items=items, **rule)
    return rules


def open_items(rule: JobRule, known: Collection[str]) -> list[dict[str, Any]]:
    """Return a dict for each item of the rule for which at least one field is missing.

    `known` are the names of the fields that the record has. Keys: `asks`, the item in words;
    `fields`, its missing fields; `when`, the condition in words under which it is required (empty:
    always).
    """
    return [
        {"asks": item.asks, "fields": lacking, "when": item.when}
        for item in rule.items
        if (lacking := [name for name in item.fields if name not in known])
    ]


def due_utc(rule: JobRule, finished: datetime | None) -> datetime | None:
    """Return when the record is due; None if the rule sets no time or the finish is unknown."""
    if rule.due_hours is None or finished is None:
        return None
    return finished + timedelta(hours=rule.due_hours)


def required_fields(rules: Sequence[JobRule]) -> tuple[str, ...]:
    """Return the fields that the rules require unconditionally, each once, in their order."""
    required = [f for rule in rules for item in rule.items if not item.when for f in item.fields]
    return tuple(dict.fromkeys(required))


SCHEMA = "thrustmargin.record/1"
HECTARE = 10_000.0  # m²


class EntrySource(StrEnum):
    """The source of a field of the record."""

    OPTION = "option"  # of the command line
    TERMINAL = "terminal"  # answered there
    LOG = "log"
    COMPUTED = "computed"  # from other fields
    FILE = "file"  # of the field's outline
    COMPUTER = "computer"  # its clock and time zone
    FORECAST = "forecast"
    STATION = "weather station"


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """A known field of the record: its value, unit and source."""

    value: Any
    unit: str = ""
    source: EntrySource
    detail: str = ""  # the option, message or method


_log_entry = partial(Entry, source=EntrySource.LOG)
_computed_entry = partial(Entry, source=EntrySource.COMPUTED)


@dataclass(frozen=True, slots=True, kw_only=True)
class JobRecord:
    """The record of one job; a field that is missing from `fields` is unknown."""

    made_utc: str
    fields: Mapping[str, Entry]
    liquid: tuple[Liquid, ...]
    rules: tuple[JobRule, ...]
    logs: tuple[str, ...]
    left_out: tuple[UnusedLog, ...] = ()  # unused logs and vehicles, and why
    finished: datetime | None

    def as_json(self) -> dict[str, Any]:
        """Return the record as a dict for JSON, schema "thrustmargin.record/1".

        Keys: `made_utc`, `version`, `logs`, `left_out` (unused logs), `fields` (name to entry),
        `liquid` (`estimates`, `differences`) and `rules`. Each rule states when the record is due
        (None if unknown), if it is `late`, and the items that lack fields as `missing`.
        """
        return {
            "schema": SCHEMA,
            "made_utc": self.made_utc,
            "version": software_version(),
            "logs": list(self.logs),
            "left_out": to_json_values(self.left_out),
            "fields": {name: to_json_values(entry) for name, entry in self.fields.items()},
            "liquid": {
                "estimates": to_json_values(self.liquid),
                "differences": differences(self.liquid),
            },
            "rules": [
                {
                    "rule": rule.name,
                    "title": rule.title,
                    "keep": rule.keep,
                    "due_utc": due and utc_text(due),
                    "late": due is not None and datetime.fromisoformat(self.made_utc) > due,
                    "missing": open_items(rule, self.fields.keys()),
                }
                for rule in self.rules
                for due in [due_utc(rule, self.finished)]
            ],
        }


def log_entries(
    logs: Sequence[FlightLog], done: Applied | None, zone: tzinfo | None
) -> dict[str, Entry]:
    """Return the record's fields that logs contain, by name: times, place, wind, temperature, area.

    Areas are in ha. `done` is the treated area, None if no pump was on; then only temperature and
    serial number remain. Local times are in `zone`, or in this computer's zone if None, and include
    the offset.
    """
    entries: dict[str, Entry] = {}
    if done is not None and done.start_unix_s is not None and done.end_unix_s is not None:
        words = f"pump on: {in_english(done.pump)}"
        first, last = (datetime.fromtimestamp(s, UTC) for s in (done.start_unix_s, done.end_unix_s))
        for name, when in (("start", first), ("finish", last)):
            local = when.astimezone(zone)
            time_source = EntrySource.COMPUTER if zone is None else EntrySource.OPTION
            whose = "zone of this computer" if zone is None else f"option --zone {zone}"
            entries[name] = _log_entry(value=utc_text(when), detail=words)
            stamp = local.isoformat(timespec="seconds")
            entries[f"{name}_local"] = Entry(value=stamp, source=time_source, detail=whose)
        days = [when.astimezone(zone).date().isoformat() for when in (first, last)]
        day = " to ".join(dict.fromkeys(days))
        entries["date"] = _log_entry(value=day, detail=f"of start_local and finish_local; {words}")
    if done is not None and np.isfinite(done.area):
        how = "spacing of the lines" if done.swath_from_lines else "option --swath"
        kind = EntrySource.LOG if done.swath_from_lines else EntrySource.OPTION
        entries["swath"] = Entry(value=done.field.swath_width, unit="m", source=kind, detail=how)
        how = "track with the pump on by the swath; overlaps count once"
        name = "area"
        if not done.field.whole:
            name, lost = "area_at_least", f"{done.field.lost_s:.0f} of {done.field.sprayed_s:.0f} s"
            how += f"; no place or no word of the pump is known of {lost}"
        entries[name] = _computed_entry(value=done.area / HECTARE, unit="ha", detail=how)
    if done is not None and done.inside is not None:
        entries["location"] = _log_entry(
            value="{:.6f}, {:.6f}".format(*done.inside),
            unit="° latitude, longitude, WGS 84",
            detail="a point of the area treated; its outline: applied.geojson",
        )
    if (wind := _wind(logs, done)) is not None:
        entries["wind"] = wind
    if (air := _temperature(logs)) is not None:
        entries["temperature"] = air
    serials = sorted({log.hardware_id for log in logs if log.hardware_id})
    if serials:
        detail = "of the autopilot, not of the aircraft"
        entries["autopilot_serial"] = _log_entry(value=", ".join(serials), detail=detail)
    return entries


def _wind(logs: Sequence[FlightLog], done: Applied | None) -> Entry | None:
    """Return one entry with the autopilot's wind, m/s: mean, direction it comes from, and maximum.

    Only rows in flight with the pump on count. None without such rows, or without a wind estimate
    in them.
    """
    if done is None:
        return None
    parts = [log.track.wind_ned[(log.track.spraying > 0.5) & log.track.flying, :2] for log in logs]
    wind = np.concatenate(parts)
    wind = wind[np.all(np.isfinite(wind), axis=1)]
    if not wind.size:
        return None
    north, east = wind.mean(axis=0)
    most = float(np.hypot(*wind.T).max())
    comes = float(np.degrees(np.arctan2(-east, -north)) % 360.0)
    return _log_entry(
        value=f"{np.hypot(north, east):.1f} from {comes:.0f}°, at most {most:.1f}",
        unit="m/s",
        detail=f"estimated in flight: {in_english(logs[0].track.source('wind_ned'))}",
    )


def _temperature(logs: Sequence[FlightLog]) -> Entry | None:
    """Return an entry with the median outside air temperature in flight, °C, of the first log with
    one.

    None without an outside sensor: the temperature of the autopilot's board is not used.
    """
    for log in logs:
        source = log.track.source("temperature")
        outside = source.kind is not SourceKind.ABSENT and source.meaning is Meaning.AS_NAMED
        kelvin = log.track.temperature[log.track.flying]
        kelvin = kelvin[np.isfinite(kelvin)]
        if outside and kelvin.size:
            celsius = float(np.median(kelvin)) - 273.15
            return _log_entry(value=round(celsius, 1), unit="°C", detail=in_english(source))
    return None


def field_entries(outline: FieldOutline, done: Applied | None) -> dict[str, Entry]:
    """Return entries `field_area`, and `area_outside_field` if the treated ground is known, both
    ha.

    `outline` is the field, `done` the treated area, None if no pump was on. Raises DataError if no
    treated ground is in the field, which is then that of another job.
    """
    detail = outline.name
    entries = {
        "field_area": Entry(
            value=outline.area.area / HECTARE, unit="ha", source=EntrySource.FILE, detail=detail
        )
    }
    if done is not None and done.ground is not None:
        ground = outline.plane.to_plane(done.ground)
        if not ground.is_empty and not ground.intersects(outline.area):
            raise DataError(
                f"--field {outline.name}: nothing in it was sprayed; give the field of this job"
            )
        outside = ground.difference(outline.area).area / HECTARE
        how = "outline of the area treated, less the field"
        entries["area_outside_field"] = _computed_entry(value=outside, unit="ha", detail=how)
    return entries


ACRE = 4046.8564224  # m²
#: A dose: a number without a thousands separator, a unit, and a unit of area.
DOSE = re.compile(
    r"\s*([0-9]{1,6}(?:[.,][0-9]{1,6})?)\s*(L|l|ml|mL|kg|g|gal|qt|pt|fl oz|lb|oz)\s*/"
    r"\s*(ha|ac|acre)\s*"
)
THOUSANDS = re.compile(r"\s*[1-9][0-9]{0,2},[0-9]{3}[^0-9]")


def product_entries(rate: str, area_ha: float | None) -> dict[str, Entry]:
    """Return an entry with the product's quantity: the dose `rate` times the treated area,
    `area_ha`.

    `rate` is text such as `1.5 L/ha` or `8 fl oz/ac`. Empty if `area_ha` is None. Raises DataError
    for another text, and for a comma that could separate thousands or decimals.
    """
    match = DOSE.fullmatch(rate)
    if match is None or not (dose := float(match[1].replace(",", "."))) > 0.0:
        raise DataError(f"--rate {rate!r:.40} is no dose; give one such as 1.5 L/ha or 8 fl oz/ac")
    if THOUSANDS.match(rate):
        raise DataError(
            f"--rate {rate!r:.40}: is its comma between thousands? Write it without, or with a "
            "point for a fraction"
        )
    if area_ha is None:
        return {}
    amount = dose * (area_ha if match[3] == "ha" else area_ha * HECTARE / ACRE)
    detail = f"{dose:g} {match[2]}/{match[3]} as stated, by the area treated"
    return {"product_quantity": _computed_entry(value=amount, unit=match[2], detail=detail)}


def liquid_entries(
    estimates: Sequence[Liquid], density: float | None, area_ha: float | None
) -> dict[str, Entry]:
    """Return entries of the sprayed liquid: `quantity_kg`, `quantity`, L, and `spray_volume`, L/ha,
    if `area_ha` is known.

    They are by the first of `estimates`, which are sorted with the most direct first. `density` is
    kg/L; if None, `quantity` is in kg and `spray_volume` is missing. Empty without an estimate.
    """
    if not estimates:
        return {}
    first = estimates[0]
    detail = f"by {first.by}: {first.source}"
    entries = {"quantity_kg": _log_entry(value=first.kg, unit="kg", detail=detail)}
    if density is None:
        return {**entries, "quantity": entries["quantity_kg"]}
    litres = first.kg / density
    entries["quantity"] = _computed_entry(
        value=litres, unit="L", detail=f"{detail}; {density:g} kg/L"
    )
    if area_ha:
        basis = "quantity over area"
        entries["spray_volume"] = _computed_entry(value=litres / area_ha, unit="L/ha", detail=basis)
    return entries
