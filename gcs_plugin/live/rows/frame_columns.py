"""Fields of the frames that rows need, message by message, and the clocks that they carry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.mavlink.decode import MAVLINK_RULES
from thrustmargin.gcs_plugin.mavlink.frame import Frame
from thrustmargin.gcs_plugin.mavlink.layouts import layouts
from thrustmargin.gcs_plugin.telemetry.clock import REFERENCES, gps_times, own_clock
from thrustmargin.models.flight import Bools, Floats

_NEEDED = frozenset((*(rule.message for rule in MAVLINK_RULES), *REFERENCES, "SYSTEM_TIME"))


def _fields(frames: Sequence[Frame], places: Sequence[int]) -> NDArray[np.void]:
    """Fields of the frames at `places`, which are of one message."""
    layout = layouts()[frames[places[0]].id].dtype
    payloads = [frames[place].payload.ljust(layout.itemsize, b"\0") for place in places]
    return np.frombuffer(b"".join(payloads), dtype=layout)


def places_of(frames: Sequence[Frame]) -> dict[str, list[int]]:
    """Message -> places of its frames, of messages that rows need."""
    places: dict[str, list[int]] = {}
    for place, frame in enumerate(frames):
        if frame.verified and (name := layouts()[frame.id].name) in _NEEDED:
            places.setdefault(name, []).append(place)
    return places


def clocks_of(
    places: Mapping[str, list[int]], frames: Sequence[Frame], pilots: Sequence[int | None]
) -> Floats:
    """(n,) s since boot by frames of the autopilot, component `pilots` (n,); NaN where none."""
    own = np.full(len(frames), np.nan)
    for name in REFERENCES:
        main = [p for p in places.get(name, ()) if pilots[p] in (None, frames[p].component)]
        if main and (clock := own_clock(_fields(frames, main))) is not None:
            own[main] = clock
    return own


def grouped(
    places: Mapping[str, list[int]],
    frames: Sequence[Frame],
    pilots: Sequence[int | None],
    by_pilot: set[str],
) -> dict[str, tuple[NDArray[np.intp], NDArray[np.void]]]:
    """Message -> (places of its frames, their fields), of messages that rows need.

    Once the autopilot, component `pilots` (n,), has sent a message, which `by_pilot` remembers,
    what its companions say is left out.
    """
    groups = {}
    for name, found in places.items():
        chosen = []
        for place in found:
            if pilots[place] == frames[place].component:
                by_pilot.add(name)
            elif name in by_pilot:
                continue
            chosen.append(place)
        if chosen:
            groups[name] = (np.array(chosen), _fields(frames, chosen))
    return groups


def dated_by_gps(
    boots: NDArray[np.int64],
    groups: Mapping[str, tuple[NDArray[np.intp], NDArray[np.void]]],
    already: int | None,
) -> Bools:
    """(n,) whether a GPS time was heard in the start `boots` (n,) of a frame, in it or before.

    `already` is the start in which it was known before them, where no further one is looked for.
    """
    dated = np.zeros(boots.size, dtype=np.bool_)
    if "SYSTEM_TIME" in groups:
        at, columns = groups["SYSTEM_TIME"]
        at = at[gps_times(columns)]
        for boot in np.unique(boots[at]).tolist():
            if boot != already:
                dated |= (boots == boot) & (np.arange(boots.size) >= at[boots[at] == boot][0])
    return dated
