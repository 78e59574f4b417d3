"""`thrustmargin airframe list`, `show` and `check`: shipped airframes, values of one, comparison
with flights.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.console import Console
from rich.table import Table
from rich.text import Text
from tyro.conf import Positional

from thrustmargin.gcs_plugin.commands.shared.inputs import AS_HEARD, Reading, reading_keywords
from thrustmargin.gcs_plugin.commands.shared.options import require_logs
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
from thrustmargin.gcs_plugin.reports.shared.page_shell import grid
from thrustmargin.models.errors import DataError

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.logs import FlightLog
    from thrustmargin.gcs_plugin.logs.findings import Finding, Severity
    from thrustmargin.models.physics.airframe import Airframe


@dataclass(frozen=True, slots=True)
class AirframeList:
    """Show the airframes and the power sets that ship with thrustmargin.

    Example: thrustmargin airframe list
    """

    def run(self) -> int:
        from thrustmargin.models.physics.airframe import airframe_names, load_airframe
        from thrustmargin.models.physics.airframe_draft import power_sets

        console, rows = Terminal(), []
        for name in airframe_names():
            craft = load_airframe(name)
            masses = (f"{craft.empty_mass:g}", f"{craft.tank_capacity_kg:g}")
            rows.append((name, craft.layout, str(craft.rotor_count), *masses, craft.title))
        heads = ("name", "layout", "rotors", "empty kg", "tank kg", "aircraft")
        console.print(grid(heads, rows, left=(0, 1, 5)))
        console.print("power sets, for: thrustmargin airframe new --power-set NAME")
        sets = []
        for one in power_sets().values():
            top = one.quantities["nameplate_max_thrust"]
            words = f"{top.value / 9.80665:.3g}" + (" guessed" if top.guessed else "")
            sets.append((one.name, one.title, words))
        console.print(grid(("name", "motor and propeller", "kgf a rotor"), sets, left=(0, 1)))
        return 0


@dataclass(frozen=True, slots=True)
class AirframeShow:
    """Show every value of an airframe with its unit and source, and which are guesses.

    Example: thrustmargin airframe show topxgun-f16
    """

    name: Annotated[Positional[str], tyro.conf.arg(metavar="NAME|FILE")]
    """Name of a shipped airframe, or an airframe file (.toml)."""

    def run(self) -> int:
        from thrustmargin.models.physics.airframe import load_airframe

        print_airframe(Terminal(), load_airframe(self.name))
        return 0


def print_airframe(console: Console, craft: Airframe) -> None:
    """Print the airframe: a sentence, tables of quantities and rotors, and which are guessed."""
    console.print(repr(craft), soft_wrap=True)
    table = grid(("quantity", "value", "unit", "known", "from"), left=(0, 2, 3, 4))
    for name, q in craft.quantities.items():
        known, style = ("guessed", "yellow") if q.guessed else ("", "")
        unit = "" if q.unit == "1" else q.unit
        table.add_row(name, f"{q.value:.5g}", unit, known, q.source, style=style)
    console.print(table)
    rotors = []
    for n, name in enumerate(craft.rotor_names):
        cells = [f"{p:.3f}" for p in craft.rotor_position_frd[n]]
        turns = "ccw" if craft.rotor_spin[n] > 0 else "cw"
        rotors.append((str(n + 1), *cells, f"{craft.rotor_effectiveness[n]:g}", turns, name))
    heads = ("motor", "forward m", "right m", "down m", "effectiveness", "turns", "place")
    console.print(grid(heads, rotors, left=(5, 6)))
    if craft.guessed:
        console.print(
            f"guessed, not measured and not printed by a maker: {', '.join(craft.guessed)}",
            soft_wrap=True,
        )


#: The checks of `inspect` that are about the airframe, in the order of the output.
_OF_INSPECT = ("vehicle", "motors", "frame", "motor order", "voltage", "tank", "rotor speed")
_OF_INSPECT += ("rotor speed limit", "motor output")

#: Why nothing can be compared where an interval is not known.
TOO_SHORT = "for these flights are too short for an interval; give more hover"


@dataclass(frozen=True, slots=True)
class AirframeCheck:
    """Hold what an airframe file claims against flights of the aircraft.

    Layout, motor order, ESC poles, voltage, the thrust coefficient against the weight in hover, the
    trim of the rotors, and the largest rotor speed. Says of each whether the flights agree.

    Example: thrustmargin airframe check topxgun-f16-sitl demo
    """

    file: Annotated[Positional[str], tyro.conf.arg(metavar="FILE|NAME")]
    """Airframe file (.toml), or the name of a shipped airframe."""
    logs: Annotated[
        Positional[tuple[Path, ...]], tyro.conf.arg(metavar="LOG...", help_behavior_hint="")
    ]
    """Flights of the aircraft, best with ten seconds or more of steady hover."""
    reading: Reading = AS_HEARD

    def run(self) -> int:
        from thrustmargin.gcs_plugin.commands.flight.inspect import MARK
        from thrustmargin.gcs_plugin.logs import read_sorties
        from thrustmargin.models.physics.airframe import load_airframe

        paths = require_logs(self.logs)
        craft = load_airframe(self.file)
        keywords = reading_keywords(self.reading)
        read = (read_sorties(path, airframe=craft, **keywords) for path in paths)
        logs = [log for sorties in read for log in sorties]
        console = Terminal()
        table = Table(show_header=False, box=None, pad_edge=False)
        for finding in airframe_findings(craft, logs):
            mark, colour = MARK[finding.level]
            table.add_row(Text(mark, style=colour), Text(finding.check), Text(finding.words))
        console.print(f"{craft.title}, held against {', '.join(log.name for log in logs)}")
        console.print(table)
        if craft.guessed:
            console.print(f"guessed in the file: {', '.join(craft.guessed)}", soft_wrap=True)
        return 0


def airframe_findings(craft: Airframe, logs: Sequence[FlightLog]) -> list[Finding]:
    """Compare an airframe file with flights; return findings on motors, thrust coefficient and
    ceiling.

    Of equal checks of several logs the gravest finding is kept.
    """
    from thrustmargin.gcs_plugin.logs.inspection import inspect_log

    found = [
        finding
        for log in logs
        for finding in inspect_log(log, craft).findings
        if finding.check in _OF_INSPECT
    ]
    # The same result from several flights is one result, the graver of two the first.
    order = {"warning": 0, "ok": 1, "unknown": 2}
    kept: dict[str, Finding] = {}
    for finding in sorted(found, key=lambda f: (_OF_INSPECT.index(f.check), order[f.level])):
        kept.setdefault(finding.check, finding)
    return [*kept.values(), *_hover(craft, logs), *_ceiling(craft, logs)]


def _hover(craft: Airframe, logs: Sequence[FlightLog]) -> Iterator[Finding]:
    """Yield a finding on the file's thrust coefficient against that of hovers, and one on the trim.

    The trim is each rotor's thrust over its share. Without a usable hover, yield one finding
    UNKNOWN.
    """
    from thrustmargin.gcs_plugin.commands.airframe.fitted import hover_sentences, interval
    from thrustmargin.gcs_plugin.logs.findings import Finding, Severity
    from thrustmargin.gcs_plugin.wording.language import percent
    from thrustmargin.models.physics.thrust_fits import fit_hover

    check = "thrust coefficient"
    try:
        fit = fit_hover([log.track for log in logs], craft)
    except DataError as error:
        yield Finding(check=check, level=Severity.UNKNOWN, words=str(error))
        return
    claim = craft.thrust_coefficient * fit.reference_density / craft.reference_density
    # Two standard errors of the air's density, besides the scatter of the flights.
    air = 1.96 * fit.density_error / fit.reference_density
    apart = claim / fit.coefficient.value - 1.0
    low, high = fit.coefficient.low * (1 - air), fit.coefficient.high * (1 + air)
    words = (
        f"{claim:.4g} N/rpm² by the file in this air, {interval(fit.coefficient)} by "
        f"{fit.rows} rows of hover, +- {percent(air, 1)} for the air"
    )
    level = within_ends(claim, low, high)
    if level is Severity.UNKNOWN:
        words += f": cannot tell whether they agree, {TOO_SHORT}"
    elif level == "warning":
        words += (
            f": {100 * abs(apart):.0f} % {'more' if apart > 0 else 'less'} than the flights show; "
            "is the "
            f"mass {craft.empty_mass:g} kg and the load right? else `airframe new --hover`"
        )
    yield Finding(check=check, level=level, words=words)
    # A trim that is even within its interval is one whose ends, a tenth wider, hold 1.
    trims = {within_ends(1.0, t.low - 0.1, t.high + 0.1) for t in fit.trim}
    worst = (Severity.WARNING, Severity.UNKNOWN, Severity.OK)
    level = next(one for one in worst if one in trims)
    for sentence in hover_sentences(fit):
        yield Finding(check="trim", level=level, words=sentence)


def _ceiling(craft: Airframe, logs: Sequence[FlightLog]) -> Iterator[Finding]:
    """Yield a finding on the file's largest rotor speed at the battery's voltage in flight.

    It is compared with the highest measured speed, and with the speed extrapolated to full output.
    The level is UNKNOWN if that cannot be extrapolated.
    """
    import numpy as np

    from thrustmargin.gcs_plugin.commands.airframe.fitted import figure, interval
    from thrustmargin.gcs_plugin.logs.findings import Finding, Severity
    from thrustmargin.gcs_plugin.wording.language import number
    from thrustmargin.models.model.inferred.output_speed import full_output_speed
    from thrustmargin.models.physics.margin import ceiling

    check = "largest rotor speed"
    try:
        top, volts = full_output_speed([(log.track, log.parameters) for log in logs], craft)
    except DataError as error:
        yield Finding(check=check, level=Severity.UNKNOWN, words=str(error))
        return
    claim = float(ceiling(craft, craft.reference_density, volts).max_rotor_speed_rpm[0])
    speeds = np.concatenate([log.track.rotor_speed_rpm[log.track.flying].ravel() for log in logs])
    speeds = speeds[np.isfinite(speeds)]
    highest = float(np.percentile(speeds, 99.9)) if speeds.size else float("nan")
    words = f"{figure(claim)} rpm by the file at {number(volts, 'V')}; full output "
    words += f"extrapolates to {interval(top)}"
    if speeds.size:
        words += f", the highest measured is {highest:.0f}"
    level = Severity.WARNING if claim < highest else within_ends(claim, top.low, top.high)
    if level is Severity.UNKNOWN:
        words += f": cannot tell whether they agree, {TOO_SHORT}"
    elif level is Severity.WARNING and (claim < highest or claim < top.low):
        words += ": the file claims too little, so margins read too small"
    elif level is Severity.WARNING:
        words += ": the file claims more than these motors seem to make, so margins read too large"
    yield Finding(check=check, level=level, words=words)


def within_ends(claim: float, low: float, high: float) -> Severity:
    """Return OK if the file's value `claim` is between `low` and `high`, WARNING if not.

    UNKNOWN if one of the three is not finite.
    """
    from thrustmargin.gcs_plugin.logs.findings import Severity

    if not (isfinite(claim) and isfinite(low) and isfinite(high)):
        return Severity.UNKNOWN
    return Severity.OK if low <= claim <= high else Severity.WARNING
