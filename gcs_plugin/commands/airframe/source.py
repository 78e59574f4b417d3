"""Where `airframe new` reads what a vehicle says of itself: a log, a parameter file or a link."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from thrustmargin.gcs_plugin.commands.shared.terminal import transfer_bar
from thrustmargin.models.errors import LogError
from thrustmargin.models.vehicle_facts import VehicleFacts


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleParameters:
    """Parameters by name, what else a log says of the same, and their origin in words."""

    parameters: Mapping[str, float]
    facts: VehicleFacts | None = None
    texts: tuple[str, ...] = ()
    highest_voltage: float = float("nan")  # V of the battery
    words: str = "nothing"


def read_source(source: str, *, vehicle: int | None, timeout: float) -> VehicleParameters:
    """The parameters in a log or parameter file, or of the vehicle on a link.

    Raises LogError or LinkError when there are none.
    """
    path = Path(source)
    if not path.exists() and (":" in source or source.startswith("/dev/")):
        return _fetched(source, vehicle, timeout)
    from thrustmargin.gcs_plugin.logs import read_log
    from thrustmargin.gcs_plugin.logs.parameter_file import SUFFIXES, read_parameters

    if path.suffix.lower() in SUFFIXES:
        return VehicleParameters(parameters=read_parameters(path), words=path.name)
    try:
        log = read_log(path, vehicle=vehicle)
    except LogError:
        if path.suffix.lower() != ".txt":
            raise
        return VehicleParameters(parameters=read_parameters(path), words=path.name)
    if not log.parameters:
        raise LogError(
            f"{path.name} holds no parameters; save them from the ground station to a .param file "
            "and give that, or connect the vehicle and give its URL"
        )
    voltage = log.track.voltage[np.isfinite(log.track.voltage)]
    # One wild report must not decide the number of cells.
    highest = float(np.percentile(voltage, 99.0)) if voltage.size else float("nan")
    return VehicleParameters(
        parameters=log.parameters,
        facts=log.facts,
        texts=tuple(text for _, text in log.messages),
        highest_voltage=highest,
        words=path.name,
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
