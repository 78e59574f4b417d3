"""The largest fill over temperature, altitude and battery: numbers of page, JSON and console."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from thrustmargin.gcs_plugin.reports.shared import page_shell
from thrustmargin.gcs_plugin.reports.shared.page_shell import page_text, software_version
from thrustmargin.gcs_plugin.wording import report_words as words
from thrustmargin.gcs_plugin.wording.actions import shown_level
from thrustmargin.gcs_plugin.wording.check_words import last_known_words
from thrustmargin.gcs_plugin.wording.clearance_words import (
    first_steps,
    no_fill_words,
    only_if_words,
)
from thrustmargin.gcs_plugin.wording.day_words import THROUGH_AIR, ask_words, day_line
from thrustmargin.gcs_plugin.wording.fill_words import (
    FLIGHT_LEVELS,
    amount,
    fill_advice,
    how_sure,
    safe_kg,
)
from thrustmargin.gcs_plugin.wording.language import number, say
from thrustmargin.mission import SPRAY_SPEED
from thrustmargin.mission.day_fill import DayFill, Sensitive, day_fill, most_sensitive
from thrustmargin.models.model.advice import FlightLevel
from thrustmargin.models.model.clearance import GROUNDING, NO_FLIGHT, Clearance
from thrustmargin.models.model.fill_limits import (
    Fills,
    NextFill,
    largest_fills,
    unsound_fill,
)
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.physics.atmosphere import air_density, isa_pressure
from thrustmargin.models.physics.day import DAY_FIELDS, ZERO_CELSIUS, Day, day_json

#: V a cell of a lithium polymer battery, over its nominal 3.7: charged, half, and to be landed at.
BATTERY_STATES = {"charged": 4.1 / 3.7, "nominal": 1.0, "nearly empty": 3.5 / 3.7}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FillTable:
    """A recommended fill, and the largest fills in other conditions."""

    model: RotorModel
    found: DayFill  # the recommendation, with the day that it holds for
    sensitive: Sensitive | None  # the assumed value of the day that moves it most
    limit: float  # share of a rotor's maximum thrust that may be in use
    rotor_lost: bool
    temperatures_c: tuple[float, ...]
    altitudes: tuple[float, ...]  # m AMSL
    voltages: dict[str, float]  # V by the state of the battery
    around: Fills  # of all, state by state, in each altitude by altitude
    clearance: Clearance = NO_FLIGHT  # what the last flights of the aircraft leave open

    @property
    def advice(self) -> str:
        """Return the recommendation and its reason, as one sentence."""
        if self.grounded:
            return no_fill_words(self.clearance)
        return fill_advice(self.fill, self.limit)

    @property
    def fill(self) -> NextFill:
        """Return the recommended fill; one without numbers if the last flight grounds the
        aircraft."""
        return unsound_fill(self.found.fill) if self.grounded else self.found.fill

    @property
    def grounded(self) -> bool:
        """Return True if the last flights of the aircraft forbid its next take-off."""
        return self.clearance.level in GROUNDING

    @property
    def day(self) -> Day:
        """Return the day (air, wind, battery) that the recommendation is for."""
        return self.found.fill.day

    @property
    def level(self) -> FlightLevel:
        """Return the flight level whose colour the recommendation has."""
        level = FLIGHT_LEVELS[self.fill.level]
        return shown_level(level, left_open=self.clearance.conditions)

    @property
    def has_table(self) -> bool:
        """Return True if a table of fills has content: not without a tank, nor with a bad rotor."""
        return bool(self.model.airframe.tank_volume_l) and self.fill.reason != "unsound"

    def rows(self, state: str) -> list[tuple[str, list[str]]]:
        """Return the table's lines for one battery state, a key of `voltages`.

        A line is (altitude, [largest fill for each temperature]), all as texts with unit.
        """
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
    speed: float = SPRAY_SPEED,
    limit: float,
    rotor_lost: bool,
    temperatures_c: Sequence[float],
    altitudes: Sequence[float],
    clearance: Clearance = NO_FLIGHT,
) -> FillTable:
    """Compute the largest fill for a day, and a table of fills over temperature, altitude and
    battery.

    `day` must be complete. `speed` is m/s over the ground while spraying, `limit` the largest share
    of a rotor's thrust that may be used for long. `rotor_lost`: losing one rotor must be
    survivable. Altitudes are m above the sea. `clearance` is the consequence of the aircraft's
    earlier flights.
    """
    found = day_fill(model, day, speed=speed, limit=limit, rotor_lost=rotor_lost)
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
            airspeed=found.airspeed,
            max_utilisation=limit,
            rotor_lost=rotor_lost,
        )

    return FillTable(
        model=model,
        found=found,
        sensitive=most_sensitive(model, day, speed=speed, limit=limit),
        limit=limit,
        rotor_lost=rotor_lost,
        temperatures_c=tuple(temperatures_c),
        altitudes=tuple(altitudes),
        voltages=voltages,
        around=fills(*grid.T),
        clearance=clearance,
    )


def temperatures(table: FillTable) -> list[str]:
    """Return the column heads of the table, `20 °C`."""
    return [number(celsius, "°C", 0) for celsius in table.temperatures_c]


def conditions(table: FillTable) -> list[str]:
    """Return sentences on what the recommended fill assumes: day, airspeed, limits, model.

    Conditions and steps from earlier flights come first. Where drag is unknown, a sentence says so
    in place of the airspeed; missing limits of the maker and guessed values come last.
    """
    airframe = table.model.airframe
    sure = how_sure(table.fill)
    drag_unknown = table.model.network is None and table.found.airspeed > 0.0
    ask = table.sensitive
    through = say(THROUGH_AIR, speed=number(table.found.airspeed, "m/s"))
    known = table.clearance.known_from
    earlier = "" if known is None else last_known_words(known)
    remarks = [
        *only_if_words(table.clearance),
        *first_steps(table.clearance, grounded=table.grounded),
        *([f"{earlier[:1].upper()}{earlier[1:]}."] if earlier else []),
        day_line(table.day, table.found.voltage),
        *([] if ask is None else [ask_words(ask.name, ask.step, ask.kg)]),
        *([] if drag_unknown else [through]),
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
    """Return the recommendation and the table as JSON, schema "thrustmargin.fill/2".

    Fills are kg, null where unknown.
    """
    fill, ask = table.fill, table.sensitive
    bad = fill.reason == "unsound"
    shape = (len(table.voltages), len(table.altitudes), len(table.temperatures_c))
    made = {
        "schema": "thrustmargin.fill/2",
        "airframe": table.model.airframe.name,
        "known_from": table.clearance.known_from and table.clearance.known_from.to_json(),
        "model": table.model.description,
        "advice": table.advice,
        "recommended": {
            "fill_kg": safe_kg(fill),
            "fill_limit_kg": fill.limit_kg,
            "interval90_kg": [fill.low_kg, fill.high_kg],
            "reason": fill.reason,
            "fill_full_battery_kg": safe_kg(replace(fill, kg=fill.fresh_kg)),
            "voltage_under_load": table.found.voltage,
            "airspeed": table.found.airspeed,
        },
        "level": fill.level,
        "day": day_json(table.day),
        "ask": None
        if ask is None
        else {"option": DAY_FIELDS[ask.name].option, "step": ask.step, "moves_kg": ask.kg},
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
    """Return a printable HTML page with the recommendation, its day and the table."""
    context = {"table": table, "conditions": conditions(table), "temperatures": temperatures}
    return page_text("thrustmargin.gcs_plugin.reports.fill", context, draws=False)
