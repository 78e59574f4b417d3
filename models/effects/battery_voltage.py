"""Speeds that are no measurement and go with the battery's voltage."""

from __future__ import annotations

import numpy as np

from thrustmargin.models.effects.base import Effect, Kind, Parameter
from thrustmargin.models.effects.channels import Channels


def _kappa(p, x: Channels):
    return np.exp(p["exponent"] * np.log(x.voltage / x.reference_voltage))


BATTERY_VOLTAGE = Effect(
    name="battery_voltage",
    kind=Kind.COEFFICIENT,
    # Smallest: 0.5 % of thrust where the voltage falls by a tenth. Lower: speeds worked out in
    # proportion to the voltage, thrust at one of which goes with 1 / V², and an error of a fifth.
    parameters=(
        Parameter(
            name="exponent", unit="1", start=1.0, lower=-2.5, upper=6.0, scale=0.5, smallest=0.05
        ),
    ),
    needs=("voltage", "moving_voltage"),
    neutral={"voltage": lambda p, x: x.reference_voltage},
    source="not physics of a measured rotor speed: simulators and estimated speeds that ignore "
    "the battery show thrust going with voltage^p, speeds that follow it too far against it",
    distinguished_by="the same load on a full and on an empty battery",
    apply=_kappa,
)

EFFECTS = (BATTERY_VOLTAGE,)
