"""Write the reported flights of one log as an MCAP file, and a Foxglove layout that shows it.

Each topic has a name, a JSON schema and messages. Unknown numbers are null, as in the report's
JSON. `time_s` counts from the sortie's first row. Times of messages are Unix time, in ns; where the
log has no date, they are the vehicle's time since boot.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from thrustmargin.gcs_plugin.logs.findings import Severity
from thrustmargin.gcs_plugin.reports.margin.csv_rows import COLUMNS
from thrustmargin.gcs_plugin.reports.margin.data import FLIGHT_KEYS, SCHEMA, ReportedFlight
from thrustmargin.gcs_plugin.reports.shared.page_shell import software_version
from thrustmargin.gcs_plugin.telemetry.recording import FlightLog
from thrustmargin.models.errors import DataError, require
from thrustmargin.models.flight import Floats
from thrustmargin.models.json_values import to_json_values
from thrustmargin.models.model.analysis import SpeedBasis, worst_rotor
from thrustmargin.models.whole_file import whole_file

#: Columns of the report's rows with one value for the vehicle -> their unit.
PLAIN = {name: unit for name, unit, _ in COLUMNS if not name.endswith("_{}")}
#: Columns of the report's rows with a value for each rotor, by their key in a message -> unit.
OF_ROTOR = {name.removesuffix("_{}"): unit for name, unit, _ in COLUMNS if name.endswith("_{}")}
#: Severity of a finding -> Foxglove's level of a log line.
_LOG_LEVEL = {Severity.GRAVE: 5, Severity.WARNING: 3, Severity.UNKNOWN: 2, Severity.OK: 2}


def _typed(kind: str | list[str], words: str) -> dict[str, Any]:
    """Return the JSON schema of a value of type `kind`, with its description."""
    return {"type": kind, "description": words}


_number, _text = partial(_typed, ["number", "null"]), partial(_typed, "string")


def _object(title: str, **properties: Any) -> dict[str, Any]:
    """Return the JSON schema of an object with these properties."""
    return {"title": title, "type": "object", "properties": properties}


_COUNT = {"type": "integer"}
_TIME = {"time_s": _number("s from the sortie's first row"), "sortie": _COUNT}
_STAMP = {"timestamp": _object("time", sec=_COUNT, nsec=_COUNT)}
_ROTOR = _object(
    "rotor",
    rotor=_typed("integer", "from 1, in the autopilot's motor order"),
    name=_text("where it is, seen from above"),
    **{key: _number(unit) for key, unit in OF_ROTOR.items()},
    margin=_number("share of its maximum thrust that is left; null on the ground"),
    margin_low=_number("low end of the 90 % interval"),
    margin_high=_number("high end of the 90 % interval"),
)
#: Topic -> its schema's name, and the JSON schema of its messages.
TOPICS: Mapping[str, tuple[str, dict[str, Any]]] = {
    "/report": (
        "thrustmargin.FlightReport",
        _object(
            "a flight of the report's JSON, once at its start",
            **{name: {} for name in FLIGHT_KEYS},
        ),
    ),
    "/margin": (
        "thrustmargin.Margin",
        _object(
            "margin of the worst rotor that is known",
            **_TIME,
            rotor=_typed(["integer", "null"], "from 1"),
            margin=_number("1; share of its maximum thrust that is left"),
            low=_number("1; low end of the 90 % interval"),
            high=_number("1; high end of the 90 % interval"),
            least=_number("1; least margin of the limit that the report is made with"),
            basis=_text("its speed is measured, from motor outputs, predicted or unknown"),
        ),
    ),
    "/rotors": (
        "thrustmargin.Rotors",
        _object("every rotor", **_TIME, rotors={"type": "array", "items": _ROTOR}),
    ),
    "/flight": (
        "thrustmargin.Flight",
        _object(
            "channels of the flight",
            sortie=_COUNT,
            **{name: _number(unit) for name, unit in PLAIN.items()},
        ),
    ),
    "/position": (
        "foxglove.LocationFix",
        _object(
            "where it is, WGS 84",
            **_STAMP,
            frame_id=_text("the vehicle"),
            latitude=_number("°"),
            longitude=_number("°"),
            altitude=_number("m above the sea"),
            position_covariance_type=_typed("integer", "0: not known"),
            position_covariance={"type": "array", "items": {"type": "number"}},
        ),
    ),
    "/findings": (
        "thrustmargin.Finding",
        _object(
            "a finding of `inspect`; one without a time is of the whole sortie, at its start",
            **_TIME,
            check=_text("what was checked"),
            level=_text("grave, warning, unknown or ok"),
            words=_text("what was found"),
            values=_typed("object", "its numbers by name"),
            spoils=_text("what it makes wrong in the answers"),
        ),
    ),
    "/log": (
        "foxglove.Log",
        _object(
            "texts of the vehicle, and the findings",
            **_STAMP,
            level=_typed("integer", "2 info, 3 warning, 5 fatal"),
            message=_text("as it was sent, or the finding in words"),
            name=_text("vehicle or the finding's check"),
            file=_text("of the log"),
            line=_COUNT,
        ),
    ),
}


class StreamMessage(NamedTuple):
    """A message: its topic, s from the sortie's first row, and its content."""

    topic: str
    time_s: float
    content: dict[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class SortieClock:
    """The clock of one sortie, which converts its times to those of the file."""

    start_s: float
    unix: bool

    def stamp_ns(self, time_s: float) -> int:
        """Return the timestamp, ns, of a time in s from the sortie's first row.

        It is limited to 0 and the largest that the format holds, 64 bits.
        """
        return min(max(round((self.start_s + time_s) * 1e9), 0), 2**64 - 1)


def sortie_clock(log: FlightLog) -> SortieClock:
    """Return the sortie's clock: Unix time if the log has it, else the vehicle's time since
    boot."""
    unix = log.track.start_unix_s
    return SortieClock(start_s=log.clock_start_s if unix is None else unix, unix=unix is not None)


def messages_of(report: ReportedFlight, log: FlightLog) -> Iterator[StreamMessage]:
    """Yield the MCAP messages of a sortie, one topic after the other, not sorted by time.

    They are the report, margin, rotors, rows, position, findings and log lines.
    """
    sortie, clock, rows = log.sortie, sortie_clock(log), report.rows
    first = float(rows["time_s"][0])
    yield StreamMessage("/report", first, to_json_values(report.json))
    yield from _margin_messages(report, sortie)
    yield from _rotor_messages(report, sortie)
    scalars = {name: _nulls(rows[name]) for name in PLAIN}
    for k, time_s in enumerate(rows["time_s"].tolist()):
        of_row = {name: values[k] for name, values in scalars.items()}
        yield StreamMessage("/flight", time_s, {**of_row, "sortie": sortie})
    yield from _position_messages(log, clock)
    for finding in report.json["findings"]:
        time_s = first if finding.time_s is None else finding.time_s
        content = {**to_json_values(finding), "sortie": sortie}
        yield StreamMessage("/findings", time_s, content)
        level = _LOG_LEVEL[finding.level]
        yield _log_message(log, clock, time_s, level, finding.check, finding.words)
    for time_s, words in log.messages:
        yield _log_message(log, clock, time_s, _LOG_LEVEL[Severity.OK], "vehicle", words)


def _nulls(values: Floats) -> list[Any]:
    """Return numbers as lists, with None for NaN and infinity."""
    nulls = values.astype(object)
    nulls[~np.isfinite(values)] = None
    return nulls.tolist()


def _margin_band(report: ReportedFlight) -> tuple[Floats, Floats, Floats]:
    """Return the margin (T, R) by the known utilisation in flight, and both ends of its 90 %
    interval."""
    rows = report.rows
    flying = rows["flying"][:, None] > 0.0
    names = ("known_utilisation", "utilisation_high", "utilisation_low")
    use, high, low = (np.where(flying, rows[name], np.nan) for name in names)
    return 1.0 - use, 1.0 - high, 1.0 - low


def _margin_messages(report: ReportedFlight, sortie: int) -> Iterator[StreamMessage]:
    """Yield a message at each time step with the worst rotor's margin, its interval and its basis.

    Shares of thrust; None where no rotor has a margin. `sortie` is the number that each message
    states.
    """
    rows = report.rows
    margin, low, high = _margin_band(report)
    _, worst = worst_rotor(1.0 - margin)
    measured, outputs = (
        np.isfinite(rows[name]) for name in ("utilisation", "utilisation_from_outputs")
    )
    for k, time_s in enumerate(rows["time_s"].tolist()):
        content: dict[str, Any] = dict.fromkeys(("rotor", "margin", "low", "high"))
        basis = SpeedBasis.UNKNOWN
        if np.isfinite(worst[k]):
            rotor = int(worst[k])
            figures = {"margin": margin, "low": low, "high": high}
            content = {key: _nulls(f[k : k + 1, rotor])[0] for key, f in figures.items()}
            content["rotor"] = rotor + 1
            basis = SpeedBasis.PREDICTED
            if measured[k, rotor]:
                basis = SpeedBasis.MEASURED
            elif outputs[k, rotor]:
                basis = SpeedBasis.MOTOR_OUTPUTS
        least = 1.0 - report.advice.limit
        content |= {"least": least, "basis": str(basis) or "unknown"}
        yield StreamMessage("/margin", time_s, {"time_s": time_s, "sortie": sortie, **content})


def _rotor_messages(report: ReportedFlight, sortie: int) -> Iterator[StreamMessage]:
    """Yield a message at each time step with a list of all rotors' values; None where unknown.

    `sortie` is the number that each message states.
    """
    rows, names = report.rows, report.json["model"]["rotor_names"]
    columns = {key: _nulls(rows[key]) for key in OF_ROTOR}
    bands = zip(("margin", "margin_low", "margin_high"), _margin_band(report), strict=True)
    columns |= {key: _nulls(values) for key, values in bands}
    count = rows["known_utilisation"].shape[1]
    heads = [{"rotor": r + 1, "name": names[r] if r < len(names) else ""} for r in range(count)]
    for k, time_s in enumerate(rows["time_s"].tolist()):
        rotors = [
            {**head, **{key: values[k][r] for key, values in columns.items()}}
            for r, head in enumerate(heads)
        ]
        yield StreamMessage(
            "/rotors", time_s, {"time_s": time_s, "sortie": sortie, "rotors": rotors}
        )


def _position_messages(log: FlightLog, clock: SortieClock) -> Iterator[StreamMessage]:
    """Yield latitude, longitude, degrees, and altitude, m, at each time step with a known position.

    Nothing if the track has no geographic origin.
    """
    track = log.track
    if track.origin is None:
        return
    known = np.all(np.isfinite(track.position_ned), axis=1)
    places = track.origin.geodetic(track.position_ned[known])
    for time_s, place in zip(track.time_s[known].tolist(), places.tolist(), strict=True):
        content = {
            "timestamp": _timestamp(clock.stamp_ns(time_s)),
            "frame_id": f"vehicle {log.vehicle}",
            **dict(zip(("latitude", "longitude", "altitude"), place, strict=True)),
            "position_covariance_type": 0,
            "position_covariance": [0.0] * 9,
        }
        yield StreamMessage("/position", time_s, content)


def _log_message(
    log: FlightLog, clock: SortieClock, time_s: float, level: int, name: str, words: str
) -> StreamMessage:
    """Return a line for the viewer's log: `words`, with the sender `name` and the Foxglove `level`.

    `time_s` is the time from the sortie's first row, s; `clock` converts it to a timestamp.
    """
    content = {
        "timestamp": _timestamp(clock.stamp_ns(time_s)),
        "level": level,
        "message": words,
        "name": name,
        "file": log.path.name,
        "line": 0,
    }
    return StreamMessage("/log", time_s, content)


def _timestamp(stamp_ns: int) -> dict[str, int]:
    """Return a time in ns as Foxglove's seconds and nanoseconds."""
    return {"sec": stamp_ns // 1_000_000_000, "nsec": stamp_ns % 1_000_000_000}


def layout_text(rotor_names: Sequence[str]) -> str:
    """Return a Foxglove layout as JSON, with lines for each rotor; load it by "Import from file".

    `rotor_names` are the rotors' places; an empty one is replaced by the rotor's number.
    """
    rotors = range(len(rotor_names))
    rotor_names = [name or f"rotor {r + 1}" for r, name in enumerate(rotor_names)]
    panels: dict[str, dict[str, Any]] = {
        "Plot!margin": _plot(
            "Thrust left at the worst rotor, 90 % interval",
            [
                ("/margin.margin", "thrust left"),
                ("/margin.low", "low"),
                ("/margin.high", "high"),
                ("/margin.least", "least"),
            ],
        ),
        "Plot!use": _plot(
            "Thrust in use", [(f"/rotors.rotors[{r}].utilisation", rotor_names[r]) for r in rotors]
        ),
        "Plot!speeds": _plot(
            "Rotor speed, measured and predicted",
            [
                (f"/rotors.rotors[{r}].{key}", f"{rotor_names[r]} {caption}")
                for r in rotors
                for key, caption in (
                    ("rotor_speed_rpm", "measured"),
                    ("rotor_speed_predicted_rpm", "predicted"),
                )
            ],
        ),
        "Plot!load": _plot(
            "Liquid and battery", [("/flight.tank_kg", "tank, kg"), ("/flight.voltage", "V")]
        ),
        "map!position": {"enabledTopics": {"/position": True}, "topicColors": {}},
        "Log!log": {"topicToRender": "/log", "minLogLevel": 1, "searchTerms": []},
        "RawMessages!findings": {"topicPath": "/findings", "diffEnabled": False},
        "RawMessages!report": {"topicPath": "/report.verdict", "diffEnabled": False},
    }
    whole = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _split(
            "row",
            _split("column", "Plot!margin", _split("column", "Plot!use", "Plot!speeds")),
            _split(
                "column",
                _split("row", "map!position", "Plot!load"),
                _split(
                    "row", "Log!log", _split("column", "RawMessages!report", "RawMessages!findings")
                ),
            ),
        ),
    }
    return json.dumps(whole, indent=1, ensure_ascii=False) + "\n"


def _plot(title: str, paths: Sequence[tuple[str, str]]) -> dict[str, Any]:
    """Return a Foxglove plot panel with one line for each (message path, label) in `paths`."""
    return {
        "title": title,
        "paths": [
            {
                "value": path,
                "label": label,
                "enabled": True,
                "timestampMethod": "receiveTime",
                "showLine": True,
            }
            for path, label in paths
        ],
        "xAxisVal": "timestamp",
        "showLegend": True,
        "legendDisplay": "floating",
        "isSynced": True,
        "showXAxisLabels": True,
        "showYAxisLabels": True,
    }


def _split(direction: str, first: Any, second: Any) -> dict[str, Any]:
    """Return a Foxglove layout node that halves its area, as a "row" or "column"."""
    return {"direction": direction, "first": first, "second": second, "splitPercentage": 50}


def write_mcap(flights: Sequence[tuple[ReportedFlight, FlightLog]], path: Path) -> int:
    """Write the sorties of one log to the MCAP file `path` and return the number of messages.

    Messages are JSON, sorted by time; each topic has a JSON schema. Raises DataError if only some
    sorties have Unix time, InstallError if the mcap library is missing, OSError if `path` cannot be
    written.
    """
    require("export --mcap", "mcap")
    from mcap.writer import Writer

    clocks = {sortie_clock(log).unix for _, log in flights}
    if len(clocks) > 1:
        raise DataError(
            f"{flights[0][1].path.name}: the date is known of some of its sorties only; they "
            "cannot share one file"
        )
    messages = sorted(
        (
            (sortie_clock(log).stamp_ns(message.time_s), message)
            for report, log in flights
            for message in messages_of(report, log)
        ),
        key=lambda stamped: stamped[0],
    )
    with whole_file(path) as draft, draft.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="", library=f"thrustmargin {software_version()}")
        channels = {}
        for topic, (name, schema) in TOPICS.items():
            kind = writer.register_schema(
                name=name, encoding="jsonschema", data=json.dumps(schema).encode()
            )
            channels[topic] = writer.register_channel(
                topic=topic, message_encoding="json", schema_id=kind
            )
        for stamp_ns, message in messages:
            text = json.dumps(message.content, ensure_ascii=False, allow_nan=False)
            writer.add_message(
                channel_id=channels[message.topic],
                log_time=stamp_ns,
                publish_time=stamp_ns,
                data=text.encode("utf-8", "replace"),
            )
        writer.add_metadata(
            name="thrustmargin",
            data={
                "report_schema": SCHEMA,
                "version": software_version(),
                "log": flights[0][1].path.name.encode("utf-8", "replace").decode(),
                "clock": "Unix" if clocks == {True} else "vehicle since boot",
            },
        )
        writer.finish()
    return len(messages)
