"""`thrustmargin export`: write a flight as MCAP for Foxglove, and layouts that show it."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional

from thrustmargin.gcs_plugin.commands.shared.inputs import AS_HEARD, Inputs, Reading, Share
from thrustmargin.gcs_plugin.commands.shared.log_flights import analysed_flights
from thrustmargin.gcs_plugin.commands.shared.options import (
    OutputFile,
    UsageError,
    check_outputs,
    require_logs,
)
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal


def export(
    log: Annotated[Positional[Path | None], tyro.conf.arg(metavar="LOG")] = None,
    *,
    mcap: Path | None = None,
    layout: Path | None = None,
    grafana: Path | None = None,
    model: Path | None = None,
    airframe: str | None = None,
    reading: Reading = AS_HEARD,
    max_utilisation: Share | None = None,
) -> None:
    """Write a flight as messages that Foxglove and other viewers of MCAP show.

    The messages are JSON, each with its schema: channels, rotor speeds measured and predicted,
    thrust in use, margin with its interval, findings and position.

    Example: thrustmargin export demo --mcap flight.mcap --layout thrustmargin.json

    Args:
        log: Recorded flight: .tlog, DataFlash .BIN or .log, PX4 .ulg, or .csv.
        mcap: File to write (.mcap).
        layout: Write a layout of Foxglove for it (.json), with a line for each of its rotors.
        grafana: Write the dashboard of Grafana for `monitor --metrics` (.json); needs no log.
        model: Rotor speed model file of this aircraft; without it, and without an airframe, the one
            that ships is used for a flight that is recognised as one of topxgun-f16-sitl.
        airframe: Name of a shipped airframe, or an airframe file (.toml); without it the
            model's, else that of topxgun-f16-sitl for a flight that is recognised as one of it.
        reading: How the log is read.
        max_utilisation: Largest share of a rotor's maximum thrust that may be in use; without it
            50%, or what a recording was made with.
    """
    from thrustmargin.gcs_plugin.office.streams.mcap_file import layout_text, write_mcap
    from thrustmargin.gcs_plugin.reports.margin import report_flight
    from thrustmargin.models.whole_file import whole_file

    if mcap is None and layout is None and grafana is None:
        raise UsageError("nothing to write; give --mcap FILE, --layout FILE or --grafana FILE")
    of_log = mcap is not None or layout is not None
    logs = require_logs(() if log is None else (log,)) if of_log else ()
    if len(logs) > 1:
        raise UsageError(f"{log} holds {len(logs)} logs; name the one to write")
    inputs = Inputs(
        logs=logs,
        model=model,
        airframe=airframe,
        max_utilisation=max_utilisation,
        reading=reading,
    )
    check_outputs(
        [
            OutputFile("--mcap", mcap, endings=(".mcap",)),
            OutputFile("--layout", layout, endings=(".json",)),
            OutputFile("--grafana", grafana, endings=(".json",)),
        ],
        inputs=inputs.files,
    )
    console = Terminal(soft_wrap=True)
    if grafana is not None:
        dashboard = resources.files("thrustmargin.gcs_plugin.office.streams")
        with whole_file(grafana) as draft:
            draft.write_bytes((dashboard / "grafana_dashboard.json").read_bytes())
        console.print(f"wrote {grafana}; Grafana takes it by Import dashboard")
    if not of_log:
        return
    flights, limit, _ = analysed_flights(inputs, Terminal(stderr=True, soft_wrap=True))
    reports = [
        (report_flight(analysis, log, max_utilisation=limit), log) for analysis, log in flights
    ]
    if mcap is not None:
        console.print(f"wrote {mcap}: {write_mcap(reports, mcap)} messages")
    if layout is not None:
        names = max((report.json["model"]["rotor_names"] for report, _ in reports), key=len)
        with whole_file(layout) as draft:
            draft.write_text(layout_text(names), encoding="utf-8")
        console.print(f"wrote {layout}; Foxglove takes it by Import from file")
