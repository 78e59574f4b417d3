"""The largest fill over temperature, altitude and battery: numbers of page, JSON and console."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from thrustmargin.gcs_plugin.reports.shared import page_shell
from thrustmargin.gcs_plugin.reports.shared.page_shell import page_text, software_version
from thrustmargin.gcs_plugin.wording import report_words as words
from thrustmargin.gcs_plugin.wording.fill_words import amount, fill_advice, how_sure, safe_kg
from thrustmargin.gcs_plugin.wording.language import number, say
from thrustmargin.models.model.fill_limits import Fills, NextFill, before_take_off, largest_fills
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.physics.atmosphere import air_density, isa_pressure

ZERO_CELSIUS = 273.15  # K
#: V a cell of a lithium polymer battery, over its nominal 3.7: charged, half, and to be landed at.
BATTERY_STATES = {"charged": 4.1 / 3.7, "nominal": 1.0, "nearly empty": 3.5 / 3.7}


@dataclass(frozen=True, slots=True, kw_only=True)
class Day:
    """The conditions of a recommendation."""

    temperature_c: float  # of the air
    altitude: float  # m AMSL of the field
    voltage: float  # V of the battery under load
    airspeed: float  # m/s into the wind; NaN where the fill does not depend on it

    @property
    def words(self) -> str:
        return words.day_words(self.temperature_c, self.altitude, self.voltage, self.airspeed)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FillTable:
    """One recommendation, and the largest fill about it."""

    model: RotorModel
    day: Day
    limit: float  # share of a rotor's maximum thrust that may be in use
    rotor_lost: bool
    temperatures_c: tuple[float, ...]
    altitudes: tuple[float, ...]  # m AMSL
    voltages: dict[str, float]  # V by the state of the battery
    recommended: Fills  # of one condition
    around: Fills  # of all, state by state, in each altitude by altitude

    @property
    def advice(self) -> str:
        """The recommendation and its reason, as one sentence."""
        return fill_advice(self.fill, self.limit)

    @property
    def fill(self) -> NextFill:
        """The recommendation."""
        return before_take_off(self.recommended, self.model)

    @property
    def has_table(self) -> bool:
        """Whether a table of fills says anything: not without a tank, nor with a bad rotor."""
        return bool(self.model.airframe.tank_volume_l) and self.fill.reason != "unsound"

    def rows(self, state: str) -> list[tuple[str, list[str]]]:
        """For each altitude its name and the largest fills over the temperatures, for people."""
        made = []
        for row, altitude in enumerate(self.altitudes):
            first = (list(self.voltages).index(state) * len(self.altitudes) + row) * len(
                self.temperatures_c
            )
            cells = range(first, first + len(self.temperatures_c))
            made.append((number(altitude, "m", 0), [self._cell(k) for k in cells]))
        return made

    def _cell(self, k: int) -> str:
        fill = float(self.around.sure[k])
        if fill < 0.1:  # less than an amount shows
            return say("none")
        return (say("full, ") if self.around.reason[k] == "tank" else "") + amount(fill)


def fill_table(
    model: RotorModel,
    day: Day,
    *,
    limit: float,
    rotor_lost: bool,
    temperatures_c: Sequence[float],
    altitudes: Sequence[float],
) -> FillTable:
    """The recommendation for a day, and the table of temperatures, altitudes and battery states."""
    nominal = model.airframe.nominal_voltage
    voltages = {state: share * nominal for state, share in BATTERY_STATES.items()}
    grid = np.array(
        [(v, h, t) for v in voltages.values() for h in altitudes for t in temperatures_c]
    )

    def fills(volts: np.ndarray, height: np.ndarray, celsius: np.ndarray) -> Fills:
        return largest_fills(
            model,
            air_density(isa_pressure(height), celsius + ZERO_CELSIUS),
            volts,
            airspeed=day.airspeed,
            max_utilisation=limit,
            rotor_lost=rotor_lost,
        )

    one = (np.array([x]) for x in (day.voltage, day.altitude, day.temperature_c))
    return FillTable(
        model=model,
        day=day,
        limit=limit,
        rotor_lost=rotor_lost,
        temperatures_c=tuple(temperatures_c),
        altitudes=tuple(altitudes),
        voltages=voltages,
        recommended=fills(*one),
        around=fills(*grid.T),
    )


def temperatures(table: FillTable) -> list[str]:
    """The heads of the table."""
    return [number(celsius, "°C", 0) for celsius in table.temperatures_c]


def conditions(table: FillTable) -> list[str]:
    """What the recommendation holds for, a sentence each."""
    airframe = table.model.airframe
    sure = how_sure(table.fill)
    drag_unknown = table.model.network is None and table.day.airspeed > 0.0
    day = replace(table.day, airspeed=math.nan) if drag_unknown else table.day
    remarks = [
        say("For {day}.", day=day.words),
        *([f"{sure[:1].upper()}{sure[1:]}."] if sure else []),
        words.fill_limit(table.limit, rotor_lost=table.rotor_lost),
        say(words.NOTHING_KEPT_BACK),
        f"{say('Model')}: {table.model.description}.",
    ]
    if drag_unknown:
        remarks.append(say(words.NO_AIRSPEED_LEARNT))
    if not np.isfinite(airframe.max_takeoff_mass):
        remarks.append(say(words.NO_MAKERS_LIMIT))
    if airframe.guessed:
        remarks.append(words.guessed(airframe.guessed))
    return remarks


def json_text(table: FillTable) -> str:
    """The table as JSON; kg, and null where a fill is not known."""
    fill = table.fill
    bad = fill.reason == "unsound"
    shape = (len(table.voltages), len(table.altitudes), len(table.temperatures_c))
    made = {
        "schema": "thrustmargin.fill/2",
        "airframe": table.model.airframe.name,
        "model": table.model.description,
        "advice": table.advice,
        "recommended": {
            "fill_kg": safe_kg(fill),
            "fill_limit_kg": fill.limit_kg,
            "interval90_kg": [fill.low_kg, fill.high_kg],
            "reason": fill.reason,
            "temperature_c": table.day.temperature_c,
            "altitude_m": table.day.altitude,
            "voltage": table.day.voltage,
            "airspeed": table.day.airspeed,
        },
        "max_utilisation": table.limit,
        "one_rotor_lost": table.rotor_lost,
        "table": {
            "voltage": table.voltages,
            "altitude_m": table.altitudes,
            "temperature_c": table.temperatures_c,
            "fill_kg": [
                [[math.nan if bad else safe_kg(NextFill(kg=kg)) for kg in row] for row in state]
                for state in table.around.sure.reshape(shape).tolist()
            ],
        },
        "conditions": conditions(table),
        "software": software_version(),
    }
    return page_shell.json_text(made, digits=6)


def html_text(table: FillTable) -> str:
    """One page to print: the recommendation, what it holds for, and the table."""
    context = {"table": table, "conditions": conditions(table), "temperatures": temperatures}
    return page_text("thrustmargin.gcs_plugin.reports.fill", context, draws=False)
