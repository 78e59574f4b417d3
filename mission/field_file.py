"""Read a field's outline from KML, KMZ, GeoJSON, a shapefile with its .prj, or ISOXML part fields.

The format is recognised by the content. Shapefiles, and GeoJSON in another system than WGS 84, need
pyshp and pyproj, the extra `field`.
"""

from __future__ import annotations

import io
import json
import logging
import lzma
import struct
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import closing
from itertools import islice
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, ParseError

import numpy as np
import shapely
import shapely.geometry
from defusedxml import ElementTree
from defusedxml.common import DefusedXmlException

from thrustmargin.mission.outline import FieldOutline, LocalPlane, TooWide, field_outline
from thrustmargin.models.errors import InstallError, PlanError, install_line
from thrustmargin.models.whole_file import regular

LARGEST_FILE = 16 * 2**20
#: Of one file, from which --part chooses.
MOST_POLYGONS = 10_000
WGS84 = ("CRS84", "EPSG::4326", "EPSG:4326")
_SHAPEFILE = b"\x00\x00\x27\x0a"
#: ISOXML kinds of polygon: the boundary; and water, buildings and obstacles, which are holes of it.
_BOUNDARY, _HOLES = "1", ("3", "4", "6")

#: What zipfile and the decompressors under it raise over a damaged archive.
DAMAGED_ARCHIVE = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, NotImplementedError),
    *(RuntimeError, OSError, EOFError, ValueError, LookupError, OverflowError),
    MemoryError,  # a dictionary of gigabytes that a damaged head asks for
)

#: Name and polygon in longitude, latitude in degrees.
Named = tuple[str, shapely.Polygon]


def read_field(
    path: Path, *, parts: Sequence[str] = (), plane: LocalPlane | None = None
) -> FieldOutline:
    """Read a field's outline from a file, in the local plane `plane`, or a plane about the field.

    `parts` selects polygons by name, or number from 1; empty: all. Raise PlanError if the file has
    none of the formats or no valid outline, InstallError if a library for it is missing.
    """
    name = path.name
    try:
        if regular(path).stat().st_size > LARGEST_FILE:
            raise PlanError(f"{name} has more than {LARGEST_FILE >> 20} MiB; that is no field")
        data = path.read_bytes()
    except OSError as error:
        raise PlanError(f"{path} cannot be read: {error.strerror}") from error
    with np.errstate(invalid="ignore"):  # corners that are no numbers are refused later
        polygons = _polygons(data, path)
    if not polygons:
        raise PlanError(f"{name} has no polygon; draw the field's outline and save it again")
    chosen = _chosen(polygons, parts, name) if parts else polygons
    try:
        return field_outline(name, [polygon for _, polygon in chosen], plane)
    except TooWide as error:
        raise PlanError(
            f"{error}; it has {_listed(polygons)}: name those meant with --part"
        ) from error


def _listed(polygons: Sequence[Named]) -> str:
    first = ", ".join(f"{k} {title}".strip() for k, (title, _) in enumerate(polygons[:9], start=1))
    return f"{len(polygons)} polygons ({first:.200}{' ...' if len(polygons) > 9 else ''})"


def _chosen(polygons: Sequence[Named], parts: Sequence[str], name: str) -> list[Named]:
    chosen = []
    for part in parts:
        own = [f for k, f in enumerate(polygons, start=1) if part in (f[0], str(k))]
        if not own:
            raise PlanError(f"{name} has no part {part!r:.40}; it has {_listed(polygons)}")
        chosen += own
    return chosen


def _polygons(data: bytes, path: Path) -> list[Named]:
    name = path.name
    try:
        if data.startswith(b"PK"):
            data = _kml_of(data, name)
        if data.startswith(_SHAPEFILE):
            return _of_shapefile(data, path)
        text = data.lstrip(b"\xef\xbb\xbf \t\r\n")
        if text.startswith(b"<"):
            return _bounded(_of_xml(ElementTree.fromstring(text), name), name)
        content = json.loads(text)
        return _in_system(_bounded(_of_geojson(content, name), name), content, name)
    except (ParseError, DefusedXmlException) as error:
        raise PlanError(f"{name} is damaged: {error}; save it again") from error
    except (UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
        raise PlanError(
            f"{name} is no field: KML, KMZ, GeoJSON, a shapefile (.shp) or ISOXML are read"
        ) from error
    except (ValueError, TypeError, LookupError, AttributeError, OverflowError) as error:
        raise PlanError(f"{name} is damaged ({error!s:.80}); save it again") from error
    except shapely.errors.ShapelyError as error:
        raise PlanError(f"{name} has a polygon that is none ({error!s:.80})") from error


def _bounded(polygons: Iterator[Named], name: str) -> list[Named]:
    kept = list(islice(polygons, MOST_POLYGONS + 1))
    if len(kept) > MOST_POLYGONS:
        raise PlanError(f"{name} has more than {MOST_POLYGONS} polygons; save those of one field")
    return kept


def _kml_of(data: bytes, name: str) -> bytes:
    """Return the bytes of the first KML file in a KMZ archive.

    Raise PlanError if there is none, it is too large, or the archive is damaged.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            inside = [i for i in archive.infolist() if i.filename.lower().endswith(".kml")]
            if not inside:
                raise PlanError(f"{name} is an archive without a .kml; unpack it and name the file")
            if inside[0].file_size > LARGEST_FILE:
                raise PlanError(f"{name} unpacks to more than {LARGEST_FILE >> 20} MiB")
            with archive.open(inside[0]) as file:
                return file.read(LARGEST_FILE)
    except DAMAGED_ARCHIVE as error:
        raise PlanError(f"{name} is a damaged archive ({error}); save it again") from error


def _kind(element: Element) -> str:
    return str(element.tag).rsplit("}", 1)[-1]


def _of_xml(root: Element, name: str) -> Iterator[Named]:
    if _kind(root) in ("ISO11783_TaskData", "XFC"):
        yield from _of_isoxml(root, name)
        return
    if _kind(root) != "kml":
        raise PlanError(
            f"{name} is XML of another kind ({_kind(root)!r:.40}); KML or ISOXML is read"
        )
    to_visit = [(root, "")]  # no recursion: files can be nested deeper than that goes
    while to_visit:
        element, title = to_visit.pop()
        kind = _kind(element)
        if kind == "Placemark":
            title = next((e.text or "" for e in element if _kind(e) == "name"), "").strip()
        if kind != "Polygon":
            to_visit += [(child, title) for child in reversed(element)]
            continue
        rings = {"outerBoundaryIs": [], "innerBoundaryIs": []}
        for boundary in element:
            if _kind(boundary) in rings:
                rings[_kind(boundary)] += _kml_rings(boundary)
        outer = rings["outerBoundaryIs"]
        if len(outer) != 1:
            raise PlanError(f"{name} has a polygon with {len(outer)} outlines; draw it again")
        yield title, _polygon(outer[0], rings["innerBoundaryIs"], name)


def _kml_rings(boundary: Element) -> list[list[list[float]]]:
    return [
        [[float(x) for x in corner.split(",")[:2]] for corner in (e.text or "").split()]
        for e in boundary.iter()
        if _kind(e) == "coordinates"
    ]


def _of_isoxml(root: Element, name: str) -> Iterator[Named]:
    """Yield name and polygon of the part fields (PFD) of ISO 11783-10: polygons (PLN) of rings
    (LSG) of points (PNT).

    Only boundaries are yielded, without their inner rings and the field's exclusion zones; an
    outline that falls apart is yielded in parts. Raise PlanError without a part field.
    """
    fields = [e for e in root.iter() if _kind(e) == "PFD"]
    if not fields:
        others = [e.get("A", "") for e in root.iter() if _kind(e) == "XFR"]
        part = next((other for other in others if other.startswith("PFD")), None)
        hint = f"; its part fields are in {part}.XML: name that file" if part else ""
        raise PlanError(f"{name} has no part field{hint}")
    for field in fields:
        title = field.get("C", "") or field.get("B", "")
        polygons = [e for e in field if _kind(e) == "PLN"]
        holes = [r for p in polygons if p.get("A") in _HOLES for r in _iso_rings(p, "1")]
        for polygon in polygons:
            if polygon.get("A") != _BOUNDARY:
                continue
            inner = [(r, _polygon(r, [], name)) for r in _iso_rings(polygon, "2")]
            for ring in _iso_rings(polygon, "1"):
                alone = _polygon(ring, [], name)
                own = [r for r, hole in inner if shapely.intersects(alone, hole)]
                outline = _polygon(ring, own, name)
                for hole in holes:
                    outline = outline.difference(_polygon(hole, [], name))
                for part in shapely.get_parts(outline):
                    yield title, part


def _iso_rings(polygon: Element, kind: str) -> list[list[list[float]]]:
    return [
        [[float(p.get("D", "")), float(p.get("C", ""))] for p in ring if _kind(p) == "PNT"]
        for ring in polygon
        if _kind(ring) == "LSG" and ring.get("A") == kind
    ]


def _polygon(outer: Sequence[Any], holes: Sequence[Any], name: str) -> shapely.Polygon:
    for ring in (outer, *holes):
        if len(ring) < 3:
            raise PlanError(f"{name} has an outline of {len(ring)} corners; draw it again")
    return shapely.Polygon(outer, holes)


def _of_geojson(content: Any, name: str) -> Iterator[Named]:
    if not isinstance(content, dict) or "type" not in content:
        raise PlanError(f"{name} is JSON of another kind; a field is GeoJSON")
    if content.get("fileType") == "Plan":
        raise PlanError(f"{name} is a plan; a field is KML, GeoJSON, a shapefile or ISOXML")
    features = content.get("features") if content["type"] == "FeatureCollection" else [content]
    if not isinstance(features, list):
        raise PlanError(f"{name} has no list of features; save it again")
    for feature in features:
        geometry, title = feature, ""
        if feature.get("type") == "Feature":
            geometry = feature.get("geometry")
            properties = feature.get("properties") or {}
            title = str(properties.get("name") or properties.get("Name") or "")
        if geometry is not None:
            shape = shapely.force_2d(shapely.geometry.shape(geometry))
            for polygon in _all_polygons(shape):
                yield title, polygon


def _in_system(polygons: list[Named], content: dict[str, Any], name: str) -> list[Named]:
    """Return GeoJSON polygons in degrees, converted if the member "crs" states another system."""
    system = content.get("crs")
    if system is None:
        return polygons
    stated = str(system.get("properties", {}).get("name", ""))
    return polygons if stated.endswith(WGS84) else _in_degrees(polygons, stated, name)


def _all_polygons(shape: Any) -> list[shapely.Polygon]:
    if shape.geom_type == "GeometryCollection":
        return [p for part in shape.geoms for p in _all_polygons(part)]
    return [p for p in shapely.get_parts(shape) if p.geom_type == "Polygon"]


def _of_shapefile(data: bytes, path: Path) -> list[Named]:
    try:
        import shapefile
    except ImportError as error:
        raise InstallError(
            f"{path.name} is a shapefile; to read it run: {install_line('field')}"
        ) from error
    system = next((p for s in (".prj", ".PRJ") if (p := path.with_suffix(s)).is_file()), None)
    if system is None:
        raise PlanError(
            f"{path.name} has no .prj beside it, so where it lies is not known; copy it, too"
        )
    logging.getLogger(shapefile.__name__).setLevel(logging.ERROR)  # rings the other way round
    try:
        with closing(shapefile.Reader(shp=io.BytesIO(data))) as reader:
            read: Any = reader.iterShapes()
            shapes = [shapely.geometry.shape(shape.__geo_interface__) for shape in read]
    except shapefile.ShapefileException as error:
        raise PlanError(f"{path.name} is damaged ({error!s:.80}); save it again") from error
    except Exception as error:  # pyshp lets what struct and array say through
        raise PlanError(f"{path.name} is damaged; save it again") from error
    polygons = [("", p) for s in shapes for p in _all_polygons(shapely.force_2d(s))]
    try:
        words = system.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise PlanError(f"{system} cannot be read: {error.strerror}") from error
    return _in_degrees(polygons, words, path.name)


def _in_degrees(polygons: Sequence[Named], system: str, name: str) -> list[Named]:
    """Convert named polygons from a coordinate system to longitude and latitude, degrees.

    `system` is the name or text of the system, as pyproj reads it; `name` is the file's. Raise
    PlanError if the system is not known, InstallError without pyproj.
    """
    try:
        import pyproj
        from pyproj.exceptions import ProjError
    except ImportError as error:
        raise InstallError(
            f"{name} is not in WGS 84; to read it run: {install_line('field')}"
        ) from error
    try:
        crs = pyproj.CRS.from_user_input(system)
        to_degrees = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    except ProjError as error:
        words = " ".join(system.split())
        raise PlanError(
            f"{name} is in a coordinate system that is not known ({words:.60}); save it in WGS 84"
        ) from error

    def degrees(points: np.ndarray) -> np.ndarray:
        return np.column_stack(to_degrees.transform(points[:, 0], points[:, 1]))

    return [(title, shapely.transform(polygon, degrees)) for title, polygon in polygons]
