"""Determine the kind of vehicle, and how many rotors lift it, from all its reports.

ArduPilot: its boot text, its vehicle type (HEARTBEAT), FRAME_CLASS or Q_FRAME_CLASS,
SERVOn_FUNCTION; if none is present, parameters that only one kind of vehicle has. PX4: its vehicle
type, CA_AIRFRAME, CA_ROTORn, SYS_AUTOSTART.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace

from thrustmargin.gcs_plugin.telemetry.settings.pulse_range import motor_outputs, whole_number
from thrustmargin.models.physics.motor_layouts import FRAME_CLASSES, class_rotors
from thrustmargin.models.statement import Statement, state
from thrustmargin.models.vehicle_facts import Evidence, VehicleFacts, VehicleKind

#: FRAME_CLASS of ArduCopter and Q_FRAME_CLASS -> rotors
FRAME_ROTORS = class_rotors()
_HELICOPTER_CLASSES = (6, 11, 13)
_BOAT_CLASS = 2  # FRAME_CLASS of ArduRover
#: First word of ArduCopter's text "Frame: QUAD/X" -> rotors
_FRAME_TEXTS = {text: FRAME_ROTORS[kind] for text, kind in FRAME_CLASSES.items()}
#: MAV_TYPE -> rotors
_TYPE_ROTORS = {2: 4, 13: 6, 14: 8, 15: 3, 29: 12, 35: 10}
#: MAV_TYPE -> kind; those that are not here (generic, reserved) say nothing.
_TYPES: dict[int, VehicleKind] = {
    **dict.fromkeys((*_TYPE_ROTORS, 43), "multirotor"),
    **dict.fromkeys(range(19, 26), "quadplane"),
    **dict.fromkeys((1, 16, 17, 28), "plane"),
    **dict.fromkeys((3, 4), "helicopter"),  # coaxial and single rotor: steered by blades or vanes
    **dict.fromkeys((7, 8), "airship"),
    **dict.fromkeys((9, 18, 26), "other vehicle"),
    5: "antenna tracker",
    10: "rover",
    11: "boat",
    12: "submarine",
}
#: Program that introduces itself when it starts, as "ArduCopter V4.5.7 (2a3dc4b7)".
_BOOT = re.compile(
    r"(?:Ardu|APM:)(Copter|Plane|Rover|Sub)\b[ .Vv]*[\d.]*|(Blimp|AntennaTracker)\b[ .Vv]*[\d.]*"
)
_PROGRAMS: dict[str, VehicleKind] = {
    "Copter": "multirotor",
    "Plane": "plane",
    "Rover": "rover",
    "Sub": "submarine",
    "Blimp": "airship",
    "AntennaTracker": "antenna tracker",
}
#: Parameters that only one of ArduPilot's vehicles has.
_OWN_PARAMETERS: tuple[tuple[str, VehicleKind], ...] = (
    ("TECS_CLMB_MAX", "plane"),
    ("ATC_STR_RAT_P", "rover"),
    ("JS_GAIN_DEFAULT", "submarine"),
    ("H_RSC_MODE", "helicopter"),
    ("MOT_SPIN_MIN", "multirotor"),
    ("MOT_SPIN_ARMED", "multirotor"),
)
#: PX4's CA_AIRFRAME -> kind; 9 is custom.
_CONTROL_ALLOCATION: dict[int, VehicleKind] = {
    **dict.fromkeys((0, 8), "multirotor"),
    1: "plane",
    **dict.fromkeys((2, 3, 4), "quadplane"),
    **dict.fromkeys((5, 6, 13), "rover"),
    7: "submarine",
    **dict.fromkeys((10, 11, 12), "helicopter"),
    **dict.fromkeys((14, 15), "other vehicle"),
}
#: PX4's SYS_AUTOSTART in thousands -> kind (of its airframe reference).
_AUTOSTART: dict[int, VehicleKind] = {
    **dict.fromkeys((2, 3), "plane"),
    **dict.fromkeys((*range(4, 10), 11, 12, 14), "multirotor"),
    13: "quadplane",
    **dict.fromkeys((15, 16), "helicopter"),
    **dict.fromkeys((50, 51, 52, 53), "rover"),
    60: "submarine",
}


#: Outputs of ArduPilot that have a function: SERVO1_FUNCTION to SERVO16_FUNCTION.
OUTPUTS = range(1, 17)


def vehicle_facts(
    parameters: Mapping[str, float],
    *,
    mav_type: int | None = None,
    texts: Iterable[str] = (),
    whole: bool = True,
) -> VehicleFacts:
    """Return kind and rotors of a vehicle by its parameters, its MAV_TYPE and its status texts.

    If not `whole`, more parameters may follow, and motors are not counted by SERVOn_FUNCTION until
    1 to 16 are all known. Rotors are counted only of vehicles that rotors lift; else 0.
    """
    if not whole and any(f"SERVO{n}_FUNCTION" not in parameters for n in OUTPUTS):
        functions = {f"SERVO{n}_FUNCTION" for n in range(1, 33)}
        parameters = {name: v for name, v in parameters.items() if name not in functions}
    texts = tuple(texts)
    kind, evidence = _kind(parameters, mav_type, texts)
    facts = VehicleFacts(kind=kind, evidence=evidence)
    if not facts.has_lifting_rotors:
        return facts
    count, how, conflict = _rotors(parameters, mav_type, texts, winged=kind == "quadplane")
    return replace(facts, rotor_count=count, rotor_evidence=how, rotor_conflict=conflict)


def _kind(
    parameters: Mapping[str, float], mav_type: int | None, texts: tuple[str, ...]
) -> tuple[VehicleKind, Evidence]:
    """Return the kind of vehicle and its evidence, from parameters, MAV_TYPE and status texts.

    By `_program`; a multirotor with a helicopter's type or frame is "helicopter", a rover with a
    boat's frame "boat", a plane with Q_ENABLE or three motor outputs or more "quadplane". "unknown"
    and no evidence if these do not show it.
    """
    kind, evidence = _program(parameters, mav_type, texts)
    frame = whole_number(parameters, "FRAME_CLASS")
    if kind == "multirotor" and mav_type == 4:
        return "helicopter", "MAV_TYPE 4"
    if kind in ("multirotor", "unknown") and frame in _HELICOPTER_CLASSES:
        return "helicopter", f"FRAME_CLASS {frame}"
    if kind == "rover" and frame == _BOAT_CLASS:
        return "boat", state("both", first=evidence, second=f"FRAME_CLASS {frame}")
    if kind == "plane":
        if whole_number(parameters, "Q_ENABLE"):
            return "quadplane", state("both", first=evidence, second="Q_ENABLE 1")
        if len(motor_outputs(parameters)) >= 3:
            return "quadplane", state("motors among SERVOn", first=evidence)
    return kind, evidence


def _program(
    parameters: Mapping[str, float], mav_type: int | None, texts: tuple[str, ...]
) -> tuple[VehicleKind, Evidence]:
    """Return the kind of a vehicle, and its evidence in words; "unknown" and "" if nothing shows
    it.

    The first of these decides: boot text, MAV_TYPE, CA_AIRFRAME (only with CA_ROTOR_COUNT),
    SYS_AUTOSTART, parameters that only one kind of vehicle has. `mav_type` None is unreported;
    `texts` are the vehicle's messages.
    """
    for text in texts:
        boot = _BOOT.match(text)
        if boot:
            return _PROGRAMS[boot[1] or boot[2]], state("boot text", text=boot[0].strip())
    if mav_type in _TYPES:
        return _TYPES[mav_type], f"MAV_TYPE {mav_type}"
    airframe = whole_number(parameters, "CA_AIRFRAME")
    start = whole_number(parameters, "SYS_AUTOSTART")
    if airframe in _CONTROL_ALLOCATION and "CA_ROTOR_COUNT" in parameters:
        return _CONTROL_ALLOCATION[airframe], f"CA_AIRFRAME {airframe}"
    if start is not None and start // 1000 in _AUTOSTART:
        return _AUTOSTART[start // 1000], f"SYS_AUTOSTART {start}"
    for name, kind in _OWN_PARAMETERS:
        if name in parameters:
            return kind, state("own parameter", name=name)
    return "unknown", ""


def _rotors(
    parameters: Mapping[str, float], mav_type: int | None, texts: tuple[str, ...], *, winged: bool
) -> tuple[int, Evidence, Evidence]:
    """Return the number of lifting rotors, its evidence, and contrary evidence ("" without any).

    By ArduPilot's frame, unless fewer motor outputs are set than it has; else by these outputs, by
    PX4's CA_ROTOR_COUNT (upward rotors only), by MAV_TYPE; 0 if unknown. `winged`: a quadplane.
    `mav_type` is the MAV_TYPE of its heartbeat, `texts` its status texts.
    """
    on_output = motor_outputs(parameters)
    by_function = len(on_output) if set(on_output) == set(range(len(on_output))) else 0
    by_function = by_function if by_function >= 3 else 0
    framed, how = _by_frame(parameters, texts, winged=winged)
    by_type = f"MAV_TYPE {mav_type}"
    typed = _TYPE_ROTORS.get(-1 if mav_type is None else mav_type, 0)
    # More outputs than the frame has motors are spare; fewer are of another frame. A quadplane's
    # hover motors are on any outputs, so that these must be known.
    if framed and (by_function >= framed or (by_function == 0 and not winged)):
        # ArduPilot's type follows its frame.
        return framed, how, _counted(typed, by_type) if typed not in (0, framed) else ""
    if by_function:
        other, source = (framed, how) if framed else (typed, by_type)
        conflict = _counted(other, source) if other > by_function else ""
        return by_function, "SERVOn_FUNCTION", conflict
    listed = whole_number(parameters, "CA_ROTOR_COUNT") or 0
    inside = range(listed if 0 <= listed <= 12 else 0)
    upward = sum(abs(parameters.get(f"CA_ROTOR{n}_AX", 0.0)) < 0.5 for n in inside)
    if upward:
        return upward, "CA_ROTOR_COUNT" if upward == listed else "CA_ROTORn_AX", ""
    return (typed, by_type, "") if typed else (0, "", "")


def _counted(count: int, evidence: Evidence) -> Statement:
    """Return another number of rotors, and its evidence."""
    return state("counted by", count=float(count), evidence=evidence)


def _by_frame(
    parameters: Mapping[str, float], texts: tuple[str, ...], *, winged: bool
) -> tuple[int, Evidence]:
    """Return the number of motors of ArduPilot's frame and its evidence; 0 and "" if unknown.

    The frame is FRAME_CLASS, of a quadplane (`winged`) Q_FRAME_CLASS, else a status text "Frame:
    ...".
    """
    name = "Q_FRAME_CLASS" if winged else "FRAME_CLASS"
    frame = whole_number(parameters, name)
    if count := FRAME_ROTORS.get(-1 if frame is None else frame, 0):
        return count, f"{name} {frame}"
    for text in texts:
        head, _, rest = text.partition(": ")
        frame_text = rest.split("/")[0].strip().replace("_", "")  # older: OCTA_QUAD
        if head == "Frame" and (count := _FRAME_TEXTS.get(frame_text, 0)):
            return count, state("status text", text=text)
    return 0, ""
