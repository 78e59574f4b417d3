"""Represent the day that a fill is computed for: air, wind and battery, each value with its source.

Whoever states a fill states the `Day` with it. A fill without its day means little: the fill of one
aircraft and mission moves from 3 to 13 kg with the air temperature and the battery.

Each value comes from the first of these that has it:

    option      the user stated it for this command
    file        the user stated it in the file of --day
    log         the log that the command works on
    link        the vehicle that is heard now
    plan        the plan that the command works on
    remembered  stated by the user for an earlier command of the day
    earlier     what the known aircraft's earlier flights had
    default     nobody knows: one cautious set for all commands, `default_day`

The default is hot air at sea level without wind. The battery is a full one where its capacity is
known, so that a forecast can follow its fall. Otherwise it is a half used one, held at its nominal
voltage under load.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from enum import StrEnum

from thrustmargin.models.physics.atmosphere import (
    G0,
    GAS_CONSTANT,
    STATED_TEMPERATURE_ERROR,
    air_density,
    isa_pressure,
    pressure_altitude,
)

NAN = math.nan
ZERO_CELSIUS = 273.15  # K
#: °C: a hot day of the season. It is the standard atmosphere's 15 °C and 1.5 standard errors of
#: weather more, so colder days carry more than the default.
DEFAULT_AIR_C = 30.0
CELL = 3.7  # V, nominal, of a lithium polymer cell
FULL_CELL = 4.2  # V of a full cell at rest


class DaySource(StrEnum):
    """The source of one value of a day, the preferred first."""

    OPTION = "option"
    FILE = "file"  # of --day
    LOG = "log"
    LINK = "link"
    PLAN = "plan"
    REMEMBERED = "remembered"
    EARLIER = "earlier flights"  # of the known aircraft
    DEFAULT = "default"
    STANDARD = "standard"  # the standard atmosphere, in which a flight without thermometer is seen

    @property
    def rank(self) -> int:
        """Return the place of the source in the order of preference: 0 for the preferred."""
        return list(DaySource).index(self)

    @property
    def stated(self) -> bool:
        """Return True if the user stated the value for this command."""
        return self in (DaySource.OPTION, DaySource.FILE)

    @property
    def assumed(self) -> bool:
        """Return True if nobody reported or stated the value."""
        return self in (DaySource.DEFAULT, DaySource.STANDARD)


@dataclass(frozen=True, slots=True)
class DayValue:
    """A value of a day's air, wind or battery with its source; NaN where unknown."""

    value: float = NAN
    source: DaySource = DaySource.DEFAULT
    error: float = 0.0  # standard error, in the unit of the value
    at_s: float = NAN  # s of the flight at which it was measured
    given_at: str = ""  # local time, such as 09:12, at which a remembered value was stated

    @property
    def known(self) -> bool:
        """Return True if the value is a number."""
        return math.isfinite(self.value)


UNKNOWN_VALUE = DayValue()


def stated_value(
    name: str, value: float, source: DaySource = DaySource.OPTION, *, given_at: str = ""
) -> DayValue:
    """Return a user's `value`, in SI, for the field `name` of a day.

    An air temperature has the same standard error as one stated for a log; every other value has
    none (0). `given_at` is the time of the statement in words, empty if not known.
    """
    error = STATED_TEMPERATURE_ERROR if name == "air_temperature" else 0.0
    return DayValue(value, source, error, given_at=given_at)


@dataclass(frozen=True, slots=True, kw_only=True)
class Day:
    """The air, wind and battery that a fill is computed for, each with its source."""

    air_temperature: DayValue = UNKNOWN_VALUE  # K
    pressure: DayValue = UNKNOWN_VALUE  # Pa at the field, not reduced to sea level
    height: DayValue = UNKNOWN_VALUE  # m of the field above the sea
    wind: DayValue = UNKNOWN_VALUE  # m/s
    gusts: DayValue = UNKNOWN_VALUE  # m/s of wind in gusts
    battery_voltage: DayValue = UNKNOWN_VALUE  # V at rest, at the start
    battery_resistance: DayValue = UNKNOWN_VALUE  # ohm of the whole battery
    battery_capacity_ah: DayValue = UNKNOWN_VALUE
    #: V under load, instead of `battery_voltage` and resistance, where that is what is known.
    loaded_voltage: DayValue = UNKNOWN_VALUE

    @property
    def density(self) -> float:
        """Return the density of the air at the field, kg/m³; NaN where unknown."""
        return float(air_density(self.air_pressure, self.air_temperature.value))

    @property
    def density_error(self) -> float:
        """Return the standard error of the air density as a share of it, by the values' errors."""
        warm = self.air_temperature
        of_pressure = self.height.error * G0 / (GAS_CONSTANT * warm.value)
        if self.pressure.known:
            of_pressure = self.pressure.error / self.pressure.value
        return math.hypot(warm.error / warm.value, of_pressure)

    @property
    def air_pressure(self) -> float:
        """Return the pressure at the field, Pa, by `height` where none is stated; NaN unknown."""
        return (
            self.pressure.value if self.pressure.known else float(isa_pressure(self.height.value))
        )

    @property
    def field_height(self) -> float:
        """Return the height of the field, m above the sea, by pressure where none is stated."""
        return (
            self.height.value if self.height.known else float(pressure_altitude(self.air_pressure))
        )

    @property
    def battery_assumed(self) -> bool:
        """Return True if nobody reported or stated the voltage of the battery."""
        return (
            self.loaded_voltage if self.loaded_voltage.known else self.battery_voltage
        ).source.assumed


UNKNOWN_DAY = Day()
#: Pairs of fields that state one fact: the one from the better source is kept.
_INSTEAD = (("pressure", "height"), ("loaded_voltage", "battery_voltage"))


def merged(*days: Day) -> Day:
    """Merge days: take each value from the best source (see `DaySource`); of equals, the first
    day's.

    Pressure and height state one quantity, and so do the voltages under load and at rest: the one
    from the better source replaces the other.
    """
    values = {one.name: _best([getattr(day, one.name) for day in days]) for one in fields(Day)}
    for pair in _INSTEAD:
        first, second = (values[name] for name in pair)
        if first.known and second.known and first.source is not second.source:
            worse = max(pair, key=lambda name: values[name].source.rank)
            values[worse] = UNKNOWN_VALUE
    return Day(**values)


def _best(values: list[DayValue]) -> DayValue:
    known = [value for value in values if value.known]
    return min(known, key=lambda value: value.source.rank) if known else UNKNOWN_VALUE


def default_day(nominal_voltage: float, *, falls: bool) -> Day:
    """Return the values assumed for unknown ones, which are the same for all commands.

    `nominal_voltage` is the battery's, V, NaN where unknown. `falls`: the capacity is known, so the
    voltage can be computed from a full battery down. Without it the battery is half used.
    """
    still, sea = DayValue(0.0), DayValue(0.0)
    day = Day(
        air_temperature=DayValue(DEFAULT_AIR_C + ZERO_CELSIUS), height=sea, wind=still, gusts=still
    )
    if falls:
        return replace(day, battery_voltage=DayValue(full_at_rest(nominal_voltage)))
    return replace(day, loaded_voltage=DayValue(nominal_voltage))


def complete_day(nominal_voltage: float, *days: Day) -> Day:
    """Merge `days`, as `merged` does, and fill values unknown in all of them with the defaults.

    `nominal_voltage` is the battery's, V, NaN where unknown.
    """
    known = merged(*days)
    return merged(known, default_day(nominal_voltage, falls=known.battery_capacity_ah.value > 0.0))


def cells_in_series(nominal_voltage: float) -> int:
    """Return the number of lithium polymer cells of a battery of `nominal_voltage` V; 0 unknown."""
    return round(nominal_voltage / CELL) if nominal_voltage > 0.0 else 0


def full_at_rest(nominal_voltage: float) -> float:
    """Return the voltage, V, at rest of a full battery of `nominal_voltage` V; NaN if that is
    unknown."""
    return FULL_CELL * cells_in_series(nominal_voltage) or NAN


@dataclass(frozen=True, slots=True)
class DayField:
    """Notation of one value of a day: in files, in JSON and as an option."""

    key: str  # in a file and in JSON
    option: str
    unit: str
    low: float
    high: float
    factor: float = 1.0  # SI = factor * written + offset
    offset: float = 0.0

    def to_si(self, written: float) -> float:
        """Convert a value in the unit that users write to SI."""
        return self.factor * written + self.offset

    def written(self, value: float) -> float:
        """Convert a value in SI to the unit that users write."""
        return (value - self.offset) / self.factor


#: Field of `Day` -> how it is written. The voltage under load is measured, never stated.
DAY_FIELDS = {
    "air_temperature": DayField(
        "air_temperature_c", "--air-temperature", "°C", -60.0, 60.0, offset=ZERO_CELSIUS
    ),
    "pressure": DayField("pressure_hpa", "--pressure", "hPa", 300.0, 1100.0, factor=100.0),
    "height": DayField("altitude", "--altitude", "m", -430.0, 9000.0),
    "wind": DayField("wind", "--wind", "m/s", 0.0, 60.0),
    "gusts": DayField("gusts", "--gusts", "m/s", 0.0, 60.0),
    "battery_voltage": DayField("battery_voltage", "--voltage", "V", 1.0, 1000.0),
    "battery_resistance": DayField(
        "battery_resistance_mohm", "--resistance", "mOhm", 0.0, 1000.0, factor=1e-3
    ),
    "battery_capacity_ah": DayField("battery_capacity_ah", "--capacity", "Ah", 0.1, 1000.0),
    "loaded_voltage": DayField("loaded_voltage", "", "V", 1.0, 1000.0),
}


#: Key of a value -> the value as people write it with its source; None where it is unknown.
DayJson = Mapping[str, Mapping[str, float | str] | None]


def day_json(day: Day) -> DayJson:
    """Return the day for JSON: each known value with its source, null where unknown.

    `error` is its standard error, `at_s` the second of the flight at which it was measured,
    `given_at` the local time at which it was stated; each only where there is one.
    """
    table: dict[str, dict[str, float | str] | None] = {}
    for name, how in DAY_FIELDS.items():
        value: DayValue = getattr(day, name)
        if not value.known:
            table[how.key] = None
            continue
        entry: dict[str, float | str] = {
            "value": round(how.written(value.value), 3),
            "source": value.source.value,
        }
        if value.error > 0.0:
            entry["error"] = round(value.error / how.factor, 3)
        if math.isfinite(value.at_s):
            entry["at_s"] = round(value.at_s, 1)
        if value.given_at:
            entry["given_at"] = value.given_at
        table[how.key] = entry
    return table
