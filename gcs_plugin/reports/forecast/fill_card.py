"""The card of `fill` for a vehicle to carry: largest fill by air and by the battery at rest.

A vehicle that is disarmed reads its battery at rest, and `fill` asks for the voltage under load.
So the card's voltages are those at rest, each less what steady flight with the plan's largest fill
lets it sag. No number of it is above the largest fill that keeps the limit all along the plan.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from importlib import resources

import jinja2
import numpy as np

from thrustmargin.gcs_plugin.mavlink.text import clean
from thrustmargin.gcs_plugin.reports.shared.page_shell import software_version
from thrustmargin.gcs_plugin.wording.plans.forecast_words import gate_limit, gate_sag
from thrustmargin.mission.ahead.battery import CELL, RESISTANCE, FlightBattery, rotor_power
from thrustmargin.mission.ahead.plan_forecast import PlanForecast
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.fill_limits import largest_fills, steady_flight
from thrustmargin.models.model.predict import identified_airframe
from thrustmargin.models.physics.atmosphere import (
    air_density,
    isa_pressure,
    isa_temperature,
    pressure_altitude,
)

ZERO_CELSIUS = 273.15  # K
CELSIUS = np.arange(-10.0, 51.0, 5.0)
AT_REST = np.arange(3.6, 4.21, 0.05)  # V a cell
SCRIPTS = "thrustmargin.gcs_plugin"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FillCard:
    """Largest fills (C, V) kg at C air temperatures and V voltages at rest."""

    fill_kg: Floats
    celsius: Floats  # (C,) at `pressure`
    rest_voltage: Floats  # (V,) V
    pressure: float  # Pa
    resistance: float  # ohm of the battery


def fill_card(made: PlanForecast, battery: FlightBattery) -> FillCard:
    """The card of the plan's aircraft, for the heights and speeds of the plan.

    Raises DataError where the fill is not known, or how far the battery sags.
    """
    model, limit = made.advised.analysis.model, made.advised.advice.limit
    craft = identified_airframe(model)
    cells = round(craft.nominal_voltage / CELL) if craft.nominal_voltage > 0.0 else 0
    resistance = battery.resistance
    if not resistance >= 0.0 and cells:
        resistance = cells * RESISTANCE / battery.capacity_ah
    if not (cells and resistance >= 0.0):
        raise DataError(
            "a script needs to know how far the battery sags under load; give --capacity or "
            "--resistance, and nominal_voltage in the airframe file"
        )
    if not math.isfinite(made.largest_fill_kg):
        raise DataError("no script is written: the largest fill of this plan is not known")
    track = made.flight.track
    pressure = float(isa_pressure(track.altitude[0]))
    fastest = float(np.nanmax(track.airspeed))
    rest = np.repeat(cells * AT_REST[None, :], CELSIUS.size, axis=0)
    density = np.repeat(
        air_density(pressure, CELSIUS + ZERO_CELSIUS)[:, None], AT_REST.size, axis=1
    )
    cap = np.array([made.largest_fill_kg])
    found = []
    for airspeed in (0.0, fastest):
        thin = steady_flight(model, float(density.min()), craft.nominal_voltage, airspeed, cap)
        flown_thin = thin.prediction
        power = float(rotor_power(craft, flown_thin.thrust, flown_thin.rotor_speed_rpm)[0])
        loaded = 0.5 * (rest + np.sqrt(np.maximum(rest**2 - 4.0 * resistance * power, 0.0)))
        fills = largest_fills(model, density, loaded, airspeed=airspeed, max_utilisation=limit)
        found.append(fills.sure.reshape(rest.shape))
    fill = np.minimum(np.min(found, axis=0), made.largest_fill_kg)
    if not np.isfinite(fill).all():
        raise DataError("no script is written: the model predicts nothing in some of that air")
    # Hotter or emptier never carries more.
    fill = np.minimum.accumulate(np.maximum(fill, 0.0), axis=0)
    fill = np.minimum.accumulate(fill[:, ::-1], axis=1)[:, ::-1]
    return FillCard(
        fill_kg=np.floor(fill * 10.0 + 1e-6) / 10.0,
        celsius=CELSIUS,
        rest_voltage=cells * AT_REST,
        pressure=pressure,
        resistance=resistance,
    )


def gate_text(
    made: PlanForecast,
    card: FillCard,
    *,
    plan: str,
    refuse: bool,
    air_temperature: float = math.nan,
) -> str:
    """Return the Lua script that compares what is in the tank with the card before arming.

    `air_temperature`, K, is what the plan was asked with; NaN is the standard of the card's
    pressure. The script takes it where the vehicle has no thermometer outside.
    """
    model = made.advised.analysis.model
    stated = math.isfinite(air_temperature)
    standard = float(isa_temperature(pressure_altitude(card.pressure)))
    air = (air_temperature if stated else standard) - ZERO_CELSIUS
    template = jinja2.Template(
        (resources.files(SCRIPTS) / "on_vehicle" / "fill_gate.lua").read_text(encoding="utf-8"),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        keep_trailing_newline=True,
    )
    return template.render(
        version=software_version(),
        aircraft=_comment(model.airframe.name),
        model=_comment(model.description),
        plan=_comment(plan),
        limit=gate_limit(made.advised.advice.limit),
        sag=gate_sag(card.resistance),
        refuse=refuse,
        planned=f"{made.flight.track.tank_kg[0]:.2f}",
        tank=f"{model.airframe.tank_capacity_kg:.2f}",
        pressure=f"{card.pressure:.0f}",
        air=f"{air:.1f}",
        air_from="plan" if stated else "std",
        celsius=_numbers(card.celsius, 0),
        volts=_numbers(card.rest_voltage, 2),
        rows=[_numbers(row, 1) for row in card.fill_kg],
    )


def _comment(text: str) -> str:
    """One line of ASCII, which no name of a file can leave."""
    return clean(text).encode("ascii", "replace").decode()[:90]


def _numbers(values: Floats, digits: int) -> str:
    return ", ".join(f"{value:.{digits}f}" for value in values)
