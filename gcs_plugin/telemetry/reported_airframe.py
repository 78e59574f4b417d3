"""What a vehicle's own parameters say of its airframe: layout, motors, battery. The rest is asked.

ArduPilot: FRAME_CLASS, FRAME_TYPE, SERVOn_FUNCTION, MOT_*, BATT_*, SERVO_BLH_POLES.
PX4: CA_ROTORn_PX, _PY, _PZ (forward, right, down, m) and _KM (torque over thrust, m; above 0 turns
counter-clockwise), BATn_N_CELLS.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

import numpy as np

from thrustmargin.models.errors import AirframeError
from thrustmargin.models.physics.airframe import Quantity
from thrustmargin.models.physics.frames import (
    ardupilot_layout,
    layout_of_rotors,
    rotor_names,
)

#: V of a lithium polymer cell: nominal, and what these settings usually stand for.
CELL = 3.7
_CELL_OF = {"MOT_BAT_VOLT_MAX": 4.2, "MOT_BAT_VOLT_MIN": 3.3, "BATT_LOW_VOLT": 3.6}
_FULL_CELL = 4.1  # V a cell at take-off
#: Cells in series that batteries are sold with.
_CELLS = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 13, 14, 16, 18, 20, 24, 28)
#: FRAME_CLASS and FRAME_TYPE as ArduPilot writes them at boot: "Frame: HEXA/X".
_CLASS = {"QUAD": 1, "HEXA": 2, "OCTA": 3, "OCTAQUAD": 4, "Y6": 5, "DODECAHEXA": 12, "DECA": 14}
_TYPE = {"PLUS": 0, "X": 1, "V": 2, "H": 3, "PLUSREV": 6, "Y6B": 10, "Y6F": 11, "BF_X": 12}
_TYPE |= {"DJI_X": 13, "CW_X": 14, "I": 15, "X_REV": 18, "Y4": 19, "default": 1}
_MOTOR_OUTPUTS = (*range(33, 41), *range(82, 86))  # SERVOn_FUNCTION of motors 1 to 12


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportedAirframe:
    """What could be read; a layout with `rotors` of its own has positions in m already."""

    layout: str | None = None
    layout_source: str = ""  # parameters by which the layout is known
    rotors: list[dict[str, Any]] | None = None
    quantities: Mapping[str, Quantity] = field(default_factory=dict)
    rotor_count: int = 0  # by other evidence than the layout; 0: none
    hover_throttle: float = float("nan")  # share of a rotor's maximum thrust in hover
    notes: tuple[str, ...] = ()


def reported_airframe(
    parameters: Mapping[str, float],
    highest_voltage: float = float("nan"),
    *,
    rotor_count: int = 0,
    layout: str | None = None,
) -> ReportedAirframe:
    """The airframe that `parameters` describe; `highest_voltage` [V] is the battery's in a flight.

    `rotor_count` is what other reports say of the number of rotors, 0 nothing; a `layout` that is
    stated takes the place of what the parameters say of it. Raises AirframeError when the vehicle
    is no multirotor, or of a frame that is not known.
    """
    for name in ("Q_ENABLE", "CA_AIRFRAME"):
        if parameters.get(name, 0.0) > 0.0:
            raise AirframeError(
                f"{name} {parameters[name]:g} is a vehicle with wings or tilting rotors, not a "
                "multirotor; its margin of thrust cannot be told here"
            )
    if layout is None and parameters.get("CA_ROTOR_COUNT", 0.0) >= 3.0:
        return _px4(parameters, highest_voltage)
    source, notes = "", []
    if layout is None and "FRAME_CLASS" in parameters:
        kind, shape = (_whole(parameters.get(f"FRAME_{k}", 1.0)) for k in ("CLASS", "TYPE"))
        found = ardupilot_layout(kind, shape)
        if found is None:
            raise AirframeError(
                f"FRAME_CLASS {kind} with FRAME_TYPE {shape} is no layout of fixed upright rotors "
                "that is known; if it is one, give the layout with --layout"
            )
        layout, source = found.name, f"FRAME_CLASS {kind}, FRAME_TYPE {shape}"
        functions = [_whole(parameters.get(f"SERVO{n}_FUNCTION", 0.0)) for n in range(1, 33)]
        motors = sum(function in _MOTOR_OUTPUTS for function in functions)
        for count, whose in ((motors, "SERVOn_FUNCTION"), (rotor_count, "the log")):
            if count and count != found.rotor_count:
                notes.append(f"{whose} tells of {count} motors, {source} of {found.rotor_count}")
    quantities = dict(_battery(parameters, highest_voltage))
    if parameters.get("SERVO_BLH_MASK", 0.0) > 0.0 and parameters.get("SERVO_BLH_POLES", 0.0) > 0.0:
        poles = parameters["SERVO_BLH_POLES"]
        quantities["motor_poles"] = Quantity(poles, "1", "SERVO_BLH_POLES")
    return ReportedAirframe(
        layout=layout,
        layout_source=source,
        quantities=quantities,
        rotor_count=rotor_count,
        hover_throttle=parameters.get("MOT_THST_HOVER", float("nan")),
        notes=tuple(notes),
    )


def frame_of_text(texts: Iterable[str]) -> dict[str, float]:
    """FRAME_CLASS and FRAME_TYPE by the boot text "Frame: HEXA/X"; {} where there is none."""
    for text in texts:
        kind, _, shape = text.strip().removeprefix("Frame: ").partition("/")
        if text.strip().startswith("Frame: ") and kind in _CLASS:
            return {"FRAME_CLASS": _CLASS[kind], "FRAME_TYPE": _TYPE.get(shape.split("/")[0], -2)}
    return {}


def _px4(parameters: Mapping[str, float], highest_voltage: float) -> ReportedAirframe:
    count = _whole(parameters["CA_ROTOR_COUNT"])
    places = np.array(
        [[parameters.get(f"CA_ROTOR{n}_P{a}", 0.0) for a in "XYZ"] for n in range(count)]
    )
    # A torque coefficient that is not stored is PX4's default of 0.05.
    torque = np.array([parameters.get(f"CA_ROTOR{n}_KM", 0.05) for n in range(count)])
    spin = np.where(torque > 0.0, 1.0, -1.0)
    if not np.all(np.isfinite(places)) or np.max(np.hypot(*places[:, :2].T)) == 0.0:
        raise AirframeError("CA_ROTORn_PX and PY put all rotors at the centre; set them in PX4")
    found = layout_of_rotors(places, spin)
    names = rotor_names(places[:, :2], (False,) * count)
    quantities = dict(_battery(parameters, highest_voltage))
    farthest = float(np.max(np.hypot(*places[:, :2].T)))
    quantities["arm"] = Quantity(
        farthest, "m", "CA_ROTORn_PX and _PY; PX4 needs only their ratios: measure it", guessed=True
    )
    if not np.allclose(np.abs(torque), 0.05):
        quantities["torque_ratio"] = Quantity(float(np.mean(np.abs(torque))), "m", "CA_ROTORn_KM")
    return ReportedAirframe(
        layout="custom" if found is None else found.name,
        layout_source="CA_ROTORn_PX, _PY and _KM",
        rotors=[
            {"name": name, "position_frd": place.tolist(), "spin": "ccw" if turns > 0 else "cw"}
            for name, place, turns in zip(names, places, spin, strict=True)
        ],
        quantities=quantities,
        hover_throttle=parameters.get("MPC_THR_HOVER", float("nan")),
    )


def _battery(parameters: Mapping[str, float], highest_voltage: float) -> list[tuple[str, Quantity]]:
    """Nominal voltage by the number of cells that the battery's settings and voltage agree on."""
    cells, source, guessed = _whole(parameters.get("BAT1_N_CELLS", 0.0)), "BAT1_N_CELLS", False
    if cells <= 0:
        estimates = {
            f"{name} {parameters[name]:g}": parameters[name] / cell
            for name, cell in _CELL_OF.items()
            if parameters.get(name, 0.0) > 0.0
        }
        if isfinite(highest_voltage) and highest_voltage > 2.0:
            estimates[f"{highest_voltage:.1f} V in the log"] = highest_voltage / _FULL_CELL
        if not estimates:
            return []
        middle = float(np.median(list(estimates.values())))
        cells = min(_CELLS, key=lambda n: abs(n - middle))
        source, guessed = ", ".join(estimates), len(estimates) < 2
    words = f"{cells} cells of {CELL} V, by {source}"
    return [("nominal_voltage", Quantity(round(cells * CELL, 2), "V", words, guessed))]


def _whole(value: float) -> int:
    """A parameter that counts; 0 where the log holds no number."""
    return int(value) if isfinite(value) else 0
