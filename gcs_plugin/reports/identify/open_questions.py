"""What an identification cannot tell about a rotor, and what it could not try: in sentences."""

from __future__ import annotations

from thrustmargin.gcs_plugin.wording.described_effect import rotor_words, spread
from thrustmargin.gcs_plugin.wording.numbers import percent
from thrustmargin.models.effects.rotor_degradation import ROTOR_DEGRADATION
from thrustmargin.models.identification.output_shares import FEWEST_FLIGHTS
from thrustmargin.models.identification.result import Identification

CHECK = "level the motors, swap two propellers between the pairs, and fly again"


def open_questions(found: Identification) -> list[str]:
    """One sentence each, without a full stop; none where nothing is open."""
    names = found.model.airframe.rotor_names
    lines = []
    for loss in found.unflyable:
        lines.append(
            f"{rotor_words(loss.rotor, names).capitalize()} would have to make "
            f"{percent(loss.loss)} less thrust, and with more than {percent(loss.most)} nobody "
            f"could have flown: cannot tell what it is; {CHECK}"
        )
    for loss in found.possible:
        lines.append(
            f"{rotor_words(loss.rotor, names).capitalize()} may make "
            f"{spread(loss.loss, *loss.ci95, '%', factor=100.0, most=1)} less thrust than its "
            "share of the outputs; that is not sure enough for a name: "
            f"{ROTOR_DEGRADATION.distinguished_by}"
        )
    if found.problem.of_outputs:
        lines.append(
            "From motor outputs: only each rotor's share of the thrust was looked at, for battery, "
            "air and load move all outputs together"
        )
        if found.problem.flights < FEWEST_FLIGHTS and not found.model.background_rpm:
            lines.append(
                f"So few flights do not show by how much sound flights of this aircraft differ, so "
                f"no rotor is named: give {FEWEST_FLIGHTS} flights or more, or --model with a file "
                "learnt from good flights (thrustmargin identify GOOD... --out)"
            )
    elif any("airspeed" in lacking for lacking in found.untried.values()):
        lines.append("No airspeed is measured, so drag, lift and an unknown wind were not tried")
    return lines
