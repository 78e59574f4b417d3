"""The aircraft in the scene: arms, one disc a rotor in the colour of its margin, tank level.

Discs are instances of one mesh under ambient light alone: their colours reach the screen exactly as
those of the route's lines do, and one palette holds for both. All is built once; a tick assigns
poses, colours and texts to the same nodes.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from thrustmargin.gcs_plugin.view.scene.shown_row import FRD_FLU, ShownRow
from thrustmargin.gcs_plugin.view.scene.surroundings import screen_lines
from thrustmargin.gcs_plugin.wording import palette as colours
from thrustmargin.gcs_plugin.wording.live_words import BEYOND
from thrustmargin.gcs_plugin.wording.palette import sent_for
from thrustmargin.gcs_plugin.wording.thrust_left import percent_down
from thrustmargin.models.flight import Floats
from thrustmargin.models.physics.airframe import Airframe

if TYPE_CHECKING:
    from viser import BatchedMeshHandle, SceneApi

DARK = (38, 38, 42)
NOSE = (200, 20, 110)
LIQUID = (0, 110, 130)
SIDES = 28
ARM_PIXELS, SPIN_PIXELS, FAULT_PIXELS = 5.0, 3.0, 9.0
NO_ARM = 1.0  # m, size of an aircraft of which no rotor is known
#: Tank box in the vehicle frame as shares of the arm length: half width, height, top.
TANK_HALF, TANK_HEIGHT, TANK_TOP = 0.24, 0.5, -0.06


class VehicleNode:
    """An aircraft in the scene, under the node `parent`; `key` names its nodes."""

    def __init__(self, scene: SceneApi, parent: str, key: str, airframe: Airframe) -> None:
        self._airframe = airframe
        self._root = f"{parent}/vehicle_{key}"
        rotors = airframe.rotor_position_frd @ FRD_FLU
        self._arm = airframe.arm or NO_ARM
        self._rotors = rotors
        self._scale = 1.0
        self._visible = True
        self._parts: list[Any] = []  # arms, discs and arrows of the rotors
        self.frame = scene.add_frame(self._root, show_axes=False)
        nose = self._arm * np.array([[0.15, 0, 0.05], [0.8, 0, 0.05]])
        self._nose = scene.add_arrows(
            f"{self._root}/nose",
            nose[None],
            NOSE,
            shaft_radius=0.05 * self._arm,
            head_radius=0.15 * self._arm,
            head_length=0.28 * self._arm,
        )
        self._faulty: frozenset[int] = frozenset()
        self._rings = self._add_rings(scene)
        self._discs = self._add_rotors(scene) if airframe.rotor_count else None
        self._tank = scene.add_box(
            f"{self._root}/tank",
            color=(235, 235, 235),
            dimensions=self._arm * np.array([2 * TANK_HALF, 2 * TANK_HALF, TANK_HEIGHT]),
            opacity=0.35,
            cast_shadow=False,
        )
        self._liquid = scene.add_box(
            f"{self._root}/liquid",
            color=LIQUID,
            dimensions=self._arm * np.array([1.9 * TANK_HALF, 1.9 * TANK_HALF, TANK_HEIGHT]),
            cast_shadow=False,
            visible=False,
        )
        self._labels = [
            scene.add_label(f"{self._root}/label_{i + 1}", str(i + 1), font_screen_scale=1.3)
            for i in range(airframe.rotor_count)
        ]
        self.set_scale(1.0)

    def _add_rotors(self, scene: SceneApi) -> BatchedMeshHandle:
        """Add arms, discs and arrows of the rotors; return the discs."""
        airframe, rotors = self._airframe, self._rotors
        radius = disc_radius(airframe)
        # Under the discs, which would hide half of each line's thickness.
        arms = np.stack([np.zeros_like(rotors), rotors], axis=1) - [0, 0, 0.05 * self._arm]
        body = screen_lines(scene, f"{self._root}/arms", arms, DARK, ARM_PIXELS)
        vertices, faces = unit_disc()
        discs = scene.add_batched_meshes_simple(
            f"{self._root}/discs",
            radius * vertices,
            faces,
            batched_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (airframe.rotor_count, 1)),
            batched_positions=rotors,
            batched_colors=np.tile(sent_for(colours.NO_DATA), (airframe.rotor_count, 1)),
            side="double",
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
        )
        arrows = spin_segments(rotors, radius, airframe.rotor_spin)
        spin = screen_lines(scene, f"{self._root}/spin", arrows, DARK, SPIN_PIXELS)
        self._parts += [body, discs, spin]
        return discs

    def _add_rings(self, scene: SceneApi) -> list[Any]:
        """Add a hidden red ring about each rotor, for alarms; return the R rings."""
        ring = 1.05 * disc_radius(self._airframe) * unit_disc()[0][1:] + [0.0, 0.0, 0.03]
        sides = np.stack([ring, np.roll(ring, -1, axis=0)], axis=1)
        names = [f"{self._root}/fault_{i + 1}" for i in range(len(self._rotors))]
        return [
            screen_lines(scene, name, rotor + sides, colours.ALARM, FAULT_PIXELS, visible=False)
            for name, rotor in zip(names, self._rotors, strict=True)
        ]

    @property
    def arm(self) -> float:
        """Return the distance, m, of the outermost rotor from the centre."""
        return self._arm

    @property
    def drawn_arm(self) -> float:
        """Return the distance of the outermost rotor from the centre as drawn, m of the scene."""
        return self._arm * self._scale

    def set_scale(self, scale: float, *, detailed: bool = True) -> None:
        """Draw the aircraft `scale` times its size; `detailed` puts the margins on the rotors."""
        self._scale = scale
        self._detailed = detailed
        for node in (self._nose, self._tank, *self._parts, *self._rings):
            node.scale = scale
        self._tank.position = scale * self._arm * np.array([0, 0, TANK_TOP - TANK_HEIGHT / 2])
        for label, rotor in zip(self._labels, self._rotors, strict=True):
            label.position = scale * (rotor + np.array([0, 0, 0.12 * self._arm]))

    def hide(self) -> None:
        """Hide the aircraft until the next `show`."""
        self.frame.visible = self._visible = False

    def show(
        self, row: ShownRow, faulty: frozenset[int] = frozenset(), *, old: bool = False
    ) -> None:
        """Place the aircraft where `row` has it, with its attitude and colours. It is hidden
        without a position."""
        known = row.analysis.placed
        faulty = faulty if known else frozenset()
        if faulty != self._faulty:
            self._faulty = faulty
            for i, ring in enumerate(self._rings, start=1):
                ring.visible = i in faulty
        position, wxyz = row.position_enu, row.wxyz
        margin, coloured = row.margin, row.coloured
        if old or not known:
            margin = coloured = np.full_like(margin, np.nan)
        placed = bool(np.all(np.isfinite(position)))
        if placed != self._visible:
            self.frame.visible = self._visible = placed
        if not placed:
            return
        self.frame.position = position
        if np.all(np.isfinite(wxyz)):
            self.frame.wxyz = wxyz
        if self._discs is not None:
            self._discs.batched_colors = sent_for(row.scale.screen(coloured))
        for i, label in enumerate(self._labels):
            # Over the whole field the numbers would lie on each other: those of bad rotors alone.
            shown = known and (self._detailed or i + 1 in faulty)
            if label.visible != shown:
                label.visible = shown
            text = rotor_label(i, margin[i]) if self._detailed else str(i + 1)
            label.text = f"! {text}" if i + 1 in faulty else text
        self._show_tank(row.analysis.track.tank_kg[row.row])

    def _show_tank(self, tank_kg: float) -> None:
        level = tank_level(tank_kg, self._airframe.tank_capacity_kg)
        self._liquid.visible = level > 0.0  # no level is NaN
        if level > 0.0:
            scale, middle = self._scale, TANK_TOP - TANK_HEIGHT + level * TANK_HEIGHT / 2
            self._liquid.scale = (scale, scale, scale * level)
            self._liquid.position = (0.0, 0.0, scale * self._arm * middle)


def rotor_label(index: int, margin: float) -> str:
    """Return the text over a rotor: its number and its margin in per cent, or "?" where unknown."""
    if not np.isfinite(margin):
        return f"{index + 1}: ?"
    return f"{index + 1}: {BEYOND if margin < 0.0 else f'{percent_down(margin)}%'}"


def tank_level(tank_kg: float, capacity_kg: float) -> float:
    """Return the share of the tank that is full, 0..1; NaN when unknown, or without a tank."""
    if not np.isfinite(tank_kg) or capacity_kg <= 0.0:
        return np.nan
    return float(np.clip(tank_kg / capacity_kg, 0.0, 1.0))


def disc_radius(airframe: Airframe) -> float:
    """Return the propeller's radius, m, reduced where neighbouring discs would overlap."""
    apart = airframe.rotor_position_frd[:, None, :2] - airframe.rotor_position_frd[None, :, :2]
    distance = np.linalg.norm(apart, axis=-1)
    neighbours = distance[distance > 0.05]
    closest = float(neighbours.min()) if neighbours.size else airframe.propeller_diameter
    return min(airframe.propeller_diameter / 2, 0.48 * closest)


def unit_disc() -> tuple[Floats, np.ndarray]:
    """Return (V, 3) vertices and (F, 3) faces of a flat disc of radius 1 around the origin."""
    angle = 2 * np.pi * np.arange(SIDES) / SIDES
    rim = np.stack([np.cos(angle), np.sin(angle), np.zeros(SIDES)], axis=1)
    edge = 1 + np.arange(SIDES)
    return np.concatenate([np.zeros((1, 3)), rim]), np.stack(
        [np.zeros(SIDES, dtype=int), edge, np.roll(edge, -1)], axis=1
    )


def spin_segments(rotors_flu: Floats, radius: float, spin: Floats) -> Floats:
    """Return lines (N, 2, 3), m, of an arc with an arrow head over each disc, by its spin.

    `rotors_flu` (R, 3) are positions forward, left, up, m; `radius` is the discs', m; `spin` (R,)
    is +1 for counter-clockwise, else -1.
    """
    lines = []
    for centre, turn in zip(rotors_flu, spin, strict=True):
        angle = turn * np.linspace(np.radians(20), np.radians(160), 8)
        arc = 0.65 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        end, along = arc[-1], arc[-1] - arc[-2]
        along = along / np.linalg.norm(along)
        side = np.array([-along[1], along[0]])
        barbs = [end - 0.35 * along + 0.28 * s * side for s in (1, -1)]
        flat = np.array([*pairwise(arc), *((end, barb) for barb in barbs)])
        # Above the disc, or the two would flicker.
        raised = np.concatenate([flat, np.full((*flat.shape[:2], 1), 0.08)], axis=2)
        lines.append(centre + radius * raised)
    return np.concatenate(lines)
