"""Reported flights of one log to an MCAP file, with the schema of every message in it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from thrustmargin.gcs_plugin.reports.margin.data import SCHEMA, FlightReport
from thrustmargin.gcs_plugin.reports.shared.page_shell import software_version
from thrustmargin.gcs_plugin.reports.streams.topics import TOPICS, messages_of, sortie_clock
from thrustmargin.gcs_plugin.telemetry.recording import FlightLog
from thrustmargin.models.errors import DataError, require
from thrustmargin.models.whole_file import whole_file


def write_mcap(flights: Sequence[tuple[FlightReport, FlightLog]], path: Path) -> int:
    """Write the sorties of one log to `path`; returns how many messages that are.

    Each message is JSON, each topic has its JSON schema. Raises DataError when the sorties have
    different clocks, InstallError without the library, OSError when `path` cannot be written.
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
