"""The 3D scene: ground, field, route and aircraft, fed with arrays from any source.

Everything hangs under one frame, `/world`. To follow an aircraft the world is moved under a camera
that stays where its user put it, so that following never fights with the mouse.
The scene knows no clock and no log: `set_route` and `set_field` give it what lies still, `show`
gives it one row of one aircraft. Every call only assigns to nodes that exist.

One scene belongs to the server, and every browser sees it. `for_client` adds one of a single
browser: its nodes stand in the place of the server's nodes of the same name, in that browser alone,
so it has a camera, colours and a time of its own over the same ground.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING

import numpy as np
import shapely
from viser.transforms import SO3

from thrustmargin.gcs_plugin.view.scene.aircraft import VehicleNode
from thrustmargin.gcs_plugin.view.scene.shown_row import ShownRow, distinct_legs, enu
from thrustmargin.gcs_plugin.view.scene.surroundings import (
    FIRST_ASPECT,
    NO_TURN,
    Camera,
    Surroundings,
    behind,
    nose_north,
    overview,
)
from thrustmargin.gcs_plugin.wording import live_words as words
from thrustmargin.gcs_plugin.wording.palette import ColourScale, Rgb, sent_for
from thrustmargin.mission.field import Field
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.physics.airframe import Airframe

if TYPE_CHECKING:
    from viser import CameraHandle, ClientHandle, LabelHandle, LineSegmentsHandle, ViserServer

ROUTE_PIXELS = 8.0
#: An arm's length over the extent when the whole field is shown: true to size it were a dot.
OVERVIEW_SHARE = 0.13
GROUND_GREEN = (150, 200, 120)
FIELD_GREEN = (60, 120, 50)
PLAN_GREY = (110, 110, 110)
PIN = (200, 20, 110)  # as the page's legend has it
HIT = np.radians(2.0)  # from the route, within which a click is of it


class Scene:
    """A 3D scene with one or more aircraft of a viser server. Call it from one thread.

    With a `client` it is that browser's own, over the ground of the server's scene.
    """

    def __init__(self, server: ViserServer, client: ClientHandle | None = None) -> None:
        self._server, self._client = server, client
        self._api = server.scene if client is None else client.scene
        self._world = self._api.add_frame("/world", show_axes=False)
        if client is None:
            self._api.set_up_direction("+z")
            # Ambient light alone, of the strength at which a mesh keeps the colour it is given.
            self._api.configure_default_lights(enabled=False)
            self._api.configure_environment_map(hdri=None)
            self._api.add_light_ambient("/light", intensity=float(np.pi))
        self._vehicles: dict[str, VehicleNode] = {}
        self._routes: dict[str, LineSegmentsHandle] = {}
        self._planned: set[str] = set()  # names of the planned paths that are drawn
        self._pin = self._api.add_point_cloud(
            "/world/pin",
            np.zeros((1, 3)),
            PIN,
            point_shape="circle",
            point_shading="flat",
            visible=False,
        )
        self.surroundings = Surroundings(self._api)
        self.camera = Camera.FIELD
        self._pinned = self._covered = False
        self._low, self._high = np.full(3, -20.0), np.full(3, 20.0)  # m, corners of all shown
        self._ground = 0.0  # m, up
        self._cell = grid_cell(self._extent)  # m
        self._held: Floats | None = None  # (2, 3) m, what `hold` fitted the ground to
        self._note = self._api.add_label("/world/scale", "")
        self._of_clients: dict[int, Scene] = {}  # by viser's number of the client
        if client is not None:
            self._keep_fitted(client)

    def for_client(self, client: ClientHandle) -> Scene:
        """Return a new scene of one browser, over the ground of this one."""
        made = Scene(self._server, client)
        made._fit_like(self)
        self._of_clients[client.client_id] = made
        return made

    def keep_clients(self, numbers: Collection[int]) -> None:
        """Drop the scenes of closed browsers; `numbers` are viser's ids of the open ones."""
        self._of_clients = {n: one for n, one in self._of_clients.items() if n in numbers}

    def atomic(self) -> AbstractContextManager[None]:
        """Return a context in which all changes reach the browser together."""
        return (self._client or self._server).atomic()

    def _fit_like(self, other: Scene) -> None:
        """Copy the extent and ground of another scene, and fit the camera to them."""
        self._low, self._high, self._ground = other._low, other._high, other._ground
        self._cell = other._cell
        self._note.position = other._note.position
        self._rescale()
        if self.camera is Camera.FIELD:
            self._look()

    def set_ground(self, positions_enu: Floats, ground: float) -> None:
        """Fit grid, camera and the aircraft's drawn size to positions (T, 3), m east, north, up.

        The grid lies at height `ground`, m. Positions with NaN are ignored; without any other the
        extent stays.
        """
        known = positions_enu[np.all(np.isfinite(positions_enu), axis=1)]
        if known.size:
            self._low, self._high = known.min(axis=0), known.max(axis=0)
            self._low[2] = min(ground, self._low[2])
        self._ground = ground
        extent = self._extent
        self._cell = cell = grid_cell(extent)
        side = cell * (np.ceil(2.6 * extent / cell) + 1)
        middle = np.round((self._low + self._high)[:2] / 2 / cell) * cell
        self._api.add_grid(
            "/world/ground",
            width=side,
            height=side,
            cell_size=cell,
            section_size=5 * cell,
            cell_color=(205, 205, 205),
            section_color=(150, 150, 150),
            cell_thickness=1.0,
            section_thickness=1.4,
            fade_distance=12 * side,
            shadow_opacity=0.0,
            position=(*middle, ground - 0.06),
        )
        edge = middle + np.array([-side / 4, side / 2])
        self._api.add_label(
            "/world/north", "North", position=(*edge, ground), anchor="bottom-center"
        )
        corner = middle - np.array([side / 4, side / 2])
        self._note.position = (*corner, ground)
        self._look()
        for one in self._of_clients.values():
            one._fit_like(self)

    def hold(self, points_enu: Floats) -> None:
        """Enlarge ground and overview where points (N, 3), m east, north, up, are outside of them.

        The first call fits them to its points. Later they grow by 5 m more than needed, so that the
        picture does not move all the time. N must not be 0.
        """
        low, high = points_enu.min(axis=0), points_enu.max(axis=0)
        if self._held is None:
            self._held = np.stack([low, high])
        elif np.all(low >= self._held[0] - 1.0) and np.all(high <= self._held[1] + 1.0):
            return
        else:
            self._held = np.stack(
                [np.minimum(low - 5.0, self._held[0]), np.maximum(high + 5.0, self._held[1])]
            )
        self.set_ground(self._held, float(min(self._held[0][2], 0.0)))

    @property
    def _extent(self) -> float:
        """Return half of the longer side of the scene's content, m."""
        return max(float(np.max(self._high - self._low)) / 2, 5.0)

    def set_field(self, field: Field | None) -> None:
        """Draw the sprayed ground, its outline and the swath lines; None, or a field without
        swaths, draws nothing."""
        if field is None or not field.swaths_ned:
            return
        if not field.ground.is_empty:
            vertices, faces = fill(field.ground)
            self._api.add_mesh_simple(
                "/world/field",
                np.column_stack([vertices, np.full(len(vertices), self._ground - 0.03)]),
                faces,
                color=GROUND_GREEN,
                side="double",
                cast_shadow=False,
                receive_shadow=False,
            )
            rings = [
                np.column_stack([ring[:, ::-1], np.full(len(ring), self._ground)])
                for part in field.ground.geoms
                for ring in map(shapely.get_coordinates, (part.exterior, *part.interiors))
            ]
            self._lines("/world/outline", rings, FIELD_GREEN, 2.5)
        flat = [
            np.column_stack([enu(s)[:, :2], np.full(len(s), self._ground)])
            for s in field.swaths_ned
        ]
        self._lines("/world/swaths", flat, FIELD_GREEN, 2.0)

    def set_plan(self, key: str, points_enu: Floats, ground: float) -> None:
        """Draw the planned path of aircraft `key`, flat at the height `ground`, m.

        `points_enu` (W, 3) are its places, m; with W below 2 a path drawn before is removed. Legs
        of a large plan that no picture of it can distinguish are drawn once.
        """
        name = f"/world/plan_{key}"
        legs = distinct_legs(points_enu[:, :2])
        if legs.size:
            on_ground = np.dstack([legs, np.full(legs.shape[:2], ground)])
            self._lines(name, list(on_ground), PLAN_GREY, 2.0)
            self._planned.add(name)
        elif name in self._planned:
            self._api.remove_by_name(name)
            self._planned.remove(name)

    def set_route(self, key: str, points_enu: Floats, values: Floats, scale: ColourScale) -> None:
        """Draw aircraft `key`'s flown segments (S, 2, 3), m east, north, up, replacing others.

        Segment k has the colour of `values[k]`, of S values, on `scale`.
        """
        ends = np.repeat(sent_for(scale.screen(values))[:, None], 2, axis=1)
        line = self._routes.get(key)
        if line is not None and len(line.points) == len(points_enu):
            if not np.array_equal(line.points, points_enu.astype(np.float32)):
                line.points = points_enu.astype(np.float32)
            line.colors = ends
            return
        self._routes[key] = self._api.add_line_segments(
            f"/world/route_{key}",
            points_enu,
            ends,
            thickness=ROUTE_PIXELS,
            thickness_units="screen",
        )

    def set_pin(self, position_enu: Floats) -> None:
        """Mark a position (3,), m; remove the mark for NaN."""
        self._pinned = bool(np.all(np.isfinite(position_enu)))
        self._show_pin()
        if self._pinned:
            self._pin.position = position_enu
            self._pin.point_size = 0.03 * self._extent

    def _show_pin(self) -> None:
        """Show the mark only in the overview, and not near the aircraft, where it would hide a
        rotor."""
        self._pin.visible = self._pinned and self.camera is Camera.FIELD and not self._covered

    def in_world(self, origin: Sequence[float], ray: Sequence[float]) -> tuple[Floats, Floats]:
        """Convert a ray of the page to coordinates of the world, which a camera moves.

        `origin` (3,) is in m, `ray` (3,) a direction; return both as arrays (3,).
        """
        turn = SO3(self._world.wxyz).inverse()
        both = np.array([np.asarray(origin) - self._world.position, ray], dtype=np.float64)
        start, way = both @ turn.as_matrix().T
        return start, way

    def add_vehicle(self, key: str, airframe: Airframe) -> None:
        """Add an aircraft; `key` is the name that `show` takes."""
        self._vehicles[key] = VehicleNode(self._api, "/world", key, airframe)
        self._rescale()

    def add_name(self, key: str) -> LabelHandle:
        """Add and return a label with an aircraft's name `key`, hidden until it is placed."""
        return self._api.add_label(
            f"/world/name_{key}",
            key,
            anchor="bottom-center",
            font_screen_scale=1.25,
            visible=False,
        )

    def show(
        self,
        key: str,
        row: ShownRow,
        *,
        focus: bool = True,
        faulty: frozenset[int] = frozenset(),
        old: bool = False,
    ) -> None:
        """Move the aircraft `key` to `row`; with `focus` a following camera moves with it.

        `faulty` are the numbers, from 1, of the rotors with an alarm. Rotors of an `old` row have
        no colour.
        """
        self._vehicles[key].show(row, faulty, old=old)
        if focus:
            away = np.linalg.norm(row.position_enu - self._pin.position)
            covered = bool(away < 2.0 * self._vehicles[key].drawn_arm)
            if covered != self._covered:
                self._covered = covered
                self._show_pin()
        if focus and self.camera is not Camera.FIELD:
            self._centre_on(row.position_enu, row.wxyz)

    def show_wind(self, wind_ned: Floats) -> None:
        """Draw the wind (3,), m/s, next to the field; NaN removes it."""
        place = np.array([self._low[0], self._high[1], self._ground]) + 0.12 * self._extent
        self.surroundings.wind(wind_ned, np.round([*place[:2], self._ground], 1), self._extent / 4)

    def hide(self, key: str) -> None:
        """Remove an aircraft from the scene until `show` is called again."""
        self._vehicles[key].hide()

    def above(self, key: str) -> Floats:
        """Return (3,) m from an aircraft to the place of its name above its rotors, as drawn."""
        return np.array([0.0, 0.0, 1.2 * self._vehicles[key].drawn_arm])

    def set_camera(self, camera: Camera) -> None:
        """Show the whole field, or follow the aircraft."""
        self.camera = camera
        self._show_pin()
        self._rescale()
        if camera is Camera.FIELD:
            self._world.position = np.zeros(3)
            self._world.wxyz = NO_TURN
        self._look()

    def _centre_on(self, position_enu: Floats, wxyz: Floats) -> None:
        """Move the world so that the position (3,), m east, north, up, is at the page's origin.

        `wxyz` (4,) is the aircraft's attitude; the chase camera also turns its nose north. Nothing
        moves where the position is unknown.
        """
        if not np.all(np.isfinite(position_enu)):
            return
        forward = self.camera is Camera.CHASE and bool(np.all(np.isfinite(wxyz)))
        turn, self._world.wxyz = nose_north(wxyz) if forward else (np.eye(3), NO_TURN)
        self._world.position = -turn @ position_enu

    def _rescale(self) -> None:
        note = [words.grid_words(self._cell)]
        for vehicle in self._vehicles.values():
            scale = 1.0
            if self.camera is Camera.FIELD:
                scale = max(OVERVIEW_SHARE * self._extent / vehicle.arm, 1.0)
            vehicle.set_scale(scale, detailed=self.camera is not Camera.FIELD)
            note.append(words.drawn_larger(scale))
        self._note.text = ", ".join(dict.fromkeys(note))

    def _look(self) -> None:
        """Aim the camera of this scene's browser; without one, of all pages that open later."""
        if self._client is not None:
            self._aim(self._client)
            return
        position, look_at = self._view(FIRST_ASPECT)
        self._server.initial_camera.position = tuple(position)
        self._server.initial_camera.look_at = tuple(look_at)

    def _keep_fitted(self, client: ClientHandle) -> None:
        """Aim the browser's camera now, and again when its picture's shape changes.

        It does when panels dock or the window is resized.
        """
        fitted = [client.camera.aspect]

        def refit(camera: CameraHandle) -> None:
            if abs(camera.aspect / fitted[0] - 1) > 0.05:
                fitted[0] = camera.aspect
                if self.camera is Camera.FIELD:
                    self._aim(client)

        client.camera.on_update(refit)
        self._aim(client)

    def _aim(self, client: ClientHandle) -> None:
        position, look_at = self._view(client.camera.aspect)
        with client.atomic():
            client.camera.position = position
            client.camera.look_at = look_at

    def _view(self, aspect: float) -> tuple[Floats, Floats]:
        """Return camera position and look-at point, (3,) m, for the chosen camera.

        `aspect` is the picture's width over its height.
        """
        if self.camera is Camera.FIELD:
            return overview(self._low, self._high, aspect)
        arm = max((v.arm for v in self._vehicles.values()), default=1.0)
        return behind(arm)

    def _lines(self, name: str, polylines: Sequence[Floats], colour: Rgb, pixels: float):
        points = np.concatenate([np.stack([p[:-1], p[1:]], axis=1) for p in polylines])
        self.surroundings.lines(name, points, colour, pixels)


def row_hit(points_enu: Floats, among: Bools, origin: Floats, ray: Floats) -> int | None:
    """Return the index of the point nearest to a ray by angle, among those that `among` (T,) flags.

    `points_enu` (T, 3), `origin` (3,) in m; `ray` (3,) is a direction of any length. None where no
    such point is in front and within two degrees of the ray, a finger's width on a phone.
    """
    away = points_enu - origin
    ray = ray / np.linalg.norm(ray)
    forward = away @ ray
    off_axis = np.linalg.norm(away - forward[:, None] * ray, axis=1)
    slope = np.where(among & (forward > 0.0), off_axis / np.maximum(forward, 1e-9), np.inf)
    slope = np.where(np.isfinite(slope), slope, np.inf)
    row = int(np.argmin(slope))
    return row if slope[row] < np.tan(HIT) else None


def grid_cell(extent: float) -> float:
    """Return the side of a grid's cell, m: the 1, 2, 5 or 10 x power of ten nearest extent / 10."""
    raw = extent / 10
    power = 10.0 ** np.floor(np.log10(raw))
    return float(power * min((1, 2, 5, 10), key=lambda m: abs(m * power - raw)))


def fill(ground: shapely.MultiPolygon) -> tuple[Floats, np.ndarray]:
    """Triangulate the ground, whose coordinates are north, east, m, without its holes.

    Return vertices (V, 2), m east, north, and triangles (F, 3), indices of vertices.
    """
    triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(ground))
    corners = shapely.get_coordinates(triangles).reshape(-1, 4, 2)[:, :3, ::-1].reshape(-1, 2)
    return corners, np.arange(len(corners)).reshape(-1, 3)
