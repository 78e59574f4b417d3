"""Read the sorties of a log with inferred channels, and match each with the model's airframe.

Every command that analyses a file reads it by this function.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from thrustmargin.gcs_plugin.logs.read import read_sorties
from thrustmargin.gcs_plugin.telemetry.flight_log import with_track
from thrustmargin.gcs_plugin.telemetry.recording import FlightLog
from thrustmargin.models.checks.instruments import without_frozen
from thrustmargin.models.errors import AirframeError
from thrustmargin.models.model.airframe_claim import AirframeClaim, airframe_claim
from thrustmargin.models.model.inferred.prepared import fill_channels
from thrustmargin.models.model.rotor_model import RotorModel, identified_airframe


def claimed_flights(
    path: Path, model: RotorModel, *, given: bool, **options: Any
) -> list[tuple[FlightLog, AirframeClaim]]:
    """Return every sortie of a log with its inferred channels, and its match with the model's
    airframe.

    `given` is True if the user gave the airframe; `options` are those of `read_sorties`. A log that
    does not match is read without an airframe. Raise the errors of `read_sorties`.
    """
    craft = identified_airframe(model)

    def claims_of(logs: Iterable[FlightLog]) -> list[AirframeClaim]:
        claims = (
            airframe_claim(log.track, craft, log.facts, log.parameters, given=given) for log in logs
        )
        return [replace(claim, source=shlex.quote(str(path))) for claim in claims]

    def read(**airframe: Any) -> list[FlightLog]:
        logs = read_sorties(path, sought=given, **airframe, **options)
        return [
            replace(log, track=without_frozen(log.track, craft, log.parameters)) for log in logs
        ]

    try:
        logs, fits = read(airframe=model.airframe), True
    except AirframeError:  # another number of rotors, which the claim will say
        logs, fits = read(), False
    claims = claims_of(logs)
    if fits and any(claim.basis == "not known" for claim in claims):
        bare = read()
        if len(bare) == len(logs):
            unclaimed = [claim.basis == "not known" for claim in claims]
            logs = [b if none else log for log, b, none in zip(logs, bare, unclaimed, strict=True)]
        else:  # the airframe's tank or speeds divided them otherwise
            logs, claims = bare, claims_of(bare)
    return [
        (
            log
            if claim.basis == "not known" or claim.withheld
            else with_track(log, fill_channels(log.track, craft, log.parameters)),
            claim,
        )
        for log, claim in zip(logs, claims, strict=True)
    ]
