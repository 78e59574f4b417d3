"""`thrustmargin airframe new`: an airframe file from what the vehicle says and the owner adds."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.console import Console

from thrustmargin.gcs_plugin.commands.airframe.questions import (
    Answers,
    OwnerStatement,
    asked,
    check_numbers,
    logs_here,
    require_all,
    stated,
)
from thrustmargin.gcs_plugin.commands.shared.inputs import (
    AS_HEARD,
    Reading,
    ReadingOptions,
    reading_keywords,
)
from thrustmargin.gcs_plugin.commands.shared.options import (
    LONGEST_S,
    OutputFile,
    check_outputs,
    check_range,
)
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.errors import DataError, ThrustMarginError
from thrustmargin.models.whole_file import whole_file

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.commands.airframe.fitted import Fitted
    from thrustmargin.gcs_plugin.commands.airframe.questions import VehicleParameters
    from thrustmargin.gcs_plugin.telemetry.settings.reported_airframe import ReportedAirframe
    from thrustmargin.models.physics.airframe import Airframe, Quantity


@dataclass(frozen=True, slots=True, kw_only=True)
class AirframeNew:
    """Make the airframe file of your own aircraft.

    Run in a terminal it asks: for what neither the options nor the log say, one by one. A log is
    that of --hover or --from, else the only one in the folder; its verdict is printed at once.
    Every value keeps its source, and what nobody stated is marked as guessed.

    Example: thrustmargin airframe new --from demo --mass 21.1 --wheelbase 1.92 --tank-litres 16
    --power-set topxgun-f16 --out my-aircraft.toml
    """

    source: Annotated[str | None, tyro.conf.arg(name="from", metavar="LOG|PARAMS|URL")] = None
    """A flight log, a parameter file (.param, .parm, .params), or the vehicle's link, such as
    udpin:127.0.0.1:14550."""
    out: Path = Path("my-aircraft.toml")
    """Airframe file to write."""
    owner: Annotated[OwnerStatement, tyro.conf.OmitArgPrefixes] = field(
        default_factory=OwnerStatement
    )
    bench: Annotated[Path | None, tyro.conf.arg(metavar="CSV")] = None
    """Bench table of motor and propeller: columns of rpm and thrust (its unit in the name, as
    thrust_g), optionally throttle and voltage. Gives thrust curve and ceiling."""
    hover: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="LOG...")] = ()
    """Flights with ten seconds or more of steady hover at --mass and the load below. Give the
    thrust coefficient, and how the rotors are trimmed; without --from the first is that too."""
    reading: Reading = AS_HEARD
    timeout: float = 10.0
    """s to wait for a vehicle on a link."""
    force: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Replace the file if it is there."""

    def run(self) -> int:
        from thrustmargin.gcs_plugin.commands.airframe.check import print_airframe
        from thrustmargin.gcs_plugin.wording.aircraft_words import owner_words

        console = Terminal()
        made = self.made(console)
        print_airframe(console, made.craft)
        for note in made.notes:
            console.print(f"note: {note}", soft_wrap=True)
        console.print(f"wrote {self.out}", soft_wrap=True)
        if made.log is not None and not made.hover:
            console.print("note: its hover is not used, for the load is not known: give --load KG")
        if made.log is not None:
            print_answer(console, made.log, self.out, made.reading)
        console.print(owner_words(), soft_wrap=True)
        return 0 if made.fits or not self.hover else 1

    def made(self, console: Console) -> MadeAirframe:
        """Write the airframe file that the options describe, and return the airframe with notes.

        The only log in the folder is used if no option names a source. Values that neither options
        nor log contain are asked for in a terminal. Raise UsageError for options that are missing
        or impossible, DataError if the file cannot be written.
        """
        from thrustmargin.gcs_plugin.commands.airframe.fitted import Fitted, bench_quantities
        from thrustmargin.gcs_plugin.commands.airframe.questions import (
            VehicleParameters,
            read_source,
        )
        from thrustmargin.models.physics.airframe_draft import airframe_toml

        reading_keywords(self.reading)
        check_numbers(self.owner)
        check_range("--timeout", self.timeout, 0.0, LONGEST_S, "s")
        asks = sys.stdin.isatty()
        source = self.source or (str(self.hover[0]) if self.hover else None)
        here = logs_here(Path()) if source is None and self.bench is None else []
        if len(here) == 1:
            source = str(here[0])
            console.print(f"{source}: the only log in this folder, taken", soft_wrap=True)
        check_outputs(
            [OutputFile("--out", self.out, (".toml",), keep=not self.force)],
            inputs=[source, *self.hover, self.bench],
        )
        found = VehicleParameters(parameters={}, not_named=tuple(path.name for path in here))
        if source is not None:
            found = read_source(source, vehicle=self.reading.vehicle, timeout=self.timeout)
        fitted = bench_quantities(self.bench) if self.bench else Fitted()
        reported = _reported(found, self.owner, fitted)
        answers = Answers(owner=self.owner, load=self.reading.load)
        # Where somebody can be asked, a log's hover is of use whichever option named it.
        hover = self.hover or ((found.log,) if found.log is not None and asks else ())
        weighed = found.gauge or self.reading.states_load
        asks_load = bool(hover) and not weighed
        if asks:
            if found.log is not None:
                console.print(f"found: {found.found_words(reported)}", soft_wrap=True)
            answers = asked(answers, reported, asks_load=asks_load)
        require_all(answers, reported, asks_load=asks_load, source=found.leaves_open)
        weighed = weighed or answers.owner.tank_litres == 0.0
        if not hover and found.log is not None and weighed:
            hover = (found.log,)
        reading = replace(self.reading, load=answers.load)
        name = answers.owner.name or self.out.stem
        craft, notes, fits = _made(answers.owner, reported, name, fitted, hover, reading)
        heading = (
            f"Made by `thrustmargin airframe new` from {found.words}. What is marked as guessed is "
            "not known:\ncorrect it when you know better, and remove the mark. "
            "Rotors are in the order of the autopilot's motors."
        )
        try:
            with whole_file(self.out) as draft:
                draft.write_text(airframe_toml(craft, heading), encoding="utf-8")
        except OSError as error:
            raise DataError(f"cannot write {self.out}: {error.strerror or error}") from error
        return MadeAirframe(
            craft=craft,
            notes=(
                *map(statement_words, reported.notes),
                *_guessed_cells(craft),
                *fitted.notes,
                *notes,
            ),
            reading=reading,
            hover=tuple(hover),
            log=hover[0] if hover else found.log,
            fits=fits,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class MadeAirframe:
    """A new airframe, and the log, flights and options it was made from."""

    craft: Airframe
    notes: tuple[str, ...]
    reading: ReadingOptions  # with the load that was asked for
    hover: tuple[Path, ...]
    log: Path | None  # of which a verdict can be shown
    fits: bool  # every flight of hover could be used


def _reported(found: VehicleParameters, owner: OwnerStatement, fitted: Fitted) -> ReportedAirframe:
    """Return the airframe values that the vehicle's parameters contain, and those `fitted` to a
    bench.

    A fitted value replaces the vehicle's.
    """
    from thrustmargin.gcs_plugin.telemetry.settings.reported_airframe import reported_airframe

    reported = reported_airframe(
        found.parameters,
        found.highest_voltage,
        facts=found.facts,
        texts=found.texts,
        layout=owner.layout,
    )
    return replace(reported, quantities={**reported.quantities, **fitted.quantities})


def _guessed_cells(craft: Airframe) -> tuple[str, ...]:
    """Return a note if the number of cells is guessed, with the grounds and the option that states
    it; else ()."""
    nominal = craft.quantities["nominal_voltage"]
    if not nominal.guessed:
        return ()
    return (f"the battery is guessed: {nominal.source}; state --cells COUNT",)


def _made(
    owner: OwnerStatement,
    reported: ReportedAirframe,
    name: str,
    fitted: Fitted,
    hover: Sequence[Path],
    reading: ReadingOptions,
) -> tuple[Airframe, tuple[str, ...], bool]:
    """Return the airframe, notes on it, and True unless flights for the fit could not be used.

    `hover` are logs to which the thrust curve is fitted, empty for none. If they cannot be used,
    the airframe has the stated and guessed values, and a note says why.
    """
    from thrustmargin.gcs_plugin.commands.airframe.fitted import ceiling_notes, hover_quantities

    craft = new_airframe(owner, reported, name=name, fitted=fitted.quantities)
    if not hover:
        return craft, (), True
    try:
        hovered = hover_quantities(hover, craft, reading)
    except DataError as error:
        return craft, (f"the hover is not used, and the thrust curve is a guess: {error}",), False
    together = {**fitted.quantities, **hovered.quantities}
    craft = new_airframe(owner, reported, name=name, fitted=together)
    return craft, (*hovered.notes, *ceiling_notes(craft)), True


def new_airframe(
    owner: OwnerStatement,
    reported: ReportedAirframe,
    *,
    name: str,
    fitted: Mapping[str, Quantity] = MappingProxyType({}),
) -> Airframe:
    """Build the airframe `name` from the owner's statements and the vehicle's report; guess the
    rest.

    Values `fitted` to data replace the vehicle's, but not the owner's. Raises UsageError for an
    impossible value, AirframeError if values contradict.
    """
    from thrustmargin.models.physics.airframe import airframe_from_table, quantity_table
    from thrustmargin.models.physics.airframe_draft import complete_quantities, lower_effectiveness
    from thrustmargin.models.physics.motor_layouts import motor_layouts

    layout_name = owner.layout or reported.layout
    reported = replace(reported, layout=layout_name, quantities={**reported.quantities, **fitted})
    quantities, rotors = stated(owner, reported), reported.rotors
    arm = quantities["arm"].value
    if rotors is None:
        layout = motor_layouts()[str(reported.layout)]
        lower = lower_effectiveness()
        if any(layout.lower):
            quantities["lower_rotor_effectiveness"] = lower
        rotors = layout.rotors(arm, lower.value)
    else:
        scale = arm / reported.quantities["arm"].value
        rotors = [
            {**r, "position_frd": [round(scale * p, 5) for p in r["position_frd"]]} for r in rotors
        ]
    table = {
        "name": name,
        "title": owner.title or f"{name} ({reported.layout}, {len(rotors)} rotors)",
        "layout": reported.layout,
        "quantities": {
            key: quantity_table(q) for key, q in complete_quantities(quantities).items()
        },
        "rotors": rotors,
    }
    return airframe_from_table(table, where=name)


def print_answer(console: Console, log: Path, file: Path, reading: ReadingOptions) -> None:
    """Print the verdict of `log` with the airframe `file`, and the command that makes its page.

    An error is printed instead of raised, because the airframe file is complete.
    """
    from thrustmargin.gcs_plugin.commands.flight.report import print_verdicts
    from thrustmargin.gcs_plugin.commands.shared.inputs import chosen_model, reading_keywords
    from thrustmargin.gcs_plugin.logs.log_answer import matched_flights
    from thrustmargin.gcs_plugin.reports.margin import build_report
    from thrustmargin.models.model.analysis import analyse, analysis_for_verdict

    try:
        model = chosen_model(None, str(file))
        flights = matched_flights(log, model, given=True, **reading_keywords(reading))
        made = build_report(
            (
                analysis_for_verdict(analyse(flight.track, model, airframe_match=airframe_match)),
                flight,
            )
            for flight, airframe_match in flights
        )
    except ThrustMarginError as error:
        console.print(f"no verdict of {log.name}: {error}", soft_wrap=True)
        return
    print_verdicts(console, made)
    line = f"thrustmargin report {shlex.quote(str(log))} --airframe {shlex.quote(str(file))}"
    load = "" if reading.load is None else f" --load {reading.load:g}"
    console.print(f"as a page: {line}{load}", soft_wrap=True)
