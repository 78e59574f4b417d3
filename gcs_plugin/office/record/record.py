"""`thrustmargin record`: write the record of a spraying job from its logs and from statements."""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass
from datetime import datetime, tzinfo
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from tyro.conf import Positional, UseAppendAction

from thrustmargin.gcs_plugin.commands.shared.inputs import (
    ANY_KNOWN,
    AS_HEARD,
    Inputs,
    Known,
    Reading,
)
from thrustmargin.gcs_plugin.commands.shared.log_flights import analysed_flights
from thrustmargin.gcs_plugin.commands.shared.options import UsageError, require_logs
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
from thrustmargin.gcs_plugin.reports.shared.page_shell import utc_text
from thrustmargin.models.errors import DataError, LogError

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.logs import FlightLog
    from thrustmargin.gcs_plugin.office.record.applied import Liquid
    from thrustmargin.gcs_plugin.office.record.job_record import Entry
    from thrustmargin.gcs_plugin.reports.shared import UnusedLog
    from thrustmargin.models.model.analysis import FlightAnalysis


@dataclass(frozen=True, slots=True, kw_only=True)
class JobStatement:
    """Statements about the job that no log contains; None where nothing is stated."""

    product: str | None = None
    """Full name of the product."""
    registration: str | None = None
    """Registration or authorisation number of the product."""
    active: str | None = None
    """Its active constituents."""
    rate: str | None = None
    """Dose with its unit, such as "1.5 L/ha" or "0.2 kg/ha"."""
    crop: str | None = None
    """Crop or situation."""
    crop_code: str | None = None
    """EPPO code of the crop."""
    growth_stage: str | None = None
    """Growth stage, BBCH."""
    use_type: str | None = None
    """Type of use, such as area."""
    land_address: str | None = None
    """Address of the land."""
    customer: str | None = None
    """Person for whom it was done: owner or occupier."""
    customer_address: str | None = None
    """Their address."""
    customer_contact: str | None = None
    """Their phone or e-mail."""
    pilot: str | None = None
    """Name of the pilot."""
    pilot_address: str | None = None
    """Their address."""
    pilot_certificate: str | None = None
    """Their certificate number."""
    pilot_skill_date: str | None = None
    """Date on which they passed the knowledge and skill test."""
    aircraft_registration: str | None = None
    """Registration mark of the aircraft."""
    aircraft_serial: str | None = None
    """Serial number of the aircraft."""
    equipment: str | None = None
    """Nozzles and other spray equipment, with what reduces drift."""
    wind: str | None = None
    """Wind, such as "3 m/s from 240"; without it the autopilot's estimate."""
    humidity: str | None = None
    """Relative humidity, %."""
    inversion: str | None = None
    """Temperature inversion: yes or no."""
    permit: str | None = None
    """Number of the approved application plan or permit."""
    planned_start: str | None = None
    """When it was planned to start."""
    flight_authorisation: str | None = None
    """Number of the authorisation to fly."""
    aerial_reason: str | None = None
    """Why not from the ground."""


Statement = Annotated[JobStatement, tyro.conf.OmitArgPrefixes]
NOTHING = JobStatement()
LONGEST = 1000  # letters of a field, at most: a row of the table on paper
_WEATHER = ("wind", "temperature", "humidity", "inversion")


def record(
    logs: Positional[
        Annotated[tuple[Path, ...], tyro.conf.arg(metavar="LOG...", help_behavior_hint="")]
    ],
    *,
    out: Path,
    stated: Statement = NOTHING,
    field: Path | None = None,
    swath: float | None = None,
    weather_source: Literal["stated", "station", "forecast"] = "stated",
    zone: str | None = None,
    rule: UseAppendAction[tuple[Literal["us", "eu", "uk", "nsw"], ...]] = (),
    model: Path | None = None,
    airframe: str | None = None,
    reading: Reading = AS_HEARD,
    known: Known = ANY_KNOWN,
) -> int:
    """Write the record of a spraying job: what, where, how much, when, by whom.

    Each field has its source. On a terminal it asks for what the rules require and nothing states;
    else it is listed as missing. Nothing is guessed.

    Example: thrustmargin record demo --product Water --rate "20 L/ha" --rule nsw --out job

    Args:
        logs: Flights of the job: .tlog, DataFlash .BIN or .log, PX4 .ulg, or .csv; or folders.
        out: Folder for record.json, .csv and .pdf, applied.geojson and applied.shp.
        stated: Of the job, what no log knows.
        field: Outline of the field: KML, KMZ, GeoJSON, shapefile or ISOXML.
        swath: m that a pass treats; without it the spacing of neighbouring lines.
        weather_source: Where the stated weather comes from.
        zone: Zone of local times, such as Europe/Berlin; without it that of this computer.
        rule: us (14 CFR 137.71), eu (2023/564), uk (plan before aerial spraying), nsw (within 48
            hours); may be given again; without it none is checked.
        model: Rotor speed model file of this aircraft; without it, and without an airframe, the one
            that ships is used for a flight that is recognised as one of topxgun-f16-sitl.
        airframe: Name of a shipped airframe, or an airframe file (.toml); without it the
            model's, else that of topxgun-f16-sitl for a flight that is recognised as one of it.
        reading: How the logs are read.
        known: The known aircraft that flew; see `thrustmargin learn`.
    """
    from thrustmargin.gcs_plugin.office.record.applied import applied_swaths
    from thrustmargin.gcs_plugin.office.record.job_record import (
        Entry,
        EntrySource,
        JobRecord,
        field_entries,
        job_rules,
        liquid_entries,
        log_entries,
        product_entries,
        required_fields,
    )
    from thrustmargin.gcs_plugin.office.record.record_files import makes_shapefiles, write_record
    from thrustmargin.gcs_plugin.office.record.record_words import (
        NO_RULE,
        NO_SHAPEFILE,
        liquid_words,
        missing_words,
    )
    from thrustmargin.mission.field_file import read_field
    from thrustmargin.models.errors import install_line

    if swath is not None and not 0.1 <= swath <= 100.0:
        raise UsageError(f"--swath {swath:g} m is not between 0.1 and 100 m")
    local = zone_of(zone)
    given = _stated_fields(stated, reading.air_temperature_c, weather_source)
    if stated.rate is not None:
        product_entries(stated.rate, None)  # before any work is done
    logs = require_logs(logs)
    if out.exists() and not out.is_dir():
        raise DataError(f"{out} is a file; give a folder with --out")
    outline = None if field is None else read_field(field)
    console = Terminal(stderr=True, soft_wrap=True)
    inputs = Inputs(logs=logs, model=model, airframe=airframe, reading=reading, known=known)
    flights, _, unread = analysed_flights(inputs, console)
    flights, left_out = counted_once(flights)
    sorties = [log for _, log in flights]
    done = applied_swaths(sorties, swath)
    amounts = liquids(flights)
    density = common_density(flights)
    fields = log_entries(sorties, done, local)
    area = fields.get("area")
    area_ha = None if area is None else area.value
    fields |= liquid_entries(amounts, density, area_ha)
    if stated.rate is not None:
        fields |= product_entries(stated.rate, area_ha)
    if outline is not None:
        fields |= field_entries(outline, done)
        of_file = EntrySource.FILE
        fields["field"] = Entry(value=outline.name, source=of_file, detail="option --field")
    fields |= given
    # Without a rule none applies: what other countries ask for is no gap of this record.
    rules = [one for name, one in job_rules().items() if name in rule]
    if sys.stdin.isatty():
        for name in required_fields(rules):
            if name in fields or not (answer := _ask(name)):
                continue
            fields[name] = Entry(value=answer, source=EntrySource.TERMINAL)
            if name == "rate":
                fields |= product_entries(answer, area_ha)
    job = JobRecord(
        made_utc=utc_text(),
        fields=fields,
        liquid=tuple(amounts),
        rules=tuple(rules),
        logs=tuple(log.name for log in sorties),
        left_out=(*left_out, *unread),
        finished=_finish_time(fields),
    )
    out.mkdir(parents=True, exist_ok=True)
    written = write_record(job, done, out)
    data, screen = job.as_json(), Terminal(soft_wrap=True)
    for words in liquid_words(data["liquid"]["estimates"], data["liquid"]["differences"]):
        screen.print(f"liquid {words}")
    for words in missing_words(data["rules"]):
        screen.print(f"missing: {words}")
    if not rules:
        screen.print(NO_RULE)
    for one in left_out:
        screen.print(f"left out: {one.name}: {one.reason}")
    for log in unread:
        console.print(f"not read: {log.name}: {log.reason}")
    if done is not None and done.ground is not None and not makes_shapefiles():
        screen.print(NO_SHAPEFILE.format(line=install_line("field")))
    screen.print(f"wrote {', '.join(path.name for path in written)} in {out}")
    return 1 if unread else 0


def zone_of(name: str | None) -> tzinfo | None:
    """Return the time zone called `name`, such as Europe/Berlin; None if `name` is None.

    Raises UsageError for an unknown name.
    """
    import zoneinfo

    if name is None:
        return None
    try:
        return zoneinfo.ZoneInfo(name)
    except (zoneinfo.ZoneInfoNotFoundError, ValueError, OSError) as error:
        raise UsageError(f"--zone {name!r:.40} is none; give one such as Europe/Berlin") from error


def counted_once(
    flights: list[tuple[FlightAnalysis, FlightLog]],
) -> tuple[list[tuple[FlightAnalysis, FlightLog]], list[UnusedLog]]:
    """Return the flights, each from one log only, and what is not used, with the reason.

    Not used are logs of a flight that another log records better, other vehicles in a log, and
    stretches that are no flight or cannot be read. Parts of a flight that its log lacks are listed
    with them.
    """
    from thrustmargin.gcs_plugin.office.record.applied import better_logs
    from thrustmargin.gcs_plugin.office.record.record_words import other_vehicles, same_flight
    from thrustmargin.gcs_plugin.reports.shared import UnusedLog
    from thrustmargin.gcs_plugin.wording.check_words import in_english
    from thrustmargin.gcs_plugin.wording.flight_words import not_flown
    from thrustmargin.gcs_plugin.wording.margin_verdict import unseen_facts

    logs = [log for _, log in flights]
    kept, left_out = [], []
    for flight, log, better in zip(flights, logs, better_logs(logs), strict=True):
        if better is not None:
            left_out.append(UnusedLog(name=log.name, reason=same_flight(logs[better].name)))
            continue
        kept.append(flight)
        others = [one for one in log.vehicles if one != log.vehicle]
        reasons = (other_vehicles(log.vehicle, others),) if others else ()
        reasons = (*reasons, *map(in_english, log.unflown))
        left_out += [UnusedLog(name=log.path.name, reason=reason) for reason in reasons]
        # What the log does not show is not in the record either.
        grounded = not_flown(log.track)
        unseen = (grounded,) if grounded else (text for _, text in unseen_facts(log.track))
        left_out += [UnusedLog(name=log.name, reason=reason) for reason in unseen]
    return kept, list(dict.fromkeys(left_out))


def liquids(flights: list[tuple[FlightAnalysis, FlightLog]]) -> list[Liquid]:
    """Return up to three estimates of the liquid sprayed in all flights: by gauge, pump and thrust.

    An estimate that does not exist for every flight is left out.
    """
    from thrustmargin.gcs_plugin.office.record.applied import (
        gauge_estimate,
        job_estimate,
        pump_estimate,
        thrust_estimate,
    )
    from thrustmargin.models.model.rotor_model import identified_airframe

    known = [not analysis.no_verdict for analysis, _ in flights]
    gauge = [gauge_estimate(log.track) for _, log in flights]
    pump = [pump_estimate(log.track) for _, log in _with_pump_level(flights)] if all(known) else []
    thrust = [
        thrust_estimate(log.track, identified_airframe(analysis.model)) if claimed else None
        for claimed, (analysis, log) in zip(known, flights, strict=True)
    ]
    estimates = (job_estimate(gauge), job_estimate(pump), job_estimate(thrust))
    return [one for one in estimates if one is not None]


def common_density(flights: list[tuple[FlightAnalysis, FlightLog]]) -> float | None:
    """Return the liquid's density, kg/L; None if flights differ in it or an aircraft is unknown."""
    known = {None if a.no_verdict else a.model.airframe.liquid_density for a, _ in flights}
    return known.pop() if len(known) == 1 else None


#: Starting level, kg, larger than any tank, so that the level by pump output never reaches 0.
FULL_KG = 900.0


def _with_pump_level(
    flights: list[tuple[FlightAnalysis, FlightLog]],
) -> list[tuple[FlightAnalysis, FlightLog]]:
    """Read the logs of the flights again, with the tank level computed from the pump's output.

    Empty if one of them cannot be read so.
    """
    from dataclasses import replace

    from thrustmargin.gcs_plugin.logs import read_sorties

    sorties = []
    for analysis, log in flights:
        try:
            reread = read_sorties(
                log.path,
                airframe=analysis.model.airframe,
                vehicle=log.vehicle,
                tank="pump",
                tank_start_kg=FULL_KG,
            )
        except LogError:
            return []
        if len(reread) != log.sorties:
            return []
        sorties.append((analysis, replace(log, track=reread[log.sortie - 1].track)))
    return sorties


def _stated_fields(
    stated: JobStatement, air_temperature_c: float | None, weather: str
) -> dict[str, Entry]:
    """Return the record's entries that the user stated in options, by field name.

    The names are the fields of `stated`, "temperature" for the air temperature, °C, and "aircraft":
    the registration, else the serial number of the aircraft, if one is stated. None and empty texts
    are left out. The source of wind, temperature, humidity and inversion is `weather`: "stated",
    "station" or "forecast"; that of other fields is always the option. Raise UsageError for a text
    of more than LONGEST letters.
    """
    from thrustmargin.gcs_plugin.office.record.job_record import Entry, EntrySource

    sources = {
        "stated": EntrySource.OPTION,
        "station": EntrySource.STATION,
        "forecast": EntrySource.FORECAST,
    }
    by_log = {}
    celsius = None if air_temperature_c is None else f"{air_temperature_c:g}"
    for name, value in (*asdict(stated).items(), ("temperature", celsius)):
        if value is None or not value.strip():
            continue
        source = sources[weather] if name in _WEATHER else EntrySource.OPTION
        option = f"option --{name.replace('_', '-')}".replace("--temp", "--air-temp")
        if len(value) > LONGEST:
            raise UsageError(f"{option} has {len(value)} letters; at most {LONGEST} can be printed")
        unit = "°C" if name == "temperature" else ""
        by_log[name] = Entry(value=value.strip(), unit=unit, source=source, detail=option)
    for name in ("aircraft_registration", "aircraft_serial"):
        if name in by_log:  # a mark comes before a number
            by_log.setdefault("aircraft", by_log[name])
    return by_log


def _ask(name: str) -> str:
    """Ask for the field `name` in the terminal and return the answer; empty if it is not known.

    A dose that cannot be read is asked for again.
    """
    from thrustmargin.gcs_plugin.office.record.job_record import product_entries
    from thrustmargin.gcs_plugin.office.record.record_words import TITLES

    while True:
        try:
            answer = input(f"{TITLES[name]} (Enter: not known): ").strip()[:LONGEST]
            if answer and name == "rate":
                product_entries(answer, None)
        except EOFError:
            return ""
        except DataError as error:  # asked again: what was answered before is not lost
            Terminal(soft_wrap=True).print(str(error))
            continue
        return answer


def _finish_time(fields: dict[str, Entry]) -> datetime | None:
    """Return the time at which the job finished; None if unknown."""
    return datetime.fromisoformat(fields["finish"].value) if "finish" in fields else None
