"""How a log or a link is read: the options that several commands take alike, and their check."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

import tyro
from tyro.constructors import PrimitiveConstructorSpec

from thrustmargin.gcs_plugin.commands.shared.options import UsageError, check_range
from thrustmargin.models.errors import LogError

#: °C. No multirotor flies outside these.
COLDEST_C, HOTTEST_C = -60.0, 60.0
MOST_KG = 10_000.0  # no multirotor lifts more

#: A limit, which help shows in percent as pages do; `as_read` has made a share of what is typed.
Share = Annotated[
    float,
    PrimitiveConstructorSpec(
        nargs=1,
        metavar="PERCENT",
        instance_from_str=lambda words: float(words[0]),
        is_instance=lambda value: isinstance(value, float),
        str_from_instance=lambda value: [f"{100.0 * value:g}%"],
    ),
]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadingOptions:
    """What the user says of the flight: which aircraft, what was on board, and the air of the day.

    Example: --load 8 --load-end 2 --air-temperature 18
    """

    vehicle: int | None = None
    """System id of the aircraft, when there are several."""
    tank: str = "auto"
    """Where the tank level comes from: auto, none, pump, "NAMED_VALUE_FLOAT NAME",
    "FUEL_STATUS ID" or "BATTERY_STATUS ID"; auto is what the airframe file names (tank_source),
    else the best that is heard."""
    tank_start_kg: Annotated[float | None, tyro.conf.arg(metavar="KG")] = None
    """kg in the tank at the start, for a tank without a gauge whose pump output is reported."""
    load: Annotated[float | None, tyro.conf.arg(metavar="KG")] = None
    """kg of liquid or payload on board at the start, taken instead of any gauge; falls with the
    pump's output where that is reported, else stays."""
    load_end: Annotated[float | None, tyro.conf.arg(metavar="KG")] = None
    """kg on board at the end, to which --load falls."""
    air_temperature_c: Annotated[
        float | None, tyro.conf.arg(name="air-temperature", metavar="C")
    ] = None
    """Outside air temperature of the day in °C; without it the autopilot's own reading less what
    its board is warmer, else the standard atmosphere."""

    @property
    def states_load(self) -> bool:
        """Whether the user says what was on board at the start."""
        return self.load is not None or self.tank_start_kg is not None


#: Nothing is stated of the flight: all is as it is heard.
AS_HEARD = ReadingOptions()
#: As a parameter of a command: its options appear among the command's own.
Reading = Annotated[ReadingOptions, tyro.conf.OmitArgPrefixes]


def reading_keywords(reading: ReadingOptions) -> dict[str, Any]:
    """The options as `read_log` and `WatchSettings` take them, checked.

    Raises UsageError when one of them is impossible or two exclude each other.
    """
    # Imported here: the MAVProxy module loads this file at once and must stay light.
    from thrustmargin.gcs_plugin.telemetry.tank_source import check_source

    given = {
        "--tank-start-kg": reading.tank_start_kg,
        "--load": reading.load,
        "--load-end": reading.load_end,
    }
    for option, mass in given.items():
        if mass is not None and not 0.0 <= mass <= MOST_KG:
            raise UsageError(
                f"{option} {mass:g} is no mass on board; give kg, 0 or more, at most {MOST_KG:g}"
            )
    check_range("--vehicle", reading.vehicle, 1, 255)
    try:
        check_source(reading.tank)
    except LogError as error:
        raise UsageError(f"--tank: {error}") from error
    load, end, celsius = reading.load, reading.load_end, reading.air_temperature_c
    if load is not None:
        other = reading.tank_start_kg is not None or reading.tank.strip().lower() != "auto"
        if other:
            raise UsageError(
                "--load states what is on board, whatever --tank or --tank-start-kg would find; "
                "give one of them"
            )
    if end is not None and (load is None or end > load):
        start = "no --load" if load is None else f"--load {load:g}"
        raise UsageError(f"--load-end {end:g} with {start}; give a --load of {end:g} or more")
    if celsius is not None and not COLDEST_C <= celsius <= HOTTEST_C:
        raise UsageError(
            f"--air-temperature {celsius:g} is outside {COLDEST_C:g} to {HOTTEST_C:g} °C; "
            "give the outside air of the day in °C"
        )
    return {
        "vehicle": reading.vehicle,
        "tank": reading.tank,
        "tank_start_kg": reading.tank_start_kg,
        "load": load,
        "load_end": end,
        "air_temperature": None if celsius is None else celsius + 273.15,
    }
