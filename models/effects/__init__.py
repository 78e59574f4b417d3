"""The table of physical effects. Adding one is adding one object to CATALOGUE.

Order is that of the text: inputs, demand, moments, coefficient. `models.effects.compose` puts
effects together into rotor speeds; `identification.identify` searches this table and nothing else.
"""

from __future__ import annotations

from thrustmargin.models.effects.base import Effect, Kind, Parameter, Placed
from thrustmargin.models.effects.coefficient import (
    AIR_DENSITY,
    BATTERY_VOLTAGE,
    CLIMB_INFLOW,
    GROUND_EFFECT,
    ONSETS,
    ROTOR_DEGRADATION,
    THRUST_DRIFT,
    TRANSLATIONAL_LIFT,
)
from thrustmargin.models.effects.demand import EXTRA_MASS, LOAD_FACTOR, PARASITE_DRAG
from thrustmargin.models.effects.flow_moment import FLOW_MOMENT
from thrustmargin.models.effects.inputs import ROTOR_SPEED_LAG, SENSOR_LAG, TANK_SCALE, WIND
from thrustmargin.models.effects.moments import (
    CG_OFFSET,
    CG_OFFSET_TANK,
    MANOEUVRE_MOMENT,
    YAW_TRIM,
)
from thrustmargin.models.effects.slung_load import SLUNG_LOADS

CATALOGUE: tuple[Effect, ...] = (
    WIND,
    TANK_SCALE,
    SENSOR_LAG,
    ROTOR_SPEED_LAG,
    EXTRA_MASS,
    PARASITE_DRAG,
    LOAD_FACTOR,
    *SLUNG_LOADS,
    CG_OFFSET,
    CG_OFFSET_TANK,
    YAW_TRIM,
    MANOEUVRE_MOMENT,
    AIR_DENSITY,
    TRANSLATIONAL_LIFT,
    CLIMB_INFLOW,
    GROUND_EFFECT,
    ROTOR_DEGRADATION,
    *ONSETS,
    THRUST_DRIFT,
    BATTERY_VOLTAGE,
)

#: Effects that are looked for only where a search is given them.
ON_REQUEST: tuple[Effect, ...] = (FLOW_MOMENT,)

__all__ = ["CATALOGUE", "ON_REQUEST", "Effect", "Kind", "Parameter", "Placed"]
