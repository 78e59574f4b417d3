"""Plans that are made to break a reader, for `python -m tests.lab.plans.hostile`."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import Any

HOME = [48.0, 11.0, 500.0]
TRACEBACK = "Traceback"


def item(command: int, *values: Any, number: int = 1, frame: int = 3) -> dict[str, Any]:
    """One item of a .plan; `values` are its seven parameters, missing ones 0."""
    return {
        "autoContinue": True,
        "command": command,
        "doJumpId": number,
        "frame": frame,
        "params": [*values, *[0] * (7 - len(values))],
        "type": "SimpleItem",
    }


def place(latitude: Any, longitude: Any, height: Any = 5, **more: Any) -> dict[str, Any]:
    return item(16, 0, 0, 0, None, latitude, longitude, height, **more)


def plan(given: list[Any], **changed: Any) -> str:
    """The text of a .plan file of these items after a take-off."""
    mission = {
        "cruiseSpeed": 5,
        "firmwareType": 3,
        "hoverSpeed": 5,
        "items": [item(22, 0, 0, 0, None, *HOME[:2], 5), *given],
        "plannedHomePosition": HOME,
        "vehicleType": 2,
        "version": 2,
    } | changed
    return json.dumps({"fileType": "Plan", "mission": mission, "version": 1})


def numbered(items: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [one | {"doJumpId": k} for k, one in enumerate(items, start=2)]


NEAR, FAR = place(48.0005, 11.0), place(48.0015, 11.0)


def zigzag(count: int, latitude: float = 48.0, step: float = 1e-4) -> list[dict[str, Any]]:
    return [place(latitude + 1e-3 * (k // 2 % 2), 11.0 + step * (k // 2)) for k in range(count)]


def jump(target: Any, repeats: Any) -> dict[str, Any]:
    return item(177, target, repeats)


def survey(**changed: Any) -> dict[str, Any]:
    points = [[48.0, 11.0], [48.001, 11.0], [48.001, 11.001]]
    pattern = {
        "CameraCalc": {"DistanceToSurface": 10, "DistanceToSurfaceRelative": True},
        "Items": [],
        "VisualTransectPoints": points,
    } | changed
    return {
        "type": "ComplexItem",
        "complexItemType": "survey",
        "TransectStyleComplexItem": pattern,
        "polygon": points,
        "angle": 0,
    }


def fenced(polygon: list[Any]) -> str:
    content = json.loads(plan(numbered([NEAR, FAR, item(20)])))
    fence = [{"inclusion": True, "polygon": polygon, "version": 1}]
    return json.dumps(content | {"geoFence": {"circles": [], "polygons": fence, "version": 2}})


def wpl(rows: list[str]) -> str:
    return "\n".join(["QGC WPL 110", "0 1 0 16 0 0 0 0 48 11 500 1", *rows]) + "\n"


def star(corners: int, radius: float = 1e-3) -> list[list[float]]:
    """Longitude and latitude of a comb-like outline, closed."""
    found = []
    for k in range(corners):
        far = radius * (1.0 if k % 2 else 0.3)
        a = 2.0 * math.pi * k / corners
        found.append([11.0 + far * math.sin(a), 48.0 + far * math.cos(a)])
    return [*found, found[0]]


def plans() -> Iterator[tuple[str, str | bytes]]:
    """Name and content of each plan."""
    ways = numbered([NEAR, FAR])
    yield "good.plan", plan([*ways, item(20)])
    for word in ("NaN", "Infinity", "-Infinity", "1e999", "1e308", "-1e308", '"x"', "[]", "true"):
        text = plan([*ways, item(20)])
        label = "".join(c for c in word if c.isalnum())
        yield f"altitude-{label}.plan", text.replace("48.0015", word)
        yield (
            f"speed-{label}.plan",
            plan([item(178, 1, 7.77, -1, number=2), *ways]).replace("7.77", word),
        )
        yield f"home-{label}.plan", text.replace("500.0", word)
        yield f"command-{label}.plan", text.replace('"command": 16', f'"command": {word}', 1)
        yield (
            f"wait-{label}.plan",
            plan([item(19, 7.77, 0, 0, 0, 48.001, 11, 5)]).replace("7.77", word),
        )
        yield f"hover-{label}.plan", plan(ways, hoverSpeed=7.77).replace("7.77", word)
    yield "digits.plan", plan(ways).replace("48.0015", "9" * 1_000_000)
    yield "digits-after.plan", plan(ways).replace("48.0015", "48." + "9" * 5_000_000)
    yield "exponent.plan", plan(ways).replace("48.0015", "1e" + "9" * 100_000)
    yield "deep.plan", "[" * 5_000_000
    yield "deep-objects.plan", '{"a":' * 1_000_000
    yield "deep-in-item.plan", plan(ways).replace("48.0015", "[" * 500_000 + "]" * 500_000)
    yield "empty.plan", ""
    yield "null.plan", "null"
    yield "items-null.plan", plan([], items=None)
    yield "items-billion-said.plan", plan(ways, itemCount=10**9)
    yield "item-numbers-huge.plan", plan([place(48.001, 11, number=10**9), NEAR])
    yield "item-numbers-alike.plan", plan([NEAR, FAR, NEAR, jump(1, 5)])
    yield "many-items.plan", plan(zigzag(200_000))
    yield "most-items.plan", plan(numbered([*zigzag(24_900), item(20)]))
    yield "most-items-one-place.plan", plan(numbered([NEAR] * 24_900 + [FAR]))
    yield "most-items-near.plan", plan(numbered(zigzag(24_900, step=1e-8)))
    yield "most-waits.plan", plan(numbered([FAR, NEAR] * 12_400)).replace("48.0015", "48.2")
    yield (
        "most-kinds.plan",
        plan(
            numbered(
                [
                    place(48 + 1e-6 * (k * 7919 % 5000), 11 + 1e-6 * k, 5 + k % 90)
                    for k in range(24_900)
                ]
            )
        ),
    )
    orders = [item(178, 1, 1 + k % 9, -1) for k in range(24_900)]
    yield "most-orders.plan", plan(numbered([*orders, *ways]))
    yield "most-jumps.plan", plan(numbered([NEAR, FAR, *[jump(2, 65535)] * 24_900]))
    yield (
        "unknown-commands.plan",
        plan(numbered([NEAR, FAR, *[item(31000 + k % 999) for k in range(24_900)]])),
    )
    yield (
        "most-pumps.plan",
        plan(
            numbered(
                [
                    x
                    for k in range(12_400)
                    for x in (place(48 + 1e-3 * (k % 2), 11 + 1e-5 * k), item(216, k % 2))
                ]
            )
        ),
    )
    yield "jump-most.plan", plan(numbered([NEAR, FAR, jump(2, 9_900), item(20)]))
    yield "jump-itself.plan", plan(numbered([NEAR, FAR, jump(4, 5)]))
    yield "jump-nowhere.plan", plan(numbered([NEAR, FAR, jump(99, 5)]))
    yield "jump-bomb.plan", plan(numbered([NEAR, FAR, *[jump(2, 65535)] * 6, item(20)]))
    yield "jump-endless.plan", plan(numbered([NEAR, FAR, jump(2, -1), item(20)]))
    yield "jump-huge.plan", plan(numbered([NEAR, FAR, jump(2, 10**14), item(20)]))
    yield "jump-fraction.plan", plan(numbered([NEAR, FAR, jump(2.5, 1.5), item(20)]))
    yield "jump-only.plan", plan(numbered([jump(3, 5), jump(2, 5)]))
    yield "jump-tags.plan", plan(numbered([item(600, 1), NEAR, FAR, item(601, 1, 65535), item(20)]))
    for name, at in (
        ("pole", (90, 0)),
        ("south-pole", (-90, 180)),
        ("date-line", (0, 180)),
        ("over-date-line", (0.0, -179.9999)),
        ("beyond", (91, 11)),
        ("nowhere", (48, 181)),
    ):
        yield f"{name}.plan", plan(numbered([place(*at), place(at[0] - 1e-3, at[1])]))
        yield (
            f"{name}-home.plan",
            plan(
                numbered([place(*at), place(at[0] - 1e-3, at[1])]),
                plannedHomePosition=[at[0], -at[1] if abs(at[1]) == 180 else at[1], 10],
            ),
        )
    yield "antipode.plan", plan(numbered([place(-48, -169)]))
    yield "high.plan", plan(numbered([place(48.001, 11, 1e9)]))
    yield "low.plan", plan(numbered([place(48.001, 11, -1e6), NEAR]))
    yield "slow.plan", plan(numbered([item(178, 1, 1e-9, -1), NEAR, FAR]))
    yield "fast.plan", plan(numbered([item(178, 1, 1e9, -1), NEAR, FAR]))
    yield "wait-ever.plan", plan(numbered([NEAR, item(19, 1e12, 0, 0, 0, 48.001, 11, 5), FAR]))
    yield "turns-ever.plan", plan(numbered([item(18, 1e12, 0, 50, 0, 48.001, 11, 5), FAR]))
    yield "delay-ever.plan", plan(numbered([NEAR, item(93, 1e12), FAR]))
    yield "survey-empty.plan", plan([survey(VisualTransectPoints=[])])
    yield "survey-shown.plan", plan([survey()])
    yield "survey-huge.plan", plan([survey(VisualTransectPoints=[[48.0, 11.0]] * 500_000)])
    yield "survey-nan.plan", plan([survey(VisualTransectPoints=[[48.0, None]] * 3)])
    yield "survey-nested.plan", plan([survey(Items=[survey()])])
    yield "survey-spacing.plan", plan([survey(Items=zigzag(60_000, step=1e-9))])
    yield "survey-billion.plan", plan([survey(CameraCalc={"AdjustedFootprintSide": 1e-9})])
    yield "fence-million.plan", fenced([[48 + 1e-9 * k, 11] for k in range(100_000)])
    yield "fence-star.plan", fenced([[b, a] for a, b in star(100_000)])
    yield "fence-crossing.plan", fenced([[48, 11], [48.01, 11.01], [48.01, 11], [48, 11.01]])
    yield "fence-nan.plan", fenced([[48, None]] * 5)
    yield "fence-point.plan", fenced([[48, 11]] * 5)
    content = json.loads(plan(ways)) | {
        "rallyPoints": {"points": [[48, 11, 5]] * 500_000, "version": 2}
    }
    yield "rally-million.plan", json.dumps(content)
    circles = [{"circle": {"center": [48, 11], "radius": 1e9}, "inclusion": True, "version": 1}]
    content = json.loads(plan(ways)) | {
        "geoFence": {"circles": circles * 100_000, "polygons": [], "version": 2}
    }
    yield "circles-many.plan", json.dumps(content)
    yield "spaces.plan", " " * 30_000_000 + plan(ways)
    yield "strings.plan", plan(ways, plannedBy="x" * 30_000_000)
    yield "keys.plan", plan(ways, **{f"k{k}": 1 for k in range(500_000)})
    yield "commas.plan", plan(ways, more=[0] * 10_000_000)
    yield "objects.plan", plan(ways, more=[{}] * 7_000_000)
    yield (
        "lists.plan",
        '{"fileType":"Plan","version":1,"mission":{"items":[' + "[],".join([""] * 8_000_000),
    )
    for size in (50, 200):
        yield f"large-{size}.plan", plan(ways, more="x" * size * 10**6)
        yield f"large-{size}.waypoints", wpl(["x" * size * 10**6])
        yield f"large-{size}.mission", plan(ways, more="x" * size * 10**6)
        yield f"zeros-{size}.plan", bytes(size * 10**6)
        yield f"zeros-{size}.tlog", bytes(size * 10**6)
        yield f"zeros-{size}.bin", bytes(size * 10**6)
        yield f"braces-{size}.json", b"{" * (size * 10**6)
        yield f"words-{size}.txt", b"QGC WPL 110\n" + b"1 " * (size * 5 * 10**5)
    row = "{} 0 3 16 0 0 0 0 48.00{} 11 5 1"
    yield "million.waypoints", wpl([row.format(k, k % 9) for k in range(1, 1_000_001)])
    yield "million-short.waypoints", "QGC WPL 110\n" + "\n" * 30_000_000
    yield "comments.waypoints", "QGC WPL 110\n" + "#\n" * 10_000_000
    yield "returns.waypoints", "QGC WPL 110\n" + "\r" * 30_000_000
    yield "separators.waypoints", "QGC WPL 110\n" + "\x1e1 " * 8_000_000
    yield "one-line.waypoints", wpl(["1 " * 10_000_000])
    yield "nan.waypoints", wpl(["1 0 3 16 0 0 0 0 nan nan nan 1"])
    yield "inf.waypoints", wpl(["1 0 3 16 0 0 0 0 inf 11 5 1"])
    yield "digits.waypoints", wpl([f"{'9' * 1_000_000} 0 3 16 0 0 0 0 48.001 11 5 1"])
    yield "digits-float.waypoints", wpl([f"1 0 3 16 0 0 0 0 48.{'9' * 9_000_000} 11 5 1"])
    yield "underscores.waypoints", wpl(["1_0 0 3 16 0 0 0 0 4_8 11 5 1"])
    yield "gap.waypoints", wpl(["7 0 3 16 0 0 0 0 48.001 11 5 1"])
    yield "self-jump.waypoints", wpl([row.format(1, 1), "2 0 3 177 2 -1 0 0 0 0 0 1"])
    yield "version.waypoints", "QGC WPL 100\n"
    yield "version-long.waypoints", "QGC WPL " + "9" * 10_000_000
    yield "billion.mission", json.dumps({"version": 10**9, "items": []})
    yield "deep.mission", "[" * 200_000
    old = {"id": 1, "type": "missionItem", "command": 16, "frame": 3, "param1": 1e308}
    yield (
        "old.mission",
        json.dumps({"version": "1.0", "items": [old] * 3, "plannedHomePosition": None}),
    )
    yield "complex.mission", json.dumps({"version": "1.0", "items": [], "complexItems": [{}] * 9})
