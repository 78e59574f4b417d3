"""What a command works on: the rotor speed model asked for, and the logs given."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.progress import track

from thrustmargin.gcs_plugin.commands.shared.reading import (
    AS_HEARD,
    ReadingOptions,
    reading_keywords,
)
from thrustmargin.gcs_plugin.wording.flight_words import several_words
from thrustmargin.models.errors import DataError, LogError, ThrustMarginError
from thrustmargin.models.model.model_file import load_model, shipped_model
from thrustmargin.models.model.rotor_model import RotorModel, physics_model
from thrustmargin.models.physics.airframe import Airframe, load_airframe

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.logs import FlightLog
    from thrustmargin.gcs_plugin.reports.shared import UnusedLog
    from thrustmargin.models.model.airframe_claim import AirframeClaim


#: Airframe of the shipped model: taken where none is given, for a flight recognised as one of it.
SHIPPED_AIRFRAME = "topxgun-f16-sitl"
NAMED = 3  # logs that an error names beside the first: a line, whatever their number


def chosen_model(model: Path | None, airframe: str | None) -> RotorModel:
    """The model file, else the shipped model, else weight and thrust curve of another airframe.

    Raises ModelError or AirframeError when a file is unfit, DataError when the two disagree.
    """
    if model is not None:
        return _model_of(model, airframe)
    shipped = shipped_model()
    if airframe is None:
        return shipped
    wanted = load_airframe(airframe)
    return shipped if _same_numbers(wanted, shipped.airframe) else physics_model(wanted)


def _same_numbers(one: Airframe, other: Airframe) -> bool:
    """Whether two files are of one aircraft: a user's own may have kept the name of another."""
    values = [{n: q.value for n, q in craft.quantities.items()} for craft in (one, other)]
    placed = np.array_equal(one.rotor_position_frd, other.rotor_position_frd)
    return one.name == other.name and values[0] == values[1] and placed


def starting_model(model: Path | None, airframe: str | None) -> tuple[RotorModel, str]:
    """The model that a search starts from, and its name for the result.

    Unlike `chosen_model`, an airframe alone always means its weight and thrust curve, so that the
    search can begin without what a network has learnt. Raises as `chosen_model`.
    """
    if model is not None:
        return _model_of(model, airframe), str(model)
    if airframe is None:
        return shipped_model(), "shipped"
    return physics_model(load_airframe(airframe)), f"airframe {airframe}"


def _model_of(file: Path, airframe: str | None) -> RotorModel:
    chosen = load_model(file)
    wanted = chosen.airframe.name if airframe is None else load_airframe(airframe).name
    if wanted != chosen.airframe.name:
        raise DataError(
            f"{file.name} is a model of {chosen.airframe.name}, not of {wanted}; give one"
        )
    return chosen


def listed(unused: Sequence[UnusedLog]) -> str:
    """The logs that cannot be used, with the reasons, as one sentence: reasons that differ in
    numbers and in the log's own name only are listed once, with NAMED of their logs."""
    alike: dict[str, list[UnusedLog]] = {}
    for log in unused:
        reason = log.reason.replace(log.name, "").replace(Path(log.name).stem, "")
        alike.setdefault(re.sub(r"[\d.]+", "", reason), []).append(log)
    return "; ".join(_of_one_reason(logs) for logs in alike.values())


def _of_one_reason(logs: Sequence[UnusedLog]) -> str:
    first, *others = logs
    message = f"{first.name}: {first.reason}"
    if not others:
        return message
    names = ", ".join(log.name for log in others[:NAMED])
    more = f" and {len(others) - NAMED} more" if len(others) > NAMED else ""
    return f"{message} (likewise {names}{more})"


def read_logs(
    logs: Sequence[Path],
    unused: list[UnusedLog],
    console: Console,
    *,
    model: RotorModel,
    given: bool,
    reading: ReadingOptions = AS_HEARD,
    skipped: type[ThrustMarginError] = LogError,
) -> Iterator[tuple[FlightLog, AirframeClaim]]:
    """Each sortie of the logs that can be read, in order, as `read_flights`.

    There is a bar on the `console` meanwhile, and a line on every log that is not one sortie alone.
    A log that cannot be read for an error of the kind `skipped` is added to `unused`.
    """
    from thrustmargin.gcs_plugin.reports.shared import UnusedLog

    reading_keywords(reading)  # what is wrong on the command line is wrong in no log
    described = "reading" if len(logs) != 1 else f"reading {escape(logs[0].name)}"
    quiet = not console.is_terminal
    for path in track(logs, described, console=console, transient=True, disable=quiet):
        try:
            flights = read_flights(path, model, given=given, reading=reading)
        except skipped as error:
            unused.append(UnusedLog(name=path.name, reason=unnamed(error, path)))
            continue
        for line in log_lines(flights[0][0], stated=reading.states_load):
            console.print(escape(f"{path.name}: {line}"), soft_wrap=True)
        yield from flights


def log_lines(log: FlightLog, *, stated: bool) -> tuple[str, ...]:
    """Remarks on the log of a sortie that holds others, stretches that are none, or columns that
    are left out."""
    several = () if log.sorties == 1 else (several_words(log.sorties, load_stated=stated),)
    return (*several, *log.unflown, *log.other_units)


def unnamed(error: Exception, path: Path) -> str:
    """What went wrong, without the name that stands before it already."""
    words = str(error)
    for named in (f"{path}: ", f"{path.name}: ", f"{path} ", f"{path.name} "):
        words = words.removeprefix(named)
    return words.replace(str(path), "it")


def claimed(
    read: Iterable[tuple[FlightLog, AirframeClaim]], unused: list[UnusedLog], console: Console
) -> Iterator[FlightLog]:
    """The logs of flights of the airframe; the others are added to `unused` with the reason.

    What comes after a loss of control is no flight to learn from: left out, with a remark. Nor are
    speeds that outputs made while telemetry was lost.
    """
    from thrustmargin.gcs_plugin.logs.inspection import left_out_findings
    from thrustmargin.gcs_plugin.reports.shared import UnusedLog
    from thrustmargin.gcs_plugin.wording.flight_words import lost_rows, not_flown
    from thrustmargin.models.checks.loss_of_control import before_loss, loss_of_control
    from thrustmargin.models.model.inferred.speed_basis import measured_only

    for log, claim in read:
        reason = not_flown(log.track)  # no airframe helps a log without a flight
        if reason or claim.withheld:
            reason = reason or f"{'; '.join(claim.withheld)}; {claim.remedy}"
            unused.append(UnusedLog(name=log.name, reason=reason))
            continue
        for one in left_out_findings(log.track):
            console.print(escape(f"{log.name}: {one.check}: {one.words}"), soft_wrap=True)
        if losses := loss_of_control(log.track):
            console.print(escape(f"{log.name}: {lost_rows(losses)}"), soft_wrap=True)
            log = replace(log, track=before_loss(log.track, losses))
        yield replace(log, track=measured_only(log.track))


def read_flights(
    path: Path,
    model: RotorModel,
    *,
    given: bool,
    reading: ReadingOptions = AS_HEARD,
    any_vehicle: bool = False,
) -> list[tuple[FlightLog, AirframeClaim]]:
    """Every sortie of a log with what can be inferred of it, and the ground on which it is one of
    the model's airframe, which the user gave or not.

    Where there is none, it is read without an airframe. Raises as `read_sorties`.
    """
    from thrustmargin.gcs_plugin.logs.claimed_flights import claimed_flights

    keywords = reading_keywords(reading)
    return claimed_flights(path, model, given=given, any_vehicle=any_vehicle, **keywords)
