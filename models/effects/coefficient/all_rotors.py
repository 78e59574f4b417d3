"""Thrust of all rotors that goes with time, and speeds that go with the battery's voltage."""

from __future__ import annotations

import numpy as np

from thrustmargin.models.effects.base import Effect, Kind, Parameter
from thrustmargin.models.effects.channels import Channels

THRUST_DRIFT = Effect(
    name="thrust_drift",
    kind=Kind.COEFFICIENT,
    parameters=(
        # Smallest: air that warms by 3 K in 10 minutes.
        Parameter(name="rate", unit="1/s", lower=-1e-3, upper=2e-3, scale=1e-4, smallest=1.7e-5),
    ),
    source="icing, fouling or dust: all rotors lose thrust as time goes on",
    apply=lambda p, x: 1.0 - p["rate"] * x.time_s,
)


def _kappa(p, x: Channels):
    right_at = (1.0 + p["level"]) * x.reference_voltage
    return np.exp(p["exponent"] * np.log(x.voltage / right_at))


BATTERY_VOLTAGE = Effect(
    name="battery_voltage",
    kind=Kind.COEFFICIENT,
    # Smallest: 0.5 % of thrust where the voltage falls by a tenth. Bounds: a motor's speed goes at
    # most in proportion to the voltage, so thrust at a speed that is reported the same whatever
    # the battery goes at most with V², and at one worked out in that proportion, if it does not go
    # so at all, with 1 / V²; and an error of a fifth.
    parameters=(
        Parameter(
            name="exponent", unit="1", start=1.0, lower=-2.5, upper=2.5, scale=0.5, smallest=0.05
        ),
        # Where speeds that somebody works out are right, against a full battery: a lithium cell has
        # 4.2 V when full, 3.7 V on its label (12 % less, twice the usual size), 3.4 V when empty.
        # Taken to be right at a full one, what they are off by all along would be hidden mass.
        Parameter(name="level", unit="1", detail=True, lower=-0.2, upper=0.1, scale=0.06),
    ),
    needs=("voltage", "moving_voltage"),
    neutral={"voltage": lambda p, x: (1.0 + p["level"]) * x.reference_voltage},
    source="not physics of a measured rotor speed: simulators and estimated speeds that ignore "
    "the battery show thrust going with voltage^p, speeds that follow it too far against it",
    apply=_kappa,
)

EFFECTS = (THRUST_DRIFT, BATTERY_VOLTAGE)
