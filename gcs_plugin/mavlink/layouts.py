"""Provide the field layouts of MAVLink messages as numpy dtypes, with their CRC_EXTRA bytes.

Layouts come from pymavlink's generated classes (ardupilotmega, which includes common). Some
messages of PX4 are in no dialect of pymavlink 2.4.50 and are defined here as PX4 sends them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega

#: Message ids at or above this are treated as unknown; no dialect in use reaches it.
ID_LIMIT = 65536


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """The layout of one message: id, name, wire dtype without padding, and CRC_EXTRA."""

    id: int
    name: str
    dtype: np.dtype
    crc_extra: int


#: name -> id, CRC_EXTRA, fields in wire order, from the definitions in mavlink/mavlink common.xml.
_NOT_IN_PYMAVLINK = {
    "ESC_INFO": (
        290,
        251,
        "u8 time_usec, 4u4 error_count, u2 counter, 4u2 failure_flags, 4i2 temperature, "
        "u1 index, u1 count, u1 connection_type, u1 info",
    ),
    "ESC_STATUS": (
        291,
        10,
        "u8 time_usec, 4i4 rpm, 4f4 voltage, 4f4 current, u1 index",
    ),
    # What a ground station asks for in the place of BATTERY_STATUS.
    "BATTERY_STATUS_V2": (
        369,
        151,
        "f4 voltage, f4 current, f4 capacity_consumed, f4 capacity_remaining, "
        "u4 status_flags, i2 temperature, u1 id, u1 percent_remaining",
    ),
    "BATTERY_INFO": (
        372,
        26,
        "f4 discharge_minimum_voltage, f4 charging_minimum_voltage, "
        "f4 resting_minimum_voltage, f4 charging_maximum_voltage, "
        "f4 charging_maximum_current, f4 nominal_voltage, f4 discharge_maximum_current, "
        "f4 discharge_maximum_burst_current, f4 design_capacity, f4 full_charge_capacity, "
        "u2 cycle_count, u2 weight, u1 id, u1 battery_function, u1 type, u1 state_of_health, "
        "u1 cells_in_series, S9 manufacture_date, S32 serial_number, S50 name",
    ),
    "FUEL_STATUS": (
        371,
        10,
        "f4 maximum_fuel, f4 consumed_fuel, f4 remaining_fuel, f4 flow_rate, f4 temperature, "
        "u4 fuel_type, u1 id, u1 percent_remaining",
    ),
}

#: Fields that were added to the end of messages of pymavlink 2.4.50 (mavlink/mavlink common.xml): a
#: frame longer than its layout would count as none.
_ADDED = {"MISSION_CURRENT": "u4 mission_id, u4 fence_id, u4 rally_points_id"}


@cache
def layouts() -> Mapping[int, Layout]:
    """Return the Layout of every known message by message id; computed once, read-only."""
    known: dict[int, Layout] = {}
    for number, message in ardupilotmega.mavlink_map.items():
        name, names = message.msgname, message.ordered_fieldnames
        letters = bytes(message.native_format).decode()[1:]
        kinds = [
            f"S{max(length, 1)}" if letter == "c" else f"{length or ''}{letter}"
            for letter, length in zip(letters, message.array_lengths, strict=True)
        ]
        fields = _fields(", ".join(map(" ".join, zip(kinds, names, strict=True))))
        fields += [field for field in _fields(_ADDED.get(name, "")) if field[0] not in names]
        known[number] = Layout(number, name, np.dtype(fields), message.crc_extra)
    for name, (number, extra, text) in _NOT_IN_PYMAVLINK.items():
        known[number] = Layout(number, name, np.dtype(_fields(text)), extra)
    return MappingProxyType(known)


@cache
def message_ids() -> Mapping[str, int]:
    """Return the id of every known message by name."""
    return MappingProxyType({layout.name: number for number, layout in layouts().items()})


def _fields(text: str) -> list[tuple[str, np.dtype]]:
    """Parse field types and names from text such as `4u2 temperature, u1 index`."""
    pairs = (field.split() for field in text.split(", ") if field)
    return [(name, np.dtype(kind).newbyteorder("<")) for kind, name in pairs]


@dataclass(frozen=True, slots=True, eq=False)
class LayoutTable:
    """Payload size and CRC_EXTRA by message id, to look up whole arrays of ids."""

    size: np.ndarray  # (ID_LIMIT,) int16, -1 for an unknown id
    crc_extra: np.ndarray  # (ID_LIMIT,) uint8


@cache
def layout_table() -> LayoutTable:
    size = np.full(ID_LIMIT, -1, dtype=np.int16)
    extra = np.zeros(ID_LIMIT, dtype=np.uint8)
    for number, layout in layouts().items():
        if number < ID_LIMIT:
            size[number] = layout.dtype.itemsize
            extra[number] = layout.crc_extra
    return LayoutTable(size, extra)
