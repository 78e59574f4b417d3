"""Field layouts of MAVLink messages as numpy dtypes, their checksums' extra bytes, and their text.

Layouts come from pymavlink's generated classes (ardupilotmega, which includes common). Some
messages of PX4 are in no dialect of pymavlink 2.4.50 and are given here as PX4 sends them.
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
    """One message: id, name, wire dtype without padding, and CRC_EXTRA."""

    id: int
    name: str
    dtype: np.dtype
    crc_extra: int


#: (id, CRC_EXTRA, fields in wire order), from the definitions in mavlink/mavlink common.xml.
_NOT_IN_PYMAVLINK = {
    "ESC_INFO": (
        290,
        251,
        [
            ("time_usec", "<u8"),
            ("error_count", "<u4", (4,)),
            ("counter", "<u2"),
            ("failure_flags", "<u2", (4,)),
            ("temperature", "<i2", (4,)),
            ("index", "u1"),
            ("count", "u1"),
            ("connection_type", "u1"),
            ("info", "u1"),
        ],
    ),
    "ESC_STATUS": (
        291,
        10,
        [
            ("time_usec", "<u8"),
            ("rpm", "<i4", (4,)),
            ("voltage", "<f4", (4,)),
            ("current", "<f4", (4,)),
            ("index", "u1"),
        ],
    ),
    # What a ground station asks for in the place of BATTERY_STATUS.
    "BATTERY_STATUS_V2": (
        369,
        151,
        [
            ("voltage", "<f4"),
            ("current", "<f4"),
            ("capacity_consumed", "<f4"),
            ("capacity_remaining", "<f4"),
            ("status_flags", "<u4"),
            ("temperature", "<i2"),
            ("id", "u1"),
            ("percent_remaining", "u1"),
        ],
    ),
    "BATTERY_INFO": (
        372,
        26,
        [
            ("discharge_minimum_voltage", "<f4"),
            ("charging_minimum_voltage", "<f4"),
            ("resting_minimum_voltage", "<f4"),
            ("charging_maximum_voltage", "<f4"),
            ("charging_maximum_current", "<f4"),
            ("nominal_voltage", "<f4"),
            ("discharge_maximum_current", "<f4"),
            ("discharge_maximum_burst_current", "<f4"),
            ("design_capacity", "<f4"),
            ("full_charge_capacity", "<f4"),
            ("cycle_count", "<u2"),
            ("weight", "<u2"),
            ("id", "u1"),
            ("battery_function", "u1"),
            ("type", "u1"),
            ("state_of_health", "u1"),
            ("cells_in_series", "u1"),
            ("manufacture_date", "S9"),
            ("serial_number", "S32"),
            ("name", "S50"),
        ],
    ),
    "FUEL_STATUS": (
        371,
        10,
        [
            ("maximum_fuel", "<f4"),
            ("consumed_fuel", "<f4"),
            ("remaining_fuel", "<f4"),
            ("flow_rate", "<f4"),
            ("temperature", "<f4"),
            ("fuel_type", "<u4"),
            ("id", "u1"),
            ("percent_remaining", "u1"),
        ],
    ),
}

#: Fields that were added to the end of messages of pymavlink 2.4.50 (mavlink/mavlink common.xml): a
#: frame longer than its layout would count as none.
_ADDED = {
    "MISSION_CURRENT": [("mission_id", "<u4"), ("fence_id", "<u4"), ("rally_points_id", "<u4")],
}


@cache
def layouts() -> Mapping[int, Layout]:
    """Every known message by id."""
    known: dict[int, Layout] = {}
    for number, message in ardupilotmega.mavlink_map.items():
        letters = bytes(message.native_format).decode()[1:]
        fields = []
        for name, letter, length in zip(
            message.ordered_fieldnames, letters, message.array_lengths, strict=True
        ):
            if letter == "c":
                fields.append((name, f"S{max(length, 1)}"))
            elif length:
                fields.append((name, "<" + letter, (length,)))
            else:
                fields.append((name, "<" + letter))
        fields += [added for added in _ADDED.get(message.msgname, ()) if added not in fields]
        known[number] = Layout(number, message.msgname, np.dtype(fields), message.crc_extra)
    for name, (number, extra, fields) in _NOT_IN_PYMAVLINK.items():
        known[number] = Layout(number, name, np.dtype(fields), extra)
    return MappingProxyType(known)


@dataclass(frozen=True, slots=True, eq=False)
class LayoutTable:
    """Payload size and CRC_EXTRA by message id, for looking up whole arrays of ids."""

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
