"""Make an anonymous copy of a telemetry log (.tlog) that yields equal margins.

Only the inputs of a margin are copied, and of vehicles alone: signals, and the parameters of frame,
motors, battery, sprayer and airspeed sensor. Texts, missions, commands, serial numbers, raw GPS and
messages of ground stations are removed. Vehicles are renumbered from 1. Places are moved together,
the first to 0° N 30° W in the Atlantic; the shape of the route, heights and times are unchanged.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pymap3d
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.logs.tlog import vehicle_systems
from thrustmargin.gcs_plugin.mavlink.decode import MAVLINK_RULES
from thrustmargin.gcs_plugin.mavlink.frame import V2, checksum
from thrustmargin.gcs_plugin.mavlink.layouts import layouts
from thrustmargin.gcs_plugin.mavlink.scan import PADDING, STAMP, Frames, columns, read_bytes, scan
from thrustmargin.gcs_plugin.wording.language import piece, printable
from thrustmargin.models.errors import LogError

#: Messages whose latitude and longitude (1e-7 °) and altitude (mm) are moved.
PLACES = {
    rule.message: rule.fields
    for rule in MAVLINK_RULES
    if rule.channel in ("geodetic", "home", "ekf_origin")
}
SCALES = (1e-7, 1e-7, 1e-3)
NEW_PLACE = (0.0, -30.0)  # °; not 0, 0, which means no fix
_KEPT = {rule.message for rule in MAVLINK_RULES} | {"HEARTBEAT", "SYSTEM_TIME", "SYS_STATUS"}
_PARAMETER = re.compile(
    r"(?!.*(SERIAL|DEVID|_SN$))(Q_)?(FRAME|SERVO|MOT_|M_|THR_M|ENABLE|BAT|CA_|SYS_AUTOSTART|SPRAY|ARSPD"
    r"|RC\d+_M(IN|AX)|RCMAP_THROTTLE|PWM_)"
)
_TEXT = re.compile(r"Frame: [A-Z0-9_]+(/[A-Z0-9_]+)?")  # states how many rotors there are


def anonymous_copy(path: Path) -> bytes:
    """Return the bytes of an anonymous copy of the telemetry log (.tlog) at `path`.

    The copy keeps the vehicles' messages of known layout, as unsigned MAVLink 2 with their stamps;
    vehicles are numbered from 1. Write no file. Raise LogError if no vehicle is in it.
    """
    data, size = read_bytes(path, PADDING)
    frames = scan(data, size)
    system, component = frames.system, frames.component
    numbers = {old: new for new, old in enumerate(vehicle_systems(frames), 1)}
    if not numbers:
        raise LogError(f"{path.name}: no vehicle in it")
    payloads = _payloads(frames, np.isin(system, list(numbers)))
    kept = np.zeros(frames.start.size, dtype=bool)
    kept[list(payloads)] = True
    sequence = frames.sequence.astype(np.int64)
    for sender in np.unique(256 * system.astype(int) + component):  # frames lost stay lost
        mine = 256 * system.astype(int) + component == sender
        sequence[mine] -= np.cumsum(~kept[mine])
    out = bytearray()
    for row in sorted(payloads):
        number, start = int(frames.id[row]), int(frames.start[row])
        payload = payloads[row].rstrip(b"\0") or b"\0"
        who = bytes([sequence[row] % 256, numbers[int(system[row])], component[row]])
        body = bytes([len(payload), 0, 0]) + who + number.to_bytes(3, "little") + payload
        sealed = checksum(body, layouts()[number].crc_extra)
        out += (
            data[start - STAMP : start].tobytes()
            + bytes([V2])
            + body
            + sealed.to_bytes(2, "little")
        )
    return bytes(out)


def _payloads(frames: Frames, of_vehicle: NDArray[np.bool_]) -> dict[int, bytes]:
    """Return the payload of each frame to copy, by row number, with positions shifted to NEW_PLACE.

    `of_vehicle` (n,) flags the frames of all vehicles. Messages that are not inputs of a margin,
    and parameters of no use for it, are left out.
    """
    payloads: dict[int, bytes] = {}
    origin: tuple[float, float] | None = None
    for number in np.unique(frames.id[of_vehicle]).tolist():
        layout = layouts()[number]
        rows = np.flatnonzero(of_vehicle & (frames.id == number))
        if layout.name not in (*_KEPT, "PARAM_VALUE", "STATUSTEXT"):
            continue
        values = columns(frames, rows, layout).copy()
        if layout.name == "PARAM_VALUE":
            mine = [bool(_PARAMETER.match(printable(name))) for name in values["param_id"]]
        elif layout.name == "STATUSTEXT":
            mine = [bool(_TEXT.fullmatch(piece(text).strip())) for text in values["text"]]
        else:
            mine = [True] * rows.size
        if layout.name in PLACES:
            origin = _move(values, PLACES[layout.name], origin)
        elif {"lat", "lon", "latitude", "longitude"} & set(layout.dtype.names or ()):
            continue  # a place that is not known here must not get out
        for row, value, own in zip(rows.tolist(), values, mine, strict=True):
            if own:
                payloads[row] = value.tobytes()
    return payloads


def _move(
    values: NDArray[np.void], names: tuple[str, ...], origin: tuple[float, float] | None
) -> tuple[float, float] | None:
    """Shift latitude and longitude of messages, in place, by the same way that takes `origin` to
    NEW_PLACE.

    `names` are the fields of latitude, longitude (1e-7 °) and altitude (mm) in `values` (n,); the
    altitude stays. Latitude and longitude without a fix become 0. `origin` is the log's first fix,
    °, None if not found yet: then the first in `values`. Return it, None if there is none so far.
    """
    latitude, longitude, altitude = (values[n] * s for n, s in zip(names, SCALES, strict=True))
    fixed = ((latitude != 0.0) | (longitude != 0.0)) & (np.abs(latitude) <= 90.0)
    for name in names[:2]:
        values[name][~fixed] = 0
    if not fixed.any():
        return origin
    first = int(np.argmax(fixed))
    start = (float(latitude[first]), float(longitude[first])) if origin is None else origin
    location = (latitude[fixed], longitude[fixed], altitude[fixed])
    east, north, up = pymap3d.geodetic2enu(*location, start[0], start[1], 0.0)
    moved = pymap3d.enu2geodetic(east, north, up, NEW_PLACE[0], NEW_PLACE[1], 0.0)
    for name, place in zip(names[:2], moved[:2], strict=True):
        values[name][fixed] = np.round(np.asarray(place) * 1e7)
    return start
