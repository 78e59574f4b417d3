"""Flights without who and where: for a report or a store that others may see.

Gone are the names of logs and of the aircraft, serial numbers and system ids, the autopilot's
texts, the mission, and the place on the globe: north and east begin at 0, and there is no altitude.
What is left is what a margin rests on: times, air pressure, the airframe's name, the route's shape.
"""

from __future__ import annotations

import hmac
import os
import secrets
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np

from thrustmargin.gcs_plugin.logs import FlightLog
from thrustmargin.models.errors import DataError
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.prediction_error import trained_on
from thrustmargin.models.statement import Statement, Value
from thrustmargin.models.whole_file import regular, whole_file


def anonymous(
    analysis: FlightAnalysis, log: FlightLog, name: str
) -> tuple[FlightAnalysis, FlightLog]:
    """Return a flight with its log's name replaced by `name`, and without what identifies it.

    Texts, serial numbers, parameters, missions and ids are removed; positions are relative to the
    first known one, and altitudes NaN. Margins are unchanged.
    """
    track, model, domain = analysis.track, analysis.model, analysis.model.training_domain
    placed = np.all(np.isfinite(track.position_ned), axis=1)
    start = track.position_ned[np.argmax(placed)] if placed.any() else np.zeros(3)
    track = replace(
        track,
        name=name,
        origin=None,
        position_ned=track.position_ned - start,
        altitude=np.full(track.time_s.size, np.nan),
        notes=tuple(_without_name(note, log.path.name) for note in track.notes),
        statements=tuple(_without_name(one, log.path.name) for one in track.statements),
    )
    if domain is not None:  # that the model has seen this flight must still be known
        domain = replace(domain, flights=(name,) if trained_on(analysis) else ())
    airframe_match = analysis.airframe_match
    reasons = tuple(_without_name(reason, log.path.name) for reason in airframe_match.no_verdict)
    analysis = replace(
        analysis,
        track=track,
        model=replace(model, training_domain=domain),
        airframe_match=replace(
            airframe_match,
            no_verdict=reasons,
            unlike=None
            if airframe_match.unlike is None
            else _without_name(airframe_match.unlike, log.path.name),
            source="LOG",
        ),
    )
    events = tuple(replace(event, text="") for event in log.events)
    hidden = {
        "messages": (),
        "engineer_notes": (),
        "events": events,
        "waypoints": (),
        "parameters": {},
        "hardware_id": "",
        "firmware": "",
    }
    return analysis, replace(log, track=track, path=Path(name), vehicle=0, vehicles=(0,), **hidden)


def without_name(text: str, name: str) -> str:
    """Replace a log's `name`, and the same without its ending, by "the log" in a text."""
    return text.replace(name, "the log").replace(Path(name).stem, "the log")


def _without_name(one: Statement, name: str) -> Statement:
    """Return the statement with the log's name `name` replaced by "the log" in all its texts.

    Statements nested in it are changed too.
    """

    def cleaned(value: Value) -> Value:
        if isinstance(value, Statement):
            return _without_name(value, name)
        if isinstance(value, tuple):
            return tuple(_without_name(part, name) for part in value)
        return without_name(value, name) if isinstance(value, str) else value

    return replace(one, values=tuple((key, cleaned(value)) for key, value in one.values))


def pseudonym(key: str, text: str) -> str:
    """Return 16 hexadecimal digits that stand for a text; without the key they do not reveal it."""
    return hmac.new(bytes.fromhex(key), text.encode(), sha256).hexdigest()[:16]


def key_file() -> Path:
    """Return the path of this user's key of pseudonyms."""
    base = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(base) / "thrustmargin" / "anonymise.key"


def own_key() -> str:
    """Return the user's secret key, 64 hex digits, which pseudonyms are made with.

    With one key an aircraft has one pseudonym in every run. A random key is written if there is
    none. Raises DataError if the file contains no key.
    """
    path = key_file()
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as draft:
            draft.touch(0o600)
            draft.write_text(secrets.token_hex(32) + "\n", encoding="utf-8")
    key = ""
    try:
        key = regular(path).read_text(encoding="utf-8").strip()
        known = len(bytes.fromhex(key)) == 32
    except (OSError, ValueError):
        known = False
    if not known:
        raise DataError(f"{path} is no key of pseudonyms; move it away and a new one is made")
    return key
