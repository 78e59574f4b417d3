"""Where `airframe new` reads what a vehicle says of itself: a log, a parameter file or a link."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from thrustmargin.gcs_plugin.commands.shared.terminal import transfer_bar
from thrustmargin.models.errors import LogError
from thrustmargin.models.vehicle_facts import VehicleFacts

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.telemetry.settings.reported_airframe import ReportedAirframe


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleParameters:
    """Parameters by name, what else a log says of the same, and their origin in words."""

    parameters: Mapping[str, float]
    facts: VehicleFacts | None = None
    texts: tuple[str, ...] = ()
    highest_voltage: float = float("nan")  # V of the battery
    gauge: bool = False  # a log says what is in the tank
    words: str = ""  # where they are from; empty: from nowhere
    log: Path | None = None
    autopilot: str = ""
    not_named: tuple[str, ...] = ()  # logs of the folder, none of which was named

    @property
    def leaves_open(self) -> str:
        """How to begin a list of what is not in it."""
        if not self.words and self.not_named:
            first, count = self.not_named[0], len(self.not_named)
            return f"{count} logs in this folder, none named (--from {first} says much of this)"
        if not self.words:
            return "no log named by --from or --hover, and not one alone in this folder"
        return f"{self.words} does not say everything"

    def found_words(self, reported: ReportedAirframe) -> str:
        """What was found of the aircraft, for people."""
        cells, program = reported.quantities.get("nominal_voltage"), self.words or "nothing"
        return "; ".join(
            (
                f"{program}, autopilot {self.autopilot}" if self.autopilot else program,
                f"layout {reported.layout or 'not known'}",
                f"battery {cells.source}{', guessed' if cells.guessed else ''}"
                if cells
                else "battery cells not known",
                "a tank gauge" if self.gauge else "no tank gauge",
            )
        )


def read_source(source: str, *, vehicle: int | None, timeout: float) -> VehicleParameters:
    """The parameters in a log or parameter file, or of the vehicle on a link.

    Raises LogError or LinkError when there are none.
    """
    path = Path(source)
    if not path.exists() and (":" in source or source.startswith("/dev/")):
        return _fetched(source, vehicle, timeout)
    from thrustmargin.gcs_plugin.logs import read_log
    from thrustmargin.gcs_plugin.logs.parameter_file import SUFFIXES, read_parameters
    from thrustmargin.gcs_plugin.telemetry.first_contact import highest_voltage

    if path.suffix.lower() in SUFFIXES:
        return VehicleParameters(parameters=read_parameters(path), words=path.name)
    try:
        log = read_log(path, vehicle=vehicle)
    except LogError:
        if path.suffix.lower() != ".txt":
            raise
        return VehicleParameters(parameters=read_parameters(path), words=path.name)
    return VehicleParameters(
        parameters=log.parameters,
        facts=log.facts,
        texts=(*log.earlier_texts, *(text for _, text in log.messages)),
        highest_voltage=highest_voltage(log.track),
        gauge=log.track.reports("tank_kg"),
        words=path.name,
        log=path,
        autopilot=log.autopilot,
    )


def _fetched(url: str, vehicle: int | None, timeout: float) -> VehicleParameters:
    from thrustmargin.gcs_plugin.vehicle.connection import VehicleLink
    from thrustmargin.gcs_plugin.vehicle.downloads import download_parameters

    with VehicleLink.open(url) as link, transfer_bar() as (announce, progress):
        announce(f"waiting for a heartbeat at {url}")
        system = link.vehicle(vehicle, timeout=timeout)
        number = system.get_system_id()
        announce(f"parameters of vehicle {number}")
        found = download_parameters(link, system, progress)
    return VehicleParameters(parameters=found, words=f"vehicle {number} at {url}")
