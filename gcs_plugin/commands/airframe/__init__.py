"""`thrustmargin airframe`: the files that say what an aircraft is."""

from __future__ import annotations

from typing import Annotated

import tyro

from thrustmargin.gcs_plugin.commands.airframe.check import (
    AirframeCheck,
    AirframeList,
    AirframeShow,
)
from thrustmargin.gcs_plugin.commands.airframe.new import AirframeNew


def airframe(
    what: Annotated[
        Annotated[AirframeList, tyro.conf.subcommand("list", prefix_name=False)]
        | Annotated[AirframeShow, tyro.conf.subcommand("show", prefix_name=False)]
        | Annotated[AirframeNew, tyro.conf.subcommand("new", prefix_name=False)]
        | Annotated[AirframeCheck, tyro.conf.subcommand("check", prefix_name=False)],
        tyro.conf.arg(name=""),
    ],
) -> int:
    """Make, show and check the file of an aircraft: masses, rotors, battery, thrust curve.

    Example: thrustmargin airframe check topxgun-f16-sitl demo
    """
    return what.run()
