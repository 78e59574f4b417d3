"""Words of the 3D scene and of the view's own data, and the catalogue of what the page says.

The catalogue is one file a language beside this one.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from functools import cache
from importlib import resources
from typing import Any

from thrustmargin.gcs_plugin.wording.numbers import margin_or_beyond

PREDICTED = "predicted"
NOTHING_KNOWN = "no rotor speed and no prediction"
SCREEN_REFUSES = "only the page of this view may do that"
ALARMS_SOUGHT = "alarms still being looked for"
ALARMS_UNKNOWN = "alarms are not known: this flight could not be searched for them"
#: Names of colours and cameras, which the catalogue has in other languages.
THRUST_LEFT = "Thrust left"
THRUST_IN_USE, TANK = "Thrust in use", "Tank"
PLANNED = "forecast from the plan"
WHOLE_FIELD, NORTH_UP, NOSE_AHEAD = "Whole field", "Follow, north up", "Follow, nose ahead"
RESIDUAL_BEFORE, RESIDUAL_AFTER = "Residual before", "Residual after"
ALL_PREDICTED = "predicted: no rotor speed was measured"
HOME = "Home"


@cache
def catalogue(language: str) -> dict[str, dict[str, Any]]:
    """`words` by key, with {placeholders}, and `names` by the label that is sent.

    Raises FileNotFoundError for a language that is none of LANGUAGES.
    """
    file = resources.files(__package__ or "") / f"catalogue_{language}.toml"
    return tomllib.loads(file.read_text("utf-8"))


def wind_words(speed: float) -> str:
    return f"wind {speed:.1f} m/s"


def fill_rests_on(density: float, basis: str, voltage: float, airspeed: float) -> str:
    """What an advice before take-off holds for: kg/m³ and its basis, V, m/s."""
    return (
        f"in air of {density:.2f} kg/m³ ({basis}), battery at {voltage:.1f} V under load, "
        f"{airspeed:.0f} m/s through the air; thrustmargin fill has other conditions"
    )


def margin_ahead(share: float) -> str:
    """What lasts; turns and climbs take more for moments, and gusts are not in it."""
    return f"rest of the route: {margin_or_beyond(share)} that lasts, less for moments in turns"


def model_with(effects: Sequence[str]) -> str:
    return f"model with {', '.join(effects)}" if effects else "model without effects"


def measured_share(basis: str, share: float) -> str:
    return f"{basis} for {100 * share:.0f} %, predicted for the rest"


def drawn_larger(scale: float) -> str:
    return f"aircraft drawn {scale:.0f} x its size" if scale > 1.0 else "true size"


def grid_words(cell: float) -> str:
    return f"grid {cell:g} m"
