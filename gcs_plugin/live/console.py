"""The terminal's view of the monitor: a table of vehicles, the alarms, the link and the recording.

Called from the main thread; reads what the compute thread last published and changes nothing. A
number that is older than its channel allows is shown with its age and never as if it were new.
Where there is no terminal, `EventPrinter` prints a line whenever something happens.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from thrustmargin.gcs_plugin.live.alarms.alarm import CRITICAL, NOTICE, WARNING, Alarm, AlarmEvent
from thrustmargin.gcs_plugin.live.link_vehicles import OLD, Fleet
from thrustmargin.gcs_plugin.live.live_monitor import Lateness, LiveMonitor, MonitorStatus
from thrustmargin.gcs_plugin.live.output import Output
from thrustmargin.gcs_plugin.live.watch.update import Update
from thrustmargin.gcs_plugin.live.watch.vehicle_monitor import VehicleMonitor
from thrustmargin.gcs_plugin.wording import live_words as words
from thrustmargin.gcs_plugin.wording.alarm_words import ONE_LOST
from thrustmargin.gcs_plugin.wording.language import say

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
    from rich.text import Text

STYLES = {CRITICAL: "bold white on red", WARNING: "bold yellow", NOTICE: "dim"}

#: Heading -> whether it is left out where the terminal is narrower than WIDE.
COLUMNS = {
    "id": False,
    "thrust left": False,
    "predicted": False,
    ONE_LOST: False,
    "tank": False,
    words.BY_THRUST: True,
    words.EMPTY_IN: False,
    words.REMAINING_ROUTE: False,
    words.IF_FULL: True,
    "age": False,
}
WRAPPED = (1, 3, 6, 7)  # of the headings, those of several words; cells are shorter
WIDE = 110  # characters


class Screen:
    """The terminal's view of a monitor, as wide as the terminal is when it is printed."""

    def __init__(self, monitor: LiveMonitor, *, page: bool = False) -> None:
        self._monitor, self._page = monitor, page

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        del console
        yield screen(self._monitor, options.max_width, page=self._page)


def screen(monitor: LiveMonitor, width: int = WIDE, *, page: bool = False) -> RenderableType:
    """Return the terminal's content, `width` characters wide; `page`: the 3D page is open too.

    Alarms of all vehicles come first, the gravest first, then the table of vehicles, remarks, and
    the state of the monitor. Vehicles that have left are in the remarks only. Below WIDE some
    columns are left out.
    """
    from rich.box import HEAVY_HEAD, SIMPLE_HEAD
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    now_us = monitor.now_us()
    narrow = width < WIDE
    shown = [n for n, wide in enumerate(COLUMNS.values()) if not (wide and narrow)]
    headings = list(COLUMNS)
    table = Table(box=SIMPLE_HEAD if narrow else HEAVY_HEAD, padding=(0, 1), pad_edge=False)
    for n in shown:
        table.add_column(headings[n], no_wrap=n not in WRAPPED)
    alarms: list[tuple[int, Alarm]] = []
    remarks: list[Text] = []
    fleet = monitor.fleet
    for number, watch in list(fleet.vehicles.items()):
        if watch.has_left(now_us):
            found = [Text(words.of_vehicle(number, line)) for line in answer_lines(watch)]
            heard = Text(words.last_heard(number, watch.link.last_us * 1e-6))
            remarks += [*found, heard]
            continue
        cells = vehicle_cells(watch, now_us, 1.0 - fleet.max_utilisation, fleet.old_s)
        table.add_row(*(cells[n] for n in shown))
        alarms += [(number, alarm) for alarm in list(watch.alarms.listed.values())]
        stale = watch.stale(now_us)
        remarks += [
            Text(words.of_vehicle(number, line), style="bold yellow")
            for line in (watch.problem, stale, words.not_followed_words(watch.not_followed))
            if line
        ]
        remarks += [Text(words.of_vehicle(number, line)) for line in answer_lines(watch)]
        if watch.last is not None:
            remarks += [
                Text(words.of_vehicle(number, line), style="dim") for line in watch.last.remarks
            ]
    alarms.sort(key=lambda item: (item[1].order, item[0]))
    lines = [
        Text(words.of_vehicle(n, a.line), style=STYLES.get(a.severity, "yellow")) for n, a in alarms
    ]
    if not table.rows and not remarks:
        remarks.append(Text(words.not_heard_on(monitor.settings.urls)))
    elif table.rows:
        remarks.append(Text(words.LEGEND, style="dim"))
    parts: list[RenderableType] = [*lines, table, *remarks]
    for line in status_lines(monitor.status(), page=page):
        loud = line.startswith(tuple(map(say, (words.NOT_RECORDING, words.STOPPED, words.BEHIND))))
        parts.append(Text(line, style="bold white on red" if loud else "dim"))
    return Group(*parts)


def answer_lines(watch: VehicleMonitor) -> tuple[str, ...]:
    """Return the answer of a vehicle's present or last flight, in lines; empty without one.

    For an unknown aircraft the results that need no airframe follow.
    """
    answer = None if watch.last is None else watch.last.answer
    return () if answer is None else (answer.line, *answer.contact_lines)


def vehicle_cells(
    watch: VehicleMonitor, now_us: int, limit: float, old_s: float = OLD
) -> list[Text]:
    """Return the cells of the table for a vehicle, in the order of its columns: its id, its figures
    and their age.

    `now_us` is the monitor's time, µs; `limit` the least margin allowed, a share. "-" is unknown:
    `problem` or the update's `remarks` give the reasons; before the first update all figures are,
    and the age is that of the last message. Figures older than `old_s` s are dim and begin with
    "~". Styles are set on the text and never written into it: the terminal shows markup as it is.
    """
    from rich.text import Text

    update = watch.last
    silent = watch.link.silent(now_us)
    if update is None:
        cells = [str(watch.system), *["-"] * (len(COLUMNS) - 2), seconds(silent)]
        return [Text(cell) for cell in cells]
    age = update.age_s(now_us)
    old = age > old_s
    margin, *others = numbers(update, limit)
    if not old:
        cells = [margin, *map(Text, others)]
        return [Text(str(watch.system)), *cells, Text(seconds(age))]
    # Old numbers keep no colour: green would say that all is well now.
    cells = [Text(c if c == "-" else f"~{c}", style="dim") for c in (margin.plain, *others)]
    heard = Text(f"{words.OLD} {seconds(age)}", style="bold red")
    return [Text(str(watch.system)), *cells, heard]


def numbers(update: Update, limit: float) -> tuple[Text, *tuple[str, ...]]:
    """Return the figures of the newest row, formatted for the cells between id and age.

    They are: thrust margin, coloured by `limit` (a share); predicted margin; redundancy with one
    rotor lost; tank, kg; tank by thrust, kg; time to empty; margin on the remaining route; margin
    with a full tank. "-" where unknown.
    """
    from rich.text import Text

    analysis, outlook = update.analysis, update.outlook
    predicted = float(np.min(analysis.margin_predicted[-1]))
    free = float(analysis.redundancy_yaw_uncontrolled[-1])
    tank = float(analysis.track.tank_kg[-1])
    low, high = (1.0 - end[-1] for end in analysis.use_ends[::-1])
    inferred = math.isfinite(tank) and math.isnan(analysis.track.measured("tank_kg")[-1])
    return (
        Text(words.NO_VERDICT)
        if analysis.no_verdict
        else _margin_cell(
            1.0 - analysis.known_utilisation[-1],
            low,
            high,
            limit,
            flying=bool(analysis.track.flying[-1]),
            predicted=not analysis.any_measured[-1],
        ),
        percent(predicted),
        f"{free:.2f} x" if math.isfinite(free) else "-",
        f"≈ {kilograms(tank)}" if inferred else kilograms(tank),
        kilograms(
            float(np.nanmean(update.virtual_kg[-10:])) if _any(update.virtual_kg) else math.nan
        ),
        minutes(outlook.seconds_to_empty),
        percent(outlook.margin_ahead),
        percent(outlook.margin_full),
    )


def _margin_cell(
    margin: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    limit: float,
    *,
    flying: bool,
    predicted: bool,
) -> Text:
    """Return the cell of the worst rotor: its margin and number, and how many rotors are unknown.

    `margin` (R,) and its 90 % interval `low`, `high` (R,) are shares, `limit` the least allowed.
    The cell is green or red only if the whole interval is on that side. A `predicted` margin,
    without any rotor's measured speed, is never green. Not `flying`, the cell says "on ground".
    """
    from rich.text import Text

    if not flying:
        return Text(words.ON_GROUND)
    known = np.isfinite(margin)
    if not np.any(known):
        return Text("-")
    worst = float(np.min(margin[known]))
    unknown = int(np.sum(~known))
    rotor = int(np.nanargmin(margin))
    least, most = float(low[rotor]), float(high[rotor])
    within = f" ({100 * least:.0f} to {100 * most:.0f})" if most - least > 1e-9 else ""
    cell = f"{'≈ ' if predicted else ''}{percent(worst)}{within} r{rotor + 1}"
    cell += f", {unknown} unknown" if unknown else ""
    near = unknown or predicted or least < limit
    colour = "bold red" if most < limit else "yellow" if near else "green"
    return Text(cell, style=colour)


def _any(values: np.ndarray) -> bool:
    return bool(np.any(np.isfinite(values[-10:])))


def status_lines(status: MonitorStatus, *, page: bool = False) -> list[str]:
    """Return the lines on delay, failed outputs, link and recording.

    `page`: the 3D page is open.
    """
    lines = [words.behind_words(status.behind_s, page=page)] if status.behind_s else []
    lines = [words.CUT_OFF] if status.cut_off else lines
    lines += [words.output_failed(name, error) for name, error in status.failed.items()]
    lost = {name: getattr(status, name) for name in words.LOST}
    lines.append(words.messages_words(status.frames, lost, status.refused_why))
    recorder = status.recorder
    if recorder is not None and recorder.trouble:
        lines.append(words.not_recording(recorder.trouble, recorder.frames_lost))
    elif recorder is not None:
        counts = recorder.frames, recorder.rows, recorder.frames_lost
        lines.append(words.recording_words(str(recorder.folder), *counts))
    return lines


def rowless_lines(fleet: Fleet) -> list[str]:
    """Return a line with the problem of each vehicle that sends messages but has no rows yet."""
    return [
        words.of_vehicle(n, w.problem)
        for n, w in fleet.vehicles.items()
        if w.problem and w.last is None
    ]


def percent(share: float) -> str:
    """Format a margin, a share, in per cent; a negative one as below 0 without its size, NaN as
    "-"."""
    if share < 0.0:
        return words.BEYOND
    return f"{share:.0%}" if math.isfinite(share) else "-"


def kilograms(mass: float) -> str:
    return f"{mass:.1f} kg" if math.isfinite(mass) else "-"


def minutes(time_s: float) -> str:
    """Return seconds as `3:07`; "-" for NaN, "not" for infinity."""
    if math.isinf(time_s):
        return "not"
    return f"{int(time_s) // 60}:{int(time_s) % 60:02d}" if math.isfinite(time_s) else "-"


def seconds(time_s: float) -> str:
    return f"{time_s:.1f} s"


def _clock(unix_s: float) -> str:
    return time.strftime("%H:%M:%S", time.localtime(unix_s))


class Bell(Output):
    """An output that calls `ring` for each alarm of severity warning or graver when raised."""

    name = "bell"

    def __init__(self, ring: Callable[[], None]) -> None:
        self._ring = ring

    def on_event(self, vehicle: int, event: AlarmEvent) -> None:
        del vehicle
        if event.raised and event.alarm.severity <= WARNING:
            self._ring()


class PlanPrinter(Output):
    """An output that prints the plan's comparison with the flight, one line per sentence."""

    name = "plan lines"

    def __init__(self, print_line: Callable[[str], None]) -> None:
        self._print = print_line

    def on_plan(self, vehicle: int, text: str) -> None:
        self._print(words.of_vehicle(vehicle, text))


class EventPrinter(Output):
    """An output that prints one line for each event, for a file or a log instead of a terminal.

    Lines begin with the local time, in its order; that of an alarm is the arrival of the report
    that raised or cleared it. An event found after later lines were printed ends with its own time.
    """

    name = "printed lines"

    def __init__(self, monitor: LiveMonitor, announce: Callable[[str], None]) -> None:
        self._monitor = monitor
        self._print = announce
        self._heard: set[int] = set()
        self._problems: dict[int, str] = {}
        self._in_vain: dict[int, set[str]] = {}  # messages that were asked for in vain
        self._trouble = ""
        self._failed: set[str] = set()  # outputs of which an error was printed
        self._lateness = Lateness()
        self._lock = threading.Lock()
        self._waiting: list[tuple[float, str]] = []  # Unix time and line, until a round is over
        self._last_s = -math.inf

    def _say(self, line: str, unix_s: float) -> None:
        known = unix_s if math.isfinite(unix_s) else self._monitor.now_us() * 1e-6
        with self._lock:
            self._waiting.append((known, line))

    def print(self) -> None:
        """Print the lines collected in a round of analysis, in order of time."""
        with self._lock:
            lines, self._waiting = sorted(self._waiting, key=lambda at: at[0]), []
            for known, line in lines:
                # The clock of a recording may have been set back; the one here never is.
                at_s = max(known, self._last_s) if self._monitor.live else known
                late = f" (at {_clock(known)})" if at_s - known > 1.0 else ""
                self._last_s = at_s
                date = time.strftime("%Y-%m-%d", time.localtime(at_s))
                self._print(f"{date} {_clock(at_s)} {line}{late}")

    def on_event(self, vehicle: int, event: AlarmEvent) -> None:
        self._say(words.of_vehicle(vehicle, event.line), event.unix_s)

    def on_note(self, vehicle: int, text: str, unix_s: float) -> None:
        self._say(words.of_vehicle(vehicle, text), unix_s)

    def on_round(self, fleet: Fleet, now_us: int) -> None:
        now_s = now_us * 1e-6
        for number, watch in fleet.vehicles.items():
            if number not in self._heard:
                self._heard.add(number)
                self._say(words.of_vehicle(number, words.HEARD), watch.link.first_us * 1e-6)
            if watch.problem != self._problems.get(number, ""):
                self._problems[number] = watch.problem
                line = watch.problem or words.WATCHED_AGAIN
                self._say(words.of_vehicle(number, line), now_s)
            before = self._in_vain.setdefault(number, set())
            if not before.issuperset(in_vain := watch.not_followed):
                before.update(in_vain)
                self._say(words.of_vehicle(number, words.not_followed_words(in_vain)), now_s)
        recorder = self._monitor.recorder
        trouble = "" if recorder is None else recorder.status().trouble
        if trouble != self._trouble:
            self._trouble = trouble
            line = words.not_recording(trouble) if trouble else words.RECORDING_AGAIN
            self._say(line, now_s)
        for name, error in self._monitor.failed.items():
            if name not in self._failed:
                self._failed.add(name)
                self._say(words.output_failed(name, error), now_s)
        self.print()

    def look(self, *, page: bool = False) -> None:
        """Print a line if the analysis has fallen behind or caught up since the last call.

        `page`: the 3D page is open. Called from another thread, because the compute thread may
        hang.
        """
        behind_s, now_s = self._monitor.status().behind_s, self._monitor.now_us() * 1e-6
        if self._lateness.changes(behind_s, now_s):
            late = words.behind_words(behind_s, page=page)
            self._say(late if behind_s else words.NOT_BEHIND, now_s)
            self.print()
