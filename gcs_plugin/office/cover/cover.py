"""`thrustmargin cover`: plan the route that sprays a field, for the ground station."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import tyro
from tyro.conf import Positional, UseAppendAction

from thrustmargin.gcs_plugin.commands.shared.options import (
    OutputFile,
    UsageError,
    check_outputs,
    check_range,
)
from thrustmargin.gcs_plugin.commands.shared.plan_source import pump_of
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
from thrustmargin.models.errors import require

PLANS = (".plan", ".waypoints", ".txt")


def cover(
    field: Annotated[Positional[Path], tyro.conf.arg(metavar="FIELD")],
    *,
    swath: float,
    speed: float = 5.0,
    height: float = 3.0,
    heading: float | None = None,
    headland: float = 0.0,
    obstacles: Path | None = None,
    clearance: float | None = None,
    no_spray: Path | None = None,
    part: UseAppendAction[tuple[str, ...]] = (),
    home: str | None = None,
    above_ground: bool = False,
    pump: str = "sprayer",
    px4: bool = False,
    out: Annotated[UseAppendAction[tuple[Path, ...]], tyro.conf.arg(aliases=["-o"])] = (),
) -> None:
    """Plan the route that sprays a field, and write it for the ground station.

    Lines back and forth, the pump on along them and off between; holes are flown around.

    Example: thrustmargin cover demo --swath 5 --speed 4 --height 3 -o field.plan

    Args:
        field: Outline of the field: KML, KMZ, GeoJSON, shapefile (.shp with .prj) or ISOXML;
            demo is a bundled one.
        swath: m between lines.
        speed: m/s over the ground.
        height: m above home, or above the ground with --above-ground.
        heading: ° of the lines, 0 is north; without it the heading with the fewest turns.
        headland: m kept free along the edges.
        obstacles: File of areas that are flown around, in any format of a field.
        clearance: m kept from obstacles; without it half a swath.
        no_spray: File of areas that are flown over with the pump off.
        part: Name or number of the polygon of the file that is meant; may be given again.
        home: Where it takes off: LATITUDE,LONGITUDE or LATITUDE,LONGITUDE,ALTITUDE in m above the
            sea; without it where the first line starts.
        above_ground: Heights are above the terrain, as far as the vehicle knows it.
        pump: What switches the pump: sprayer (DO_SPRAYER), servo:NUMBER:ON:OFF with pulses in µs,
            or relay:NUMBER.
        px4: For PX4, which has no DO_SPRAYER: give --pump, too.
        out: File to write, .plan (QGroundControl) or .waypoints; may be given again. Without any,
            field.plan.
    """
    require("cover", "scipy")
    from thrustmargin.gcs_plugin.office.cover.cover_words import coverage_words
    from thrustmargin.gcs_plugin.office.cover.coverage_plan import CoverageOrder, cover_field
    from thrustmargin.mission.field_file import read_field
    from thrustmargin.mission.plan import write_plan

    check_range("--swath", swath, 0.1, 100.0, "m")
    check_range("--speed", speed, 0.2, 30.0, "m/s")
    check_range("--height", height, 0.5, 500.0, "m")
    check_range("--headland", headland, 0.0, 1000.0, "m")
    check_range("--heading", 0.0 if heading is None else heading, -360.0, 360.0, "°")
    clear = swath / 2 if clearance is None else clearance
    check_range("--clearance", clear, 0.0, 1000.0, "m")
    output = pump_of(pump)
    if px4 and output.servo is None and output.relay is None:
        raise UsageError("PX4 has no DO_SPRAYER; say what switches the pump with --pump")
    out = out or (Path("field.plan"),)
    check_outputs(
        [OutputFile("--out", path, endings=PLANS) for path in out],
        inputs=[field, obstacles, no_spray],
    )
    place = None if home is None else _home(home)
    outline = read_field(field, parts=part)
    order = CoverageOrder(
        swath=swath,
        speed=speed,
        height=height,
        heading_deg=heading,
        headland=headland,
        clearance=clear,
        above_ground=above_ground,
        pump=output,
        px4=px4,
    )
    coverage = cover_field(
        outline,
        order,
        obstacles=None if obstacles is None else read_field(obstacles, plane=outline.plane),
        no_spray=None if no_spray is None else read_field(no_spray, plane=outline.plane),
        home=place,
    )
    for path in out:
        write_plan(coverage.plan, path)
    console = Terminal(soft_wrap=True)
    for sentence in coverage_words(coverage):
        console.print(sentence)
    for path in out:
        console.print(f"wrote {path}: {len(coverage.plan.items)} items")


def _home(words: str) -> tuple[float, float, float]:
    """Parse option --home, `LATITUDE,LONGITUDE` or with `,ALTITUDE`: degrees, degrees, m AMSL.

    The altitude is NaN if it is not given. Raises UsageError for another text.
    """
    try:
        values = [float(word) for word in words.split(",")]
    except ValueError:
        values = []
    if len(values) not in (2, 3) or not all(map(math.isfinite, values)):
        raise UsageError(f"--home {words!r:.40} is not LATITUDE,LONGITUDE or with ,ALTITUDE")
    if abs(values[0]) > 90.0 or abs(values[1]) > 180.0:
        raise UsageError(f"--home {words!r:.40} is no place on Earth; degrees are needed")
    return (values[0], values[1], values[2] if len(values) == 3 else math.nan)
