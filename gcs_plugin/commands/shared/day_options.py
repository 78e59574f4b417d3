"""The day that a command works for: what the user states, remembers, and what is assumed."""

from __future__ import annotations

from pathlib import Path

from thrustmargin.gcs_plugin.commands.shared.options import check_range, check_voltage
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
from thrustmargin.gcs_plugin.store.remembered_day import read_day, remember, remembered_day
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.day import (
    DAY_FIELDS,
    UNKNOWN_DAY,
    Day,
    DayValue,
    complete_day,
    merged,
    stated_value,
)


def stated_day(file: Path | None, **options: float | None) -> Day:
    """Return the conditions of a day that the user stated: options first, then those of `file`.

    `options` are by the fields of `Day`, in the unit of the command line; None is not stated.
    Raises UsageError for an impossible value, DataError for a file that is no day.
    """
    found: dict[str, DayValue] = {}
    for name, written in options.items():
        how = DAY_FIELDS[name]
        check_range(how.option, written, how.low, how.high, how.unit)
        if written is not None:
            found[name] = stated_value(name, how.to_si(written))
    return merged(Day(**found), UNKNOWN_DAY if file is None else read_day(file))


def day_of_command(craft: Airframe, stated: Day, console: Terminal, *known: Day) -> Day:
    """Return the complete conditions of the day, and store those that the user stated for later.

    The sources, in order: `stated`, `known` (days of the log and of the link), remembered ones,
    defaults. If they cannot be stored, that is printed. Raises UsageError for a voltage that the
    airframe's battery cannot have, DataError if the remembered day is damaged.
    """
    if stated.battery_voltage.known:
        check_voltage(stated.battery_voltage.value, craft)
    day = complete_day(craft.nominal_voltage, stated, *known, remembered_day())
    try:
        remember(stated)
    except OSError as error:
        console.print(f"the day is not remembered: {error.strerror or error}")
    return day
