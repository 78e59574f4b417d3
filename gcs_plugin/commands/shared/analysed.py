"""Logs read and analysed as `report` does it, with the options that a recording was made with.

`monitor` writes its options as JSON beside the .tlog when it begins to record. `report`, `replay`
and `inspect` take those that the user does not give: the aircraft, the reading options, the limit.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console

from thrustmargin.gcs_plugin.commands.shared.options import UsageError, check_utilisation
from thrustmargin.gcs_plugin.commands.shared.reading import (
    AS_HEARD,
    ReadingOptions,
    reading_keywords,
)
from thrustmargin.models.errors import DataError, ThrustMarginError
from thrustmargin.models.json_values import from_json_values
from thrustmargin.models.whole_file import regular

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.logs import FlightLog
    from thrustmargin.gcs_plugin.reports.shared import UnusedLog
    from thrustmargin.models.model.analysis import FlightAnalysis


def analysed_flights(
    logs: Sequence[Path], asked: Chosen, console: Console
) -> tuple[list[tuple[FlightAnalysis, FlightLog]], float, list[UnusedLog]]:
    """Every sortie of the logs, the largest share of thrust that may be in use, the logs not read.

    What a recording was made with is taken where nothing is asked for. Raises DataError when no
    log can be read, UsageError when the share is none.
    """
    chosen = with_recorded(logs, asked, console)
    check_utilisation(chosen.limit)
    flights, unread = flights_of(logs, chosen, console)
    return flights, chosen.limit, unread


def flights_of(
    logs: Sequence[Path], chosen: Chosen, console: Console
) -> tuple[list[tuple[FlightAnalysis, FlightLog]], list[UnusedLog]]:
    """Every sortie of the logs with the load that its verdict rests on, and the logs not read.

    Raises DataError when no log can be read.
    """
    from thrustmargin.gcs_plugin.commands.shared.inputs import chosen_model, listed, read_logs
    from thrustmargin.models.model.analysis import analyse, analysis_for_verdict

    model = chosen_model(chosen.model, chosen.airframe)
    unread: list[UnusedLog] = []
    read = read_logs(
        logs,
        unread,
        console,
        model=model,
        given=chosen.given,
        reading=chosen.reading,
        skipped=ThrustMarginError,
    )
    flights = [
        (analysis_for_verdict(analyse(log.track, model, claim=claim)), log) for log, claim in read
    ]
    if not flights:
        raise DataError(listed(unread))
    return flights, unread


OPTIONS = "options.json"
LIMIT = 0.5  # share of a rotor's maximum thrust, where nobody names another


@dataclass(frozen=True, slots=True, kw_only=True)
class Chosen:
    """What a command works with: the user's options, and the recording's where none are given."""

    model: Path | None = None
    airframe: str | None = None
    max_utilisation: float | None = None
    reading: ReadingOptions = AS_HEARD

    @property
    def given(self) -> bool:
        """Whether somebody named the aircraft."""
        return self.model is not None or self.airframe is not None

    @property
    def limit(self) -> float:
        """Largest share of a rotor's maximum thrust that may be in use."""
        return LIMIT if self.max_utilisation is None else self.max_utilisation

    @property
    def words(self) -> str:
        """The options as they would be typed."""
        named = {
            "--model": self.model,
            "--airframe": self.airframe,
            "--max-utilisation": self.max_utilisation,
            "--vehicle": self.reading.vehicle,
            "--tank": self.reading.tank if self.reading.tank != AS_HEARD.tank else None,
            "--tank-start-kg": self.reading.tank_start_kg,
            "--load": self.reading.load,
            "--load-end": self.reading.load_end,
            "--air-temperature": self.reading.air_temperature_c,
        }
        return " ".join(f"{name} {value}" for name, value in named.items() if value is not None)

    def as_table(self) -> dict[str, Any]:
        """For the recording; files with their whole path."""
        airframe = self.airframe
        if airframe is not None and airframe.endswith(".toml"):
            airframe = str(Path(airframe).resolve())
        return {
            "model": None if self.model is None else str(self.model.resolve()),
            "airframe": airframe,
            "max_utilisation": self.max_utilisation,
            "reading": asdict(self.reading),
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class _Table:
    """What options.json holds, each by its kind."""

    model: str | None
    airframe: str | None
    max_utilisation: float | None
    reading: ReadingOptions


def with_recorded(logs: Sequence[Path], user: Chosen, console: Console) -> Chosen:
    """The options for these logs; what is taken from a recording is printed on the console.

    Raises DataError when a recording's options cannot be read, or those of the logs differ.
    """
    recorded = [_options_of(log) for log in logs]
    taken = Chosen()
    if not user.given:
        model, airframe = _common(recorded, logs, lambda one: (one.model, one.airframe))
        taken = replace(taken, model=model, airframe=airframe)
    if user.max_utilisation is None:
        taken = replace(taken, max_utilisation=_common(recorded, logs, lambda o: o.max_utilisation))
    if user.reading == AS_HEARD:
        taken = replace(taken, reading=_common(recorded, logs, lambda one: one.reading))
    if taken == Chosen():
        return user
    console.print(f"as recorded ({logs[0].parent / OPTIONS}): {taken.words}", soft_wrap=True)
    return Chosen(
        model=taken.model or user.model,
        airframe=taken.airframe or user.airframe,
        max_utilisation=user.max_utilisation or taken.max_utilisation,
        reading=taken.reading if user.reading == AS_HEARD else user.reading,
    )


def _common(recorded: Sequence[Chosen], logs: Sequence[Path], part: Callable[[Chosen], Any]) -> Any:
    for one, log in zip(recorded, logs, strict=True):
        if part(one) != part(recorded[0]):
            differing = [
                f"{o.words or 'nothing'} ({p})" for o, p in ((recorded[0], logs[0]), (one, log))
            ]
            raise DataError(
                f"recorded with other options: {' and '.join(differing)}; name the options, or "
                "give one of these recordings at a time"
            )
    return part(recorded[0]) if recorded else part(Chosen())


def _options_of(log: Path) -> Chosen:
    """Those beside a .tlog; none where there is no such file."""
    path = log.parent / OPTIONS
    if log.suffix.lower() != ".tlog" or not path.exists():
        return Chosen()
    try:
        content = json.loads(regular(path).read_text("utf-8"))
        table: _Table = from_json_values(_Table, content, "options")
        if table.max_utilisation is not None and not 0.0 < table.max_utilisation <= 1.0:
            raise ValueError(f"a limit of {table.max_utilisation:g}")
        reading_keywords(table.reading)
        made = Chosen(
            model=None if table.model is None else Path(table.model),
            airframe=table.airframe,
            max_utilisation=table.max_utilisation,
            reading=table.reading,
        )
    except (OSError, ValueError, RecursionError, UsageError) as error:
        raise DataError(
            f"{path} does not hold the options of a recording ({error!s:.80}); rename it, and give "
            "the options yourself"
        ) from error
    return made
