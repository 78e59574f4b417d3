"""A plan's forecast as JSON, schema thrustmargin.forecast/2, and row by row as CSV: ten a second.

Null in the one and empty in the other where a number is not known.

The card of `fill` for a vehicle to carry: largest fill by air and by the battery at rest.

A vehicle that is disarmed reads its battery at rest, and `fill` asks for the voltage under load.
So the card's voltages are those at rest, each less what steady flight with the plan's largest fill
lets it sag. No number of it is above the largest fill that keeps the limit all along the plan.

A plan's forecast on one page, as HTML and on A4: answer, chart over time, stretches, assumed.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from importlib import resources
from typing import TYPE_CHECKING, Any

import jinja2
import numpy as np
from markupsafe import Markup

from thrustmargin.gcs_plugin.reports.shared import page_shell
from thrustmargin.gcs_plugin.reports.shared import plot_style as style
from thrustmargin.gcs_plugin.reports.shared.page_shell import packed, page_text, software_version
from thrustmargin.gcs_plugin.wording import forecast_words as words
from thrustmargin.gcs_plugin.wording.fill_words import safe_kg
from thrustmargin.gcs_plugin.wording.forecast_words import (
    assumed_words,
    gate_limit,
    gate_sag,
    verdict,
)
from thrustmargin.gcs_plugin.wording.language import clean
from thrustmargin.gcs_plugin.wording.report_words import LEFT
from thrustmargin.gcs_plugin.wording.thrust_left import left_words
from thrustmargin.mission.forecast.battery import CELL, RESISTANCE, electric_power
from thrustmargin.mission.forecast.fill_along import LegForecast, worst_use
from thrustmargin.mission.forecast.plan_forecast import PlanForecast
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.analysis import worst_rotor
from thrustmargin.models.model.fill_limits import NextFill, largest_fills, steady_flight
from thrustmargin.models.model.rotor_model import identified_airframe
from thrustmargin.models.physics.atmosphere import air_density, isa_pressure
from thrustmargin.models.physics.day import ZERO_CELSIUS, day_json
from thrustmargin.models.physics.electric_power import UNMEASURED_POWER_ERROR, power_factors

if TYPE_CHECKING:
    from thrustmargin.mission.forecast.plan_flight import PlanConditions


def conditions_json(given: PlanConditions) -> dict[str, Any]:
    """Return a forecast's conditions as a dict for JSON, by the names that files use.

    The liquid at take-off is `tank_start_kg` there, because `fill_kg` is a safe fill in files.
    """
    named = {f.name: getattr(given, f.name) for f in fields(given)}
    return {"tank_start_kg": named.pop("fill_kg"), **named}


def json_text(made: PlanForecast) -> str:
    """Return the forecast as JSON, schema "thrustmargin.forecast/2".

    Units are in the keys; a key without one is in SI, and utilisation is a share of a rotor's
    largest thrust. Unknown numbers are null.
    """
    use, weakest = made.advised.advice.use, made.weakest
    sorties = () if made.needs.short_of else made.needs.sorties  # no split is possible
    content = {
        "schema": "thrustmargin.forecast/2",
        "verdict": {"level": made.level, "words": verdict(made), "caveats": made.clearance.caveats},
        "known_from": made.clearance.known_from and made.clearance.known_from.to_json(),
        "conditions": conditions_json(made.given),  # `report --assumed` reads them
        "day": day_json(made.day),
        "flight_s": made.flight_s,
        "tank_end_kg": float(made.flight.track.tank_kg[-1]),
        "energy_wh": made.energy_wh[0],
        "energy_interval_wh": made.energy_wh[1:],
        "landing_voltage": made.landing_voltage[0],
        "landing_voltage_interval": made.landing_voltage[1:],
        "power": _power(made),
        "as_flown": made.as_flown,
        "utilisation": {
            "typical": use.lasting_most,
            "peak": use.peak,
            "peak_interval": weakest and weakest.interval,
        },
        "weakest": weakest and {"what": weakest.kind, **asdict(weakest)},
        "places": made.places,
        "fill_kg": safe_kg(NextFill(kg=made.largest_fill_kg)),
        "rotor_loss_survivable_below_kg": made.survivable_below_kg,
        "field": {
            "needed_kg": made.needed_kg,
            "lines_m": sum(s.lines for s in made.needs.sorties),
            "area_m2": made.swath * sum(s.lines for s in made.needs.sorties),
            "sorties": len(sorties) or None,
            "refills": len(sorties) - 1 if sorties else None,
            "sorties_at_largest_fill": made.sorties_at_largest or None,
        },
        "sorties": [
            {
                "items": [s.first_item, s.last_item],
                "refill": s.last_item if k + 1 < len(sorties) else None,
                "litres": s.kg / made.advised.analysis.model.airframe.liquid_density,
                "hectares": s.lines * made.swath / 1e4,
                "minutes": s.seconds / 60.0,
                "energy_wh": s.energy_wh,
            }
            for k, s in enumerate(sorties)
        ],
        "point_of_no_return": made.way_back,
        "sorties_short_of": made.needs.short_of or None,
        "legs": made.legs,
        "plan_faults": made.findings,
        "assumed": assumed_words(made),
        "not_understood": made.not_understood,
    }
    return page_shell.json_text(content, digits=8)


def _power(made: PlanForecast) -> dict[str, object]:
    """Return the flight's mean electric power as a dict for JSON: `mean_w` and `interval_w` (90 %).

    `basis` is "flights" where earlier flights of the aircraft measured its current, else "formula".
    `flights` and `days` count those flights. `mean_w` is NaN if the power is unknown.
    """
    flight, law = made.flight, made.advised.analysis.model.power
    mean = float(np.nanmean(flight.power)) if np.isfinite(flight.power).any() else math.nan
    return {
        "mean_w": mean,
        "interval_w": [factor * mean for factor in power_factors(flight.power_error)],
        "basis": "formula" if law is None else "flights",
        "flights": 0 if law is None else len(law.flights),
        "days": 0 if law is None else law.days,
        "coefficient_error": UNMEASURED_POWER_ERROR if law is None else law.error,
    }


def csv_text(made: PlanForecast) -> str:
    """Return the simulated flight as CSV, a row for each time step.

    The header states the units; unknown values are empty cells. Rotors and mission items have the
    numbers that the pilot sees, rotors from 1.
    """
    flight, analysis = made.flight, made.advised.analysis
    track = flight.track
    use, rotor = worst_rotor(analysis.utilisation_predicted)
    which = np.nan_to_num(rotor).astype(int)
    low, high = (end[np.arange(use.size), which] for end in analysis.use_ends)
    items = np.array([timed.leg.item for timed in flight.course.legs])
    columns = {
        "time [s]": track.time_s,
        "item": items[flight.course.active],
        "north [m]": track.position_ned[:, 0],
        "east [m]": track.position_ned[:, 1],
        "height above home [m]": -track.position_ned[:, 2],
        "speed over ground [m/s]": np.hypot(track.velocity_ned[:, 0], track.velocity_ned[:, 1]),
        "airspeed [m/s]": track.airspeed,
        "heading [deg]": np.degrees(track.attitude[:, 2]) % 360.0,
        "spraying [0/1]": track.spraying,
        "tank [kg]": track.tank_kg,
        "voltage [V]": track.voltage,
        "energy [Wh]": flight.energy_wh,
        "worst rotor": rotor + 1.0,
        "utilisation [1]": use,
        "utilisation low [1]": low,
        "utilisation high [1]": high,
        "redundancy yaw uncontrolled [1]": analysis.redundancy_yaw_uncontrolled,
    }
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(columns)
    for row in zip(*(values.tolist() for values in columns.values()), strict=True):
        rows.writerow(["" if math.isnan(value) else f"{value:.6g}" for value in row])
    return text.getvalue()


CELSIUS = np.arange(-10.0, 51.0, 5.0)
AT_REST = np.arange(3.6, 4.21, 0.05)  # V a cell
SCRIPTS = "thrustmargin.gcs_plugin.reports.forecast"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FillCard:
    """Largest fills (C, V) kg at C air temperatures and V voltages at rest."""

    fill_kg: Floats
    celsius: Floats  # (C,) at `pressure`
    rest_voltage: Floats  # (V,) V
    pressure: float  # Pa
    resistance: float  # ohm of the battery


def fill_card(made: PlanForecast) -> FillCard:
    """Compute the largest tank fill, kg, over air temperature and the battery's voltage at rest.

    It is the smaller one of hover and of flight at the plan's highest airspeed, in the plan's air
    pressure, and at most the plan's own largest fill; rounded down to 0.1 kg, and never more in
    hotter air or at a lower voltage. An unknown resistance of the battery is estimated from its
    capacity. Raise DataError if the plan's largest fill, the number of cells, or both capacity and
    resistance are unknown, or if the model predicts nothing in some of the air.
    """
    model, limit = made.advised.analysis.model, made.advised.advice.limit
    craft = identified_airframe(model)
    cells = round(craft.nominal_voltage / CELL) if craft.nominal_voltage > 0.0 else 0
    battery = made.given.battery
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
        power = float(electric_power(model, thin.prediction)[0])
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


def gate_text(made: PlanForecast, card: FillCard, *, plan: str, refuse: bool) -> str:
    """Return a Lua script for the vehicle that compares the tank's content before arming with
    `card`.

    `card` is the table of largest fills, `plan` the plan's name for a comment. If more is in the
    tank, the script warns, or with `refuse` refuses to arm. Without an outside thermometer on the
    vehicle it uses the air temperature of the forecast's day.
    """
    model, warm = made.advised.analysis.model, made.day.air_temperature
    air = warm.value - ZERO_CELSIUS
    template = jinja2.Template(
        (resources.files(SCRIPTS) / "fill_gate.lua").read_text(encoding="utf-8"),
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
        air_from="def" if warm.source.assumed else "plan",
        celsius=_numbers(card.celsius, 0),
        volts=_numbers(card.rest_voltage, 2),
        rows=[_numbers(row, 1) for row in card.fill_kg],
    )


def _comment(text: str) -> str:
    """Return `text` as one line of at most 90 ASCII characters, for a comment in a script.

    So the name of a file cannot end the comment.
    """
    return clean(text).encode("ascii", "replace").decode()[:90]


def _numbers(values: Floats, digits: int) -> str:
    return ", ".join(f"{value:.{digits}f}" for value in values)


SHOWN = 8  # stretches on the page itself, that it stays one on paper
MOST = 500  # that are folded below it


def html_text(made: PlanForecast, name: str) -> str:
    """Return the forecast of the plan called `name` as an HTML page that loads nothing from a
    network.
    """
    return _page(made, name, {"use": packed(_chart(made).to_json())})


def pdf_bytes(made: PlanForecast, name: str) -> bytes:
    """Return the forecast's page as a PDF on A4."""
    from thrustmargin.gcs_plugin.reports.paper import pdf_page

    figures = {"use": _chart(made)}
    return pdf_page.pdf_bytes(_page(made, name, dict.fromkeys(figures, Markup())), figures)


def _page(made: PlanForecast, name: str, figures: Mapping[str, Markup]) -> str:
    call, _, reason = words.verdict(made).partition(": ")
    context = {
        "name": name,
        "level": made.level.value,
        "call": call,
        "reason": reason,
        "first": (
            words.fill_words(made),
            words.weakest_words(made.weakest),
            *words.place_words(made),
            words.survivable_words(made),
        ),
        "needs": [
            *(line.strip() for line in words.sortie_words(made)),
            *words.power_words(made),
            *words.as_flown_words(made),
            words.way_back_words(made),
        ],
        "all_legs": made.legs,
        "shown": hardest(made.legs),
        "most": MOST,
        "kinds": words.STRETCHES,
        "left": lambda use, low=math.nan, high=math.nan: left_words(
            1.0 - use, 1.0 - high, 1.0 - low
        ),
        "assumed": words.assumed_words(made),
        "faults": words.plan_faults(made),
        "model": made.advised.analysis.model.description,
        "figures": figures,
    }
    return page_text(__name__.rpartition(".")[0], context)


def hardest(legs: Sequence[LegForecast]) -> Sequence[LegForecast]:
    """Return the stretches with the largest peaks of utilisation, up to SHOWN, in the order of
    flight."""
    if len(legs) <= SHOWN:
        return legs
    peaks = np.nan_to_num([leg.utilisation_peak for leg in legs], nan=-1.0)
    kept = np.sort(np.argsort(-peaks, kind="stable")[:SHOWN])
    return [legs[k] for k in kept]


def _chart(made: PlanForecast) -> style.Figure:
    """Draw the worst rotor's thrust left, %, with its interval, over the time of the forecast
    flight.

    Below it are the tank, kg, of an aircraft that has one, and the battery's voltage, if known.
    """
    track, limit = made.flight.track, made.advised.advice.limit
    time_s = track.time_s
    use, reach = (100.0 * part for part in worst_use(made.advised.analysis, slice(None)))
    left, least = 100.0 - use, 1.0 - limit
    traces = [
        style.below_limit(time_s, left, least),
        style.band(time_s, left - reach, left + reach, color=style.BAND),
        style.line(time_s, left, color=style.PREDICTED, name="worst rotor"),
    ]
    axis = style.left_axis(LEFT, np.append(left - reach, left + reach), least)
    panels = [style.Panel(traces=traces, axis=axis, height_px=180, limit=style.limit_across(least))]
    if made.advised.analysis.model.airframe.tank_capacity_kg > 0.0:
        tank = style.in_tank(time_s, track.tank_kg, track.spraying, "tank")
        full = {**style.titled("tank, kg"), "range": [0.0, 1.1 * float(track.tank_kg.max()) + 0.1]}
        panels.append(style.Panel(traces=tank, axis=full, height_px=64))
    if np.isfinite(track.voltage).any():
        volts = style.line(time_s, track.voltage, color=style.INK, name="battery", width=2)
        panels.append(style.Panel(traces=[volts], axis=style.titled("V"), height_px=64))
    return style.over_time(panels, end_s=float(time_s[-1]))
