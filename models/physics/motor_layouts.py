"""List motor layouts by name: place and spin of each motor, in the autopilot's order.

Bearings are in degrees from the nose, clockwise positive seen from above; positions are `_frd` in m
from the centre; spin is +1 counter-clockwise seen from above, -1 clockwise. Source:
`models/shipped/layouts.toml`, facts of ArduPilot's AP_MotorsMatrix.
"""

from __future__ import annotations

import tomllib
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from importlib import resources
from types import MappingProxyType
from typing import Any

import numpy as np

from thrustmargin.models.flight import Floats

#: FRAME_CLASS in ArduPilot's boot text "Frame: HEXA/X" -> its number.
FRAME_CLASSES = MappingProxyType(
    {
        "QUAD": 1,
        "HEXA": 2,
        "OCTA": 3,
        "OCTAQUAD": 4,
        "Y6": 5,
        "TRI": 7,
        "DODECAHEXA": 12,
        "DECA": 14,
    }
)
#: FRAME_TYPE in that text -> its number.
_TYPES = {"PLUS": 0, "X": 1, "V": 2, "H": 3, "PLUSREV": 6, "Y6B": 10, "Y6F": 11, "BF_X": 12}
_TYPES |= {"DJI_X": 13, "CW_X": 14, "I": 15, "X_REV": 18, "Y4": 19, "default": 1}
#: Half the height between the rotors of a coaxial pair, as a share of the arm: assumed.
_PAIR_HEIGHT = 0.1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MotorLayout:
    """An arrangement of R motors, motor 1 first."""

    name: str
    place: Floats  # (R, 2) forward and right, the farthest at 1
    spin: Floats  # (R,) +1 CCW, -1 CW
    lower: tuple[bool, ...]  # the lower rotor of a coaxial pair
    ardupilot: tuple[tuple[int, int], ...]  # FRAME_CLASS and FRAME_TYPE; type -1: all others

    @property
    def rotor_count(self) -> int:
        """Return the number of motors, R."""
        return self.spin.size

    def rotors(self, arm: float, lower_effectiveness: float = 1.0) -> list[dict[str, Any]]:
        """Return the [[rotors]] of an airframe file: for each a dict of `name`, `position_frd` (m)
        and `spin` ("cw" or "ccw").

        `arm` is the distance of the farthest rotor, m. Of a coaxial pair one rotor is above and one
        below the plane of the arms; lower ones also have `effectiveness`, a share.
        """
        coaxial = any(self.lower)
        names = rotor_names(self.place, self.lower)
        height = _PAIR_HEIGHT * arm if coaxial else 0.0
        table = []
        for name, place, spin, lower in zip(names, self.place, self.spin, self.lower, strict=True):
            rotor = {
                "name": name,
                "position_frd": [*(round(float(p) * arm, 5) for p in place), 0.0],
                "spin": "ccw" if spin > 0 else "cw",
            }
            paired = np.sum(np.all(np.isclose(self.place, place), axis=1)) > 1
            if paired:
                rotor["position_frd"][2] = round(height if lower else -height, 5)
            if lower:
                rotor["effectiveness"] = lower_effectiveness
            table.append(rotor)
        return table

    def mismatch(self, position_frd: Floats) -> str:
        """Describe how rotors at `position_frd` (R, 3) differ from this layout; empty if they
        agree.

        Only number and bearings are compared: order and spin are the file's own.
        """
        if len(position_frd) != self.rotor_count:
            return f"{self.name} has {self.rotor_count} rotors, not {len(position_frd)}"
        measured, own = (np.sort(bearings(p)) for p in (position_frd[:, :2], self.place))
        # Up to half of the smallest angle between two arms the nearer arm is unambiguous.
        steps = np.diff(np.unique(np.round(np.append(own, own[0] + 360.0), 3)))
        worst = min(
            np.max(np.abs((np.roll(measured, k) - own + 180.0) % 360.0 - 180.0))
            for k in range(-2, 3)
        )
        if worst >= 0.5 * np.min(steps):
            listed = ", ".join(f"{b:.0f}" for b in sorted(bearings(self.place)))
            return f"{self.name} has arms at {listed} deg from the nose, clockwise"
        return ""


def bearings(place: Floats) -> Floats:
    """Return the bearings, degrees, -180 to 180, of `place` (R, 2): forward and right."""
    angle = np.degrees(np.arctan2(place[:, 1], place[:, 0]))
    return np.where(angle <= -180.0 + 1e-9, 180.0, angle)


def rotor_names(place: Floats, lower: tuple[bool, ...]) -> list[str]:
    """Name each rotor by its place (R, 2 or 3): "front right", "left, lower", "front left 22.5".

    A number, the bearing in degrees, distinguishes rotors of one name. `lower` flags the lower
    rotors of coaxial pairs; empty if there are none.
    """
    sectors = [_sector(float(b)) for b in bearings(place)]
    if any(lower):
        sectors = [
            f"{name}, {'lower' if low else 'upper'}"
            for name, low in zip(sectors, lower, strict=True)
        ]
    often = Counter(sectors)
    return [
        f"{name} {abs(bearing):g}" if often[name] > 1 else name
        for name, bearing in zip(sectors, np.round(bearings(place), 1), strict=True)
    ]


def _sector(bearing: float) -> str:
    """Return the direction of a bearing in words."""
    end = "front" if abs(bearing) < 75.0 else "rear" if abs(bearing) > 105.0 else ""
    across = "" if not 15.0 <= abs(bearing) <= 165.0 else "right" if bearing > 0.0 else "left"
    return " ".join(word for word in (end, across) if word)


@cache
def motor_layouts() -> MappingProxyType[str, MotorLayout]:
    """Return every known layout, by name."""
    text = (resources.files("thrustmargin.models.shipped") / "layouts.toml").read_text("utf-8")
    return MappingProxyType({name: _layout(name, t) for name, t in tomllib.loads(text).items()})


def _layout(name: str, table: dict[str, Any]) -> MotorLayout:
    """Build a layout from its table in the file."""
    place, spin, lower = [], [], []
    for motor in table["motors"]:
        where, turns, *below = motor.split()
        if "," in where:
            place.append([float(v) for v in where.split(",")])
        else:
            angle = np.radians(float(where))
            place.append([np.cos(angle), np.sin(angle)])
        spin.append({"ccw": 1.0, "cw": -1.0}[turns])
        lower.append(below == ["lower"])
    places = np.array(place)
    return MotorLayout(
        name=name,
        place=places / np.max(np.hypot(*places.T)),
        spin=np.array(spin),
        lower=tuple(lower),
        ardupilot=tuple((int(c), int(t)) for c, t in table["ardupilot"]),
    )


def ardupilot_layout(frame_class: int, frame_type: int) -> MotorLayout | None:
    """Return the layout of ArduPilot's FRAME_CLASS and FRAME_TYPE; None if unknown."""
    for number in (frame_type, -1):
        for layout in motor_layouts().values():
            if (frame_class, number) in layout.ardupilot:
                return layout
    return None


def layout_of_rotors(position_frd: Floats, spin: Floats) -> MotorLayout | None:
    """Return the known layout whose motors, in order, have the rotors' bearings and spins.

    `position_frd` (R, 3) is in m; `spin` (R,) is 1 for counter-clockwise, -1 for clockwise.
    Bearings may differ by less than 15 degrees. None if no layout fits.
    """
    for layout in motor_layouts().values():
        if layout.rotor_count != len(position_frd) or np.any(layout.spin != spin):
            continue
        turned = bearings(position_frd[:, :2]) - bearings(layout.place)
        if np.max(np.abs((turned + 180.0) % 360.0 - 180.0)) < 15.0:
            return layout
    return None


def layout_of_text(texts: Iterable[str], frame_type: int = -2) -> MotorLayout | None:
    """Return the layout named by ArduPilot's boot text, as "Frame: HEXA/X"; None without one.

    `frame_type` is the FRAME_TYPE used for older firmware, whose text is "Frame: HEXA".
    """
    for text in texts:
        head, _, rest = text.strip().partition(": ")
        kind, _, shape = rest.partition("/")
        kind = kind.replace("_", "")
        if head == "Frame" and kind in FRAME_CLASSES:
            known = _TYPES.get(shape.split("/")[0], -2) if shape else frame_type
            return ardupilot_layout(FRAME_CLASSES[kind], known)
    return None


def class_rotors() -> dict[int, int]:
    """Return the number of rotors of each FRAME_CLASS, a tricopter included."""
    counts = {
        kind: layout.rotor_count
        for layout in motor_layouts().values()
        for kind, _ in layout.ardupilot
    }
    return {**counts, FRAME_CLASSES["TRI"]: 3}
