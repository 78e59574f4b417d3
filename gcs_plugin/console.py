"""The terminal's view of the monitor: a table of vehicles, the alarms, the link and the recording.

Called from the main thread; reads what the compute thread last published and changes nothing. A
number that is older than its channel allows is shown with its age and never as if it were new.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs_plugin.alarm import CRITICAL, Alarm, worst_first
from gcs_plugin.monitor import Monitor, MonitorStatus
from gcs_plugin.watch import Update, VehicleWatch

if TYPE_CHECKING:
    from rich.console import RenderableType

#: s after which the last row of a vehicle is shown as old.
OLD = 1.5
COLUMNS = (
    *("vehicle", "margin", "worst", "redundancy", "predicted", "tank", "by thrust"),
    *("empty in", "ahead", "full tank", "age"),
)


def screen(monitor: Monitor) -> RenderableType:
    """What to show now."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    now_us = monitor.now_us()
    table = Table(*COLUMNS, expand=False)
    alarms: list[tuple[int, Alarm]] = []
    remarks: list[Text] = []
    for number, watch in list(monitor.fleet.vehicles.items()):
        if watch.left(now_us):
            continue
        table.add_row(*vehicle_cells(watch, now_us, monitor.fleet.margin_limit))
        standing = list(watch.alarms.standing.values())
        alarms += [(number, alarm) for alarm in worst_first(standing)]
        if watch.problem:
            remarks.append(Text(f"vehicle {number}: {watch.problem}", style="bold yellow"))
        if watch.last is not None:
            source = watch.last.tank_source or "no tank level"
            remarks.append(Text(f"vehicle {number}: tank by {source}", style="dim"))
            remarks += [Text(f"  {note}", style="dim") for note in watch.last.notes]
    lines = [
        Text(f"vehicle {n}: {a.text}", style="bold red" if a.severity <= CRITICAL else "yellow")
        for n, a in alarms
    ]
    if not table.rows:
        remarks.append(Text("no vehicle heard yet on " + ", ".join(monitor.settings.urls)))
    parts: list[RenderableType] = [table, *lines, *remarks]
    parts += [Text(line, style="dim") for line in status_lines(monitor.status())]
    return Group(*parts)


def vehicle_cells(watch: VehicleWatch, now_us: int, limit: float) -> list[str]:
    """One row of the table; rich markup only from here, never from what a vehicle sent."""
    update = watch.last
    silent = watch.silent(now_us)
    if update is None:
        return [str(watch.system), *["-"] * (len(COLUMNS) - 2), seconds(silent)]
    age = (now_us - int(update.stamp_us[-1])) * 1e-6
    cells = numbers(update, limit)
    if age > OLD:
        cells = [f"[dim]{cell} old[/dim]" if cell != "-" else cell for cell in cells]
    return [str(watch.system), *cells, seconds(max(age, 0.0))]


def numbers(update: Update, limit: float) -> list[str]:
    """Everything between the vehicle's number and the age of its last row."""
    analysis, outlook = update.analysis, update.outlook
    margin = analysis.margin[-1]
    predicted = float(np.min(analysis.margin_predicted[-1]))
    known = bool(np.any(np.isfinite(margin)))
    worst = float(np.nanmin(margin)) if known else math.nan
    colour = "red" if worst < limit else "green"
    kept = float(analysis.redundancy_yaw_kept[-1])
    free = float(analysis.redundancy_yaw_free[-1])
    tank = float(analysis.track.tank_kg[-1])
    return [
        f"[{colour}]{percent(worst)}[/{colour}]" if known else "-",
        f"rotor {int(np.nanargmin(margin)) + 1}" if known else "-",
        f"{free:.2f} ({kept:.2f})" if math.isfinite(free) else "-",
        percent(predicted),
        kilograms(tank),
        kilograms(
            float(np.nanmean(update.virtual_kg[-10:])) if _any(update.virtual_kg) else math.nan
        ),
        minutes(outlook.seconds_to_empty),
        percent(outlook.margin_ahead),
        percent(outlook.margin_full),
    ]


def _any(values: np.ndarray) -> bool:
    return bool(np.any(np.isfinite(values[-10:])))


def status_lines(status: MonitorStatus) -> list[str]:
    """The link and the recording in words."""
    lost = [
        f"{count} {words}"
        for count, words in (
            (status.bad_checksum, "with a wrong checksum"),
            (status.bytes_skipped, "bytes skipped"),
            (status.refused, "refused by signing"),
            (status.kernel_drops, "dropped by the system"),
            (status.compute_drops, "not computed: the computer is too slow"),
        )
        if count
    ]
    lines = [f"{status.frames} messages" + (f" ({', '.join(lost)})" if lost else "")]
    recorder = status.recorder
    if recorder is not None:
        if recorder.trouble:
            lines.append(
                f"NOT RECORDING: {recorder.trouble} ({recorder.frames_lost} messages lost); "
                "make room, it goes on by itself"
            )
        else:
            lines.append(
                f"recording to {recorder.folder}: {recorder.frames} messages, "
                f"{recorder.rows} samples"
                + (f", {recorder.frames_lost} lost earlier" if recorder.frames_lost else "")
            )
    return lines


def percent(share: float) -> str:
    return f"{share:.0%}" if math.isfinite(share) else "-"


def kilograms(mass: float) -> str:
    return f"{mass:.1f} kg" if math.isfinite(mass) else "-"


def minutes(time_s: float) -> str:
    """Minutes and seconds; "-" for unknown, "not" for never."""
    if math.isinf(time_s):
        return "not"
    return f"{int(time_s) // 60}:{int(time_s) % 60:02d}" if math.isfinite(time_s) else "-"


def seconds(time_s: float) -> str:
    return f"{time_s:.1f} s"
