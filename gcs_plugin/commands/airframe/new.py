"""`thrustmargin airframe new`: an airframe file from what the vehicle says and the owner adds."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated

import tyro

from thrustmargin.gcs_plugin.commands.airframe.questions import asked, require_all
from thrustmargin.gcs_plugin.commands.airframe.stated import OwnerStatement, stated
from thrustmargin.gcs_plugin.commands.shared.options import Output, check_outputs
from thrustmargin.gcs_plugin.commands.shared.reading import AS_HEARD, Reading
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
from thrustmargin.models.errors import DataError, LogError
from thrustmargin.models.whole_file import whole_file

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.telemetry.reported_airframe import ReportedAirframe
    from thrustmargin.models.physics.airframe import Airframe, Quantity


@dataclass(frozen=True, slots=True, kw_only=True)
class AirframeNew:
    """Make the airframe file of your own aircraft.

    Takes what the vehicle says (layout, motor order, battery) from a log, a parameter file or the
    vehicle itself, and asks for what it cannot know; every value keeps its source, and what nobody
    stated is marked as guessed.

    Example: thrustmargin airframe new --from flight.BIN --mass 18 --arm 0.74 --tank-litres 0
    --power-set hobbywing-x6-plus --out my-aircraft.toml
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
        from thrustmargin.gcs_plugin.commands.airframe.fitted import (
            Fitted,
            bench_quantities,
            ceiling_notes,
            hover_quantities,
        )
        from thrustmargin.gcs_plugin.commands.airframe.list_show import print_airframe
        from thrustmargin.gcs_plugin.commands.airframe.source import VehicleParameters, read_source
        from thrustmargin.gcs_plugin.telemetry.reported_airframe import reported_airframe
        from thrustmargin.models.physics.airframe_draft import airframe_toml

        source = self.source or (str(self.hover[0]) if self.hover else None)
        check_outputs(
            [Output("--out", self.out, (".toml",), keep=not self.force)],
            inputs=[source, *self.hover, self.bench],
        )
        found = VehicleParameters(parameters={})
        if source is not None:
            try:
                found = read_source(source, vehicle=self.reading.vehicle, timeout=self.timeout)
            except LogError:
                if self.source is not None:
                    raise  # a hover may be of a log without parameters, such as .csv
        reported = reported_airframe(
            found.parameters,
            found.highest_voltage,
            facts=found.facts,
            texts=found.texts,
            layout=self.owner.layout,
        )
        fitted = bench_quantities(self.bench) if self.bench else Fitted()
        known = replace(reported, quantities={**reported.quantities, **fitted.quantities})
        owner = asked(self.owner, known) if sys.stdin.isatty() else self.owner
        reported = replace(reported, layout=owner.layout or reported.layout)
        name, notes = self.owner.name or self.out.stem, [*reported.notes, *fitted.notes]
        craft = new_airframe(owner, reported, name=name, fitted=fitted.quantities)
        if self.hover:
            hovered = hover_quantities(self.hover, craft, self.reading)
            notes += hovered.notes
            together = fitted.quantities | hovered.quantities
            craft = new_airframe(owner, reported, name=name, fitted=together)
            notes += ceiling_notes(craft)
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
        console = Terminal()
        print_airframe(console, craft)
        for note in notes:
            console.print(f"note: {note}", soft_wrap=True)
        console.print(f"wrote {self.out}", soft_wrap=True)
        return 0


def new_airframe(
    owner: OwnerStatement,
    reported: ReportedAirframe,
    *,
    name: str,
    fitted: Mapping[str, Quantity] = MappingProxyType({}),
) -> Airframe:
    """The airframe of what the owner states and the vehicle reports; the rest is guessed.

    What is `fitted` to data takes the place of all but what the owner states.

    Raises UsageError that names every missing option, AirframeError when values contradict.
    """
    from thrustmargin.models.physics.airframe import airframe_from_table, quantity_table
    from thrustmargin.models.physics.airframe_draft import completed, lower_effectiveness
    from thrustmargin.models.physics.motor_layouts import motor_layouts

    reported = replace(reported, quantities={**reported.quantities, **fitted})
    require_all(owner, reported)
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
        "quantities": {key: quantity_table(q) for key, q in completed(quantities).items()},
        "rotors": rotors,
    }
    return airframe_from_table(table, where=name)
