"""Derive layout, motors and battery of an airframe from the vehicle's own parameters.

ArduPilot: FRAME_CLASS, FRAME_TYPE, SERVOn_FUNCTION, MOT_*, BATT_*, SERVO_BLH_POLES; of a plane with
hover motors Q_FRAME_CLASS, Q_FRAME_TYPE, Q_M_*. PX4: CA_ROTORn_PX, _PY, _PZ (forward, right, down,
m) and _KM (torque over thrust, m; above 0 turns counter-clockwise), BATn_N_CELLS. Other values must
be asked of the owner.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.telemetry.settings.pulse_range import motor_outputs, whole_number
from thrustmargin.gcs_plugin.telemetry.settings.vehicle_kind import vehicle_facts
from thrustmargin.gcs_plugin.wording.check_words import in_english
from thrustmargin.models.errors import AirframeError
from thrustmargin.models.physics.airframe import Quantity
from thrustmargin.models.physics.airframe_draft import lower_effectiveness
from thrustmargin.models.physics.motor_layouts import (
    ardupilot_layout,
    layout_of_rotors,
    layout_of_text,
    motor_layouts,
    rotor_names,
)
from thrustmargin.models.statement import Statement, state
from thrustmargin.models.vehicle_facts import StatedBattery, VehicleFacts, can_be_cells

#: V of a lithium polymer cell, nominal; an airframe's nominal voltage counts cells by it.
CELL = 3.7
#: Cells in series that batteries are sold with.
_CELLS = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 13, 14, 15, 16, 18, 20, 22, 24, 28)
#: Chemistry -> V of one cell that each setting usually corresponds to, and at take-off.
_CHEMISTRIES: Mapping[str, Mapping[str, float]] = {
    "LiPo": {"MAX": 4.2, "MIN": 3.3, "LOW": 3.6, "log": 4.1},
    "HV LiPo": {"MAX": 4.35, "MIN": 3.3, "LOW": 3.6, "log": 4.25},
    "Li-ion": {"MAX": 4.1, "MIN": 2.8, "LOW": 3.1, "log": 4.0},
}
#: V a cell by which owners depart from these. A full cell is set by its chemistry; where it is
#: empty is set by habit; a flight may begin with a battery that is not full.
_SPREAD = {"MAX": 0.04, "MIN": 0.3, "LOW": 0.25, "log": 0.15}
#: Spreads beyond which a setting is no evidence: it is of another battery, or nobody set it.
_MOST_SPREADS = 5.0
#: Spreads by which the readings of two chemistries must differ for the worse to be dropped.
_APART = 2.0
#: Spreads that another chemistry must fit better by: most multirotors fly on lithium polymer.
_LESS_USUAL = 1.0
#: V that a cell can have: at the end of a flight, and full by a high-voltage charger. At take-off
#: no cell is below the first of the second pair; a voltmeter may read 2 % too much.
_CELL_RANGE, _AT_TAKE_OFF = (2.8, 4.35), (3.4, 4.35 * 1.02)
#: V by which owners round a setting: 21.8 V are 5 cells of 4.35 V.
_ROUNDING = 0.05 + 1e-6
_SETTINGS = {
    "MOT_BAT_VOLT_MAX": "MAX",
    "Q_M_BAT_VOLT_MAX": "MAX",
    "MOT_BAT_VOLT_MIN": "MIN",
    "Q_M_BAT_VOLT_MIN": "MIN",
    "BATT_LOW_VOLT": "LOW",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportedAirframe:
    """The values derived; a layout with its own `rotors` already has positions in m."""

    layout: str | None = None
    rotors: list[dict[str, Any]] | None = None
    quantities: Mapping[str, Quantity] = field(default_factory=dict)
    rotor_count: int = 0  # by other evidence than the layout; 0: none
    notes: tuple[Statement, ...] = ()


def reported_airframe(
    parameters: Mapping[str, float],
    highest_voltage: float = float("nan"),
    *,
    facts: VehicleFacts | None = None,
    texts: Iterable[str] = (),
    layout: str | None = None,
) -> ReportedAirframe:
    """Return the airframe that a vehicle's `parameters` describe: layout (None if unreported),
    quantities, rotor count, notes.

    `highest_voltage`, V, is the battery's in a flight, NaN if unknown; `facts` is what is known of
    the vehicle (None: derived from parameters and `texts`, its status texts); a stated `layout`
    replaces the vehicle's own. PX4's geometry, if it is set, replaces a layout by name. Another
    number of motors than the layout's is only noted. Raise AirframeError if the vehicle is no
    multirotor, or its frame is unknown.
    """
    facts = vehicle_facts(parameters, texts=texts) if facts is None else facts
    if refusal := facts.refusal("the vehicle"):
        raise AirframeError(in_english(refusal))
    quantities = _battery(parameters, highest_voltage, facts.battery)
    if layout is None and (whole_number(parameters, "CA_ROTOR_COUNT") or 0) >= 3:
        return _px4(parameters, quantities)
    q = "Q_" if facts.kind == "quadplane" else ""
    notes = []
    kind = whole_number(parameters, f"{q}FRAME_CLASS")
    if layout is None:
        shape = whole_number(parameters, f"{q}FRAME_TYPE")
        stated = layout_of_text(texts, -2 if shape is None else shape)
        if kind is not None:
            stated = ardupilot_layout(kind, 1 if shape is None else shape)
            if stated is None:
                raise AirframeError(
                    f"{q}FRAME_CLASS {kind}, {q}FRAME_TYPE {shape} is no layout of fixed upright "
                    "rotors that is known; if it is one, give it with --layout"
                )
        layout = None if stated is None else stated.name
    known = motor_layouts().get(str(layout))
    for count, whose in (
        (len(motor_outputs(parameters)), "SERVOn_FUNCTION"),
        (facts.rotor_count, facts.rotor_evidence),
    ):
        if known is not None and count and count != known.rotor_count:
            notes.append(
                state(
                    "motors of another layout",
                    count=float(count),
                    evidence=whose,
                    layout=known.name,
                    own=float(known.rotor_count),
                )
            )
    poles = parameters.get("SERVO_BLH_POLES", 0.0)
    if 0.0 < poles < inf and parameters.get("SERVO_BLH_MASK", 0.0) > 0.0:
        quantities["motor_poles"] = Quantity(poles, "1", "SERVO_BLH_POLES")
    return ReportedAirframe(
        layout=layout,
        quantities=quantities,
        rotor_count=facts.rotor_count,
        notes=tuple(dict.fromkeys(notes)),
    )


def _px4(parameters: Mapping[str, float], quantities: dict[str, Quantity]) -> ReportedAirframe:
    listed = whole_number(parameters, "CA_ROTOR_COUNT") or 0
    # A rotor that does not point upward pushes a plane.
    up = [n for n in range(min(listed, 12)) if abs(parameters.get(f"CA_ROTOR{n}_AX", 0.0)) < 0.5]
    if len(up) < 3:
        raise AirframeError(f"by CA_ROTORn_AX {len(up)} of {listed} rotors point upward; set them")
    places = np.array([[parameters.get(f"CA_ROTOR{n}_P{a}", 0.0) for a in "XYZ"] for n in up])
    # A torque coefficient that is not stored is PX4's default of 0.05.
    torque = np.array([parameters.get(f"CA_ROTOR{n}_KM", 0.05) for n in up])
    if not np.all(np.isfinite(torque)):
        raise AirframeError("a CA_ROTORn_KM is no number; set it in PX4")
    spin = np.where(torque > 0.0, 1.0, -1.0)
    if not np.all(np.isfinite(places)) or np.max(np.hypot(*places[:, :2].T)) == 0.0:
        raise AirframeError("CA_ROTORn_PX and PY put all rotors at the centre; set them in PX4")
    layout = layout_of_rotors(places, spin)
    farthest = float(np.max(np.hypot(*places[:, :2].T)))
    distance = np.hypot(*(places[:, None, :2] - places[None, :, :2]).T).T
    is_lower = (distance < 0.1 * farthest) & (places[:, None, 2] > places[None, :, 2])
    lower = tuple(map(bool, is_lower.any(axis=1)))
    names = rotor_names(places[:, :2], lower)
    below = lower_effectiveness()
    if any(lower):
        quantities["lower_rotor_effectiveness"] = below
    quantities["arm"] = Quantity(
        farthest, "m", "CA_ROTORn_PX and _PY; PX4 needs only their ratios: measure it", guessed=True
    )
    if not np.allclose(np.abs(torque), 0.05):
        quantities["torque_ratio"] = Quantity(float(np.mean(np.abs(torque))), "m", "CA_ROTORn_KM")
    return ReportedAirframe(
        layout="custom" if layout is None else layout.name,
        rotors=[
            {"name": name, "position_frd": place.tolist(), "spin": "ccw" if turns > 0 else "cw"}
            | ({"effectiveness": below.value} if low else {})
            for name, place, turns, low in zip(names, places, spin, lower, strict=True)
        ],
        quantities=quantities,
        rotor_count=len(up),
    )


#: In series; more volts than any multirotor flies on.
MOST_CELLS = 100


def _battery(
    parameters: Mapping[str, float], highest_voltage: float, battery: StatedBattery
) -> dict[str, Quantity]:
    """Return {"nominal_voltage": V} by the first stated cell count that `highest_voltage` allows.

    Cells are stated by `battery` or BAT1_N_CELLS. Otherwise use the cells that other settings and
    the voltage agree on; empty if nothing is known.
    """
    stated = [(battery.cells, in_english(battery.source))]
    stated += [
        (whole_number(parameters, name) or 0, name) for name in ("BAT1_N_CELLS", "BAT_N_CELLS")
    ]
    for cells, whose in stated:
        if 0 < cells <= MOST_CELLS and can_be_cells(cells, highest_voltage):
            words = f"{cells} cells of {CELL} V, by {whose}"
            return {"nominal_voltage": Quantity(round(cells * CELL, 2), "V", words)}
    return _cells_by_settings(parameters, highest_voltage)


def _cells_by_settings(
    parameters: Mapping[str, float], highest_voltage: float
) -> dict[str, Quantity]:
    """Return {"nominal_voltage": V} by the cell count that best fits settings and voltage.

    The count is marked as guessed if a single voltage supports it, or if lithium polymer,
    high-voltage and lithium ion cells give different counts. Empty if no cell count allows the
    voltages, or none is known. `highest_voltage`, V, is the log's, NaN if unknown.
    """
    volts = {
        f"{name} {parameters[name]:g}": (kind, parameters[name])
        for name, kind in _SETTINGS.items()
        if 0.0 < parameters.get(name, 0.0) < inf
    }
    if isfinite(highest_voltage) and highest_voltage > 2.0:
        polymer = _CHEMISTRIES["LiPo"]
        measured = highest_voltage / polymer["log"]
        # A setting of another battery, or one that nobody set, does not count against the flight.
        volts = {
            words: (kind, setting)
            for words, (kind, setting) in volts.items()
            if abs(setting / polymer[kind] - measured) < 0.2 * measured
        }
        volts[f"{highest_voltage:.1f} V in the log"] = ("log", highest_voltage)
    readings = {
        chemistry: best
        for chemistry, usual in _CHEMISTRIES.items()
        if (best := _best_cells(list(volts.values()), usual)) is not None
    }
    if not readings:
        return {}
    misfit, cells = min(readings.values())
    others = {
        count: chemistry
        for chemistry, (deviation, count) in readings.items()
        if count != cells
        and deviation < misfit + _APART
        and _agreeing(volts.values(), count, chemistry) == len(volts)
    }
    chemistry = next(name for name, best in readings.items() if best == (misfit, cells))
    agreeing = _agreeing(volts.values(), cells, chemistry)
    words = f"{cells} cells of {CELL} V, by {', '.join(volts)}"
    if others:
        alternatives = (f"{count} if {name}" for count, name in others.items())
        words = f"{words}: {cells} if {chemistry}, {', '.join(alternatives)}"
    guessed = bool(others) or agreeing < 2
    return {"nominal_voltage": Quantity(round(cells * CELL, 2), "V", words, guessed)}


def _agreeing(volts: Iterable[tuple[str, float]], cells: int, chemistry: str) -> int:
    """Count the `volts`, (kind of setting, V), that are usual for a battery of `cells` cells.

    `chemistry` is a key of _CHEMISTRIES.
    """
    usual = _CHEMISTRIES[chemistry]
    return sum(
        abs(setting / cells - usual[kind]) < _MOST_SPREADS * _SPREAD[kind]
        for kind, setting in volts
    )


def _best_cells(
    volts: Sequence[tuple[str, float]], usual: Mapping[str, float]
) -> tuple[float, int] | None:
    """Return (misfit, cell count) of the number of cells that fits the `volts`, (kind of setting,
    V), best.

    `usual` are the usual voltages of one chemistry by kind of setting, V a cell. The misfit is a
    sum of deviations, each over its _SPREAD. None without voltages, or if no count of cells allows
    them.
    """
    extra = 0.0 if usual is _CHEMISTRIES["LiPo"] else _LESS_USUAL
    fits = [
        (
            extra
            + sum(
                min(abs(setting / cells - usual[kind]) / _SPREAD[kind], _MOST_SPREADS)
                for kind, setting in volts
            ),
            cells,
        )
        for cells in _CELLS
        if all(_possible(kind, setting, cells) for kind, setting in volts)
    ]
    return min(fits) if volts and fits else None


def _possible(kind: str, setting: float, cells: int) -> bool:
    """Return True if `cells` cells in series can have the voltage `setting`, V.

    `kind` is "log" (at take-off), "MAX", "MIN" or "LOW". The last two, settings for an empty
    battery, are often left at another battery's and exclude nothing.
    """
    volts = setting / cells
    if kind == "log":
        return _AT_TAKE_OFF[0] <= volts <= _AT_TAKE_OFF[1]
    return kind != "MAX" or _CELL_RANGE[0] <= volts <= _CELL_RANGE[1] + _ROUNDING / cells
