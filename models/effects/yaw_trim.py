"""A steady yaw moment, as of a tilted motor."""

from __future__ import annotations

from thrustmargin.models.effects.base import GUESSED_TORQUE, Effect, Kind, Parameter

YAW_TRIM = Effect(
    name="yaw_trim",
    kind=Kind.MOMENTS,
    parameters=(
        Parameter(
            name="moment",
            unit="N m",
            lower=-20.0,
            upper=20.0,
            scale=1.0,
            smallest=0.1,  # one motor tilted by 0.1 degrees
            accuracy=GUESSED_TORQUE,
            of_torque=True,
        ),
    ),
    of_every_aircraft=True,
    source="a tilted motor turns part of its thrust into a constant yaw moment",
    distinguished_by="level the motors, then swap two propellers between the pairs: if the moment "
    "goes with the propellers, they differ; or hover 60 s at two tank levels",
    apply=lambda p, x, thrust: (0.0 * thrust, 0.0 * thrust, p["moment"] + 0.0 * thrust),
)

EFFECTS = (YAW_TRIM,)
