"""Where aircraft flew and are going to: trails in the colours of an overlay, and planned paths."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from thrustmargin.gcs_plugin.view.live_aircraft import Aircraft
from thrustmargin.gcs_plugin.view.overlays import Overlay
from thrustmargin.gcs_plugin.view.scene import PLAN_GREY, ROUTE_PIXELS, Scene
from thrustmargin.gcs_plugin.view.tonemap import line_colours, sent_for
from thrustmargin.models.flight import Floats

if TYPE_CHECKING:
    import viser


class Paths:
    """Draws into a server's scene, and fits `scene` to what it has drawn. For one thread."""

    def __init__(self, server: viser.ViserServer, scene: Scene) -> None:
        self._api = server.scene
        self._scene = scene
        self._bounds: Floats | None = None  # (2, 3) m that the ground was fitted to

    def draw_trail(self, one: Aircraft, overlay: Overlay, number: int) -> None:
        """Where it flew, in the colours of `overlay`, the trail's value of that number."""
        seen = overlay.scale.screen(one.trail.values(number))
        colours = np.repeat(sent_for(seen)[:, None], 2, axis=1)
        points = one.trail.points()
        if one.line is not None and len(one.line.points) == len(points):
            one.line.points, one.line.colors = points, colours
            return
        one.line = self._api.add_line_segments(
            f"/world/trail_{one.number}",
            points,
            colours,
            thickness=ROUTE_PIXELS,
            thickness_units="screen",
        )

    def draw_plan(self, one: Aircraft, points: Floats, ground: float, offset: Floats) -> None:
        """The planned path through (W, 3) ENU places, m, flat on the ground."""
        if len(points) < 2:
            return
        flat = np.column_stack([points[:, :2], np.full(len(points), ground)]) + offset
        self._api.add_line_segments(
            f"/world/plan_{one.number}",
            np.stack([flat[:-1], flat[1:]], axis=1),
            line_colours(len(flat) - 1, PLAN_GREY),
            thickness=2.0,
            thickness_units="screen",
        )
        self._grow(flat)

    def fit(self, aircraft: Sequence[Aircraft]) -> None:
        """Make the ground and the overview hold every trail."""
        parts = [one.trail.points().reshape(-1, 3) for one in aircraft if one.trail.count]
        if parts:
            self._grow(np.concatenate(parts))

    def _grow(self, points: Floats) -> None:
        """Fit the ground and the overview again when something lies outside of them."""
        low, high = points.min(axis=0), points.max(axis=0)
        if self._bounds is None:
            self._bounds = np.stack([low, high])
        elif np.all(low >= self._bounds[0] - 1.0) and np.all(high <= self._bounds[1] + 1.0):
            return
        else:
            # With room to spare, or the picture would move all the time.
            self._bounds = np.stack(
                [np.minimum(low - 5.0, self._bounds[0]), np.maximum(high + 5.0, self._bounds[1])]
            )
        self._scene.set_ground(self._bounds, float(min(self._bounds[0][2], 0.0)))
