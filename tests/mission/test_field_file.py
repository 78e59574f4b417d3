"""Fields as others write them: KML, KMZ, GeoJSON, shapefiles, ISOXML; damage is one line."""

# pyright: reportAttributeAccessIssue=false, reportCallIssue=false, reportArgumentType=false

import json
import time
import zipfile
from contextlib import suppress
from pathlib import Path

import pyproj
import pytest
import shapefile
import shapely

from tests.mission.fields_made import degrees, geojson, rectangle
from thrustmargin.mission.field_file import read_field
from thrustmargin.models.errors import PlanError

FIELD = rectangle() - rectangle(20, 10, at=(50, 50))  # 60 000 - 200 m²
OTHER = rectangle(100, 100, at=(400, 0))


def ring(points, *, turned=False) -> str:
    return " ".join(f"{b},{a},0" if turned else f"{a},{b},0" for a, b in points)


def kml(*areas, names=("north", "south")) -> str:
    marks = ""
    for name, area in zip(names, map(degrees, areas), strict=False):
        inner = "".join(
            f"<innerBoundaryIs><LinearRing><coordinates>{ring(hole.coords)}</coordinates>"
            "</LinearRing></innerBoundaryIs>"
            for hole in area.interiors
        )
        marks += (
            f"<Placemark><name>{name}</name><Polygon><outerBoundaryIs><LinearRing><coordinates>"
            f"{ring(area.exterior.coords)}</coordinates></LinearRing></outerBoundaryIs>{inner}"
            "</Polygon></Placemark>"
        )
    head = '<?xml version="1.0" encoding="UTF-8"?>\n<kml xmlns="http://www.opengis.net/kml/2.2">'
    return f"{head}<Document>{marks}</Document></kml>"


def isoxml(*areas) -> str:
    fields = ""
    for k, area in enumerate(map(degrees, areas), start=1):
        rings = [(1, area.exterior.coords), *((2, hole.coords) for hole in area.interiors)]
        lines = "".join(
            f'<LSG A="{kind}">'
            + "".join(f'<PNT A="2" C="{latitude}" D="{longitude}"/>' for longitude, latitude in xy)
            + "</LSG>"
            for kind, xy in rings
        )
        pond = ""
        if k == 2:
            water = "".join(
                f'<PNT A="2" C="{b}" D="{a}"/>'
                for a, b in degrees(rectangle(10, 10, at=(410, 10))).exterior.coords
            )
            pond = f'<PLN A="3"><LSG A="1">{water}</LSG></PLN>'
        fields += f'<PFD A="PFD{k}" C="field {k}"><PLN A="1">{lines}</PLN>{pond}</PFD>'
    return f'<ISO11783_TaskData VersionMajor="4">{fields}</ISO11783_TaskData>'


def shape_file(folder: Path, area, system: str, *, prj: bool = True) -> Path:
    """A shapefile of `area`, longitude and latitude, in another coordinate system."""
    to = pyproj.Transformer.from_crs("EPSG:4326", system, always_xy=True)
    path = folder / "field.shp"
    with shapefile.Writer(str(path), shapeType=shapefile.POLYGON) as writer:
        writer.field("name", "C")
        rings = [area.exterior, *area.interiors]
        writer.poly([[to.transform(*p) for p in r.coords] for r in rings])
        writer.record("north")
    if prj:
        path.with_suffix(".prj").write_text(pyproj.CRS(system).to_wkt("WKT1_ESRI"))
    return path


def saved(folder: Path, text: str, name: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def area_of(path: Path, **options) -> float:
    return read_field(path, **options).area.area


def test_a_kml_with_a_hole_and_a_second_field(tmp_path: Path):
    path = saved(tmp_path, kml(FIELD, OTHER), "farm.kml")
    assert area_of(path) == pytest.approx(69_800.0, rel=1e-4)
    assert area_of(path, parts=["south"]) == pytest.approx(10_000.0, rel=1e-4)
    assert area_of(path, parts=["1"]) == pytest.approx(59_800.0, rel=1e-4)
    with pytest.raises(PlanError, match=r"no part 'west'; it has 2 polygons .1 north, 2 south"):
        read_field(path, parts=["west"])


def test_a_kmz_holds_a_kml(tmp_path: Path):
    with zipfile.ZipFile(tmp_path / "farm.kmz", "w") as archive:
        archive.writestr("doc.kml", kml(FIELD))
    assert area_of(tmp_path / "farm.kmz") == pytest.approx(59_800.0, rel=1e-4)


def test_geojson_in_degrees_and_in_metres(tmp_path: Path):
    assert area_of(geojson(FIELD, tmp_path)) == pytest.approx(59_800.0, rel=1e-4)
    to = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:32632", always_xy=True)
    moved = shapely.transform(degrees(FIELD), to.transform, interleaved=False)
    for name in ("urn:ogc:def:crs:EPSG::32632", "EPSG:32632"):
        content = {
            "type": "FeatureCollection",
            "crs": {"type": "name", "properties": {"name": name}},
            "features": [
                {
                    "type": "Feature",
                    "properties": {"name": "north"},
                    "geometry": shapely.geometry.mapping(moved),
                }
            ],
        }
        path = saved(tmp_path, json.dumps(content), "metres.geojson")
        assert area_of(path, parts=["north"]) == pytest.approx(59_800.0, rel=1e-4)
    content["crs"]["properties"]["name"] = "EPSG:1"
    with pytest.raises(PlanError, match=r"a coordinate system that is not known .EPSG:1.;"):
        read_field(saved(tmp_path, json.dumps(content), "metres.geojson"))


@pytest.mark.parametrize("system", ["EPSG:4326", "EPSG:32632", "EPSG:3857"])
def test_a_shapefile_lies_where_its_prj_says(tmp_path: Path, system: str):
    found = read_field(shape_file(tmp_path, degrees(FIELD), system))
    assert found.area.area == pytest.approx(59_800.0, rel=1e-4)
    assert found.plane.latitude_deg == pytest.approx(48.0009, abs=1e-3)


def test_a_shapefile_without_its_prj_is_refused(tmp_path: Path):
    path = shape_file(tmp_path, degrees(FIELD), "EPSG:32632", prj=False)
    with pytest.raises(PlanError, match=r"no .prj beside it, so where it lies is not known"):
        read_field(path)


def test_part_fields_of_isoxml_without_their_water(tmp_path: Path):
    path = saved(tmp_path, isoxml(FIELD, OTHER), "TASKDATA.XML")
    assert area_of(path, parts=["field 1"]) == pytest.approx(59_800.0, rel=1e-4)
    assert area_of(path, parts=["2"]) == pytest.approx(9_900.0, rel=1e-4)
    elsewhere = '<ISO11783_TaskData><XFR A="PFD00001" B="1"/></ISO11783_TaskData>'
    with pytest.raises(PlanError, match=r"part fields are in PFD00001.XML: name that file"):
        read_field(saved(tmp_path, elsewhere, "TASKDATA.XML"))


def test_fields_far_apart_are_listed(tmp_path: Path):
    far = shapely.affinity.translate(FIELD, 90_000.0, 0.0)
    with pytest.raises(PlanError, match=r"90 km across.*2 polygons .1 north, 2 south.*--part"):
        read_field(saved(tmp_path, kml(FIELD, far), "farm.kml"))


BOMB = '<!DOCTYPE k [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]><kml>&b;</kml>'


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is no field: KML, KMZ, GeoJSON"),
        ("hello", "is no field"),
        ("[" * 1_000_000, "is no field"),
        ("<kml><Placemark>", "is damaged"),
        ("<kml>" + "<a>" * 100_000 + "</a>" * 100_000 + "</kml>", "has no polygon"),
        (BOMB, "is damaged"),
        ("<svg/>", "is XML of another kind .'svg'"),
        ('{"fileType": "Plan"}', "is JSON of another kind"),
        ('{"type": "Plan", "fileType": "Plan"}', "is a plan; a field is KML"),
        ('{"type": "Polygon"}', "is damaged"),
        ('{"type": "Polygon", "coordinates": [[[0, 0], ["a", 1], [1, 1]]]}', "is damaged"),
        # A whole number that no float holds.
        (
            '{"type": "Polygon", "coordinates": [[[0, 0], [%s, 1], [1, 1]]]}' % ("9" * 400),
            "damaged",
        ),
        ('{"type": "Polygon", "coordinates": [[[0, 0], [NaN, 1], [1, 1]]]}', "is no number"),
        ('{"type": "Point", "coordinates": [0, 0]}', "has no polygon"),
        ('{"type": "FeatureCollection", "features": 7}', "has no list of features"),
        (
            '{"type": "GeometryCollection", "geometries": [' * 900
            + '{"type": "Point", "coordinates": [0, 0]}'
            + "]}" * 900,
            "is no field|has no polygon|is damaged",
        ),
        (kml(FIELD).replace("outerBoundaryIs", "outside"), "a polygon with 0 outlines"),
        (kml(FIELD).replace(",0 ", ",x "), ""),
        ("PK\x03\x04", "is a damaged archive"),
        ("\x00\x00\x27\x0a", "has no .prj beside it"),
    ],
)
def test_what_is_no_field_gets_one_line_soon(tmp_path: Path, text: str, words: str):
    path = saved(tmp_path, text, "odd.kml")
    began = time.process_time()
    if not words:  # what stands after the two numbers of a corner is its height, which is not used
        assert area_of(path) > 0.0
        return
    with pytest.raises(PlanError, match=words) as caught:
        read_field(path)
    assert time.process_time() - began < 2.0
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("odd.kml")


@pytest.mark.parametrize("method", [zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
@pytest.mark.parametrize("put", [b"\xff" * 30, bytes(30), b"\x05\x9c\x01" * 10])
def test_a_damaged_archive_is_refused_in_one_line(tmp_path: Path, method: int, put: bytes):
    path = tmp_path / "farm.kmz"
    with zipfile.ZipFile(path, "w", method) as archive:
        archive.writestr("doc.kml", kml(FIELD))
    whole = path.read_bytes()
    for at in range(26, len(whole), 7):
        path.write_bytes(whole[:at] + put + whole[at + len(put) :])
        with suppress(PlanError):  # what a damaged place does not touch is read
            read_field(path)


def test_a_coordinate_system_that_cannot_be_turned_into_degrees_is_refused(tmp_path: Path):
    local = 'LOCAL_CS["site",UNIT["metre",1]]\n'
    content = {"type": "name", "properties": {"name": local}}
    corners = [[8.0, 47.0], [8.002, 47.0], [8.002, 47.001], [8.0, 47.0]]
    text = json.dumps({"type": "Polygon", "coordinates": [corners], "crs": content})
    with pytest.raises(PlanError, match="coordinate system that is not known") as caught:
        read_field(saved(tmp_path, text, "farm.geojson"))
    assert "\n" not in str(caught.value)


def test_an_archive_that_unpacks_to_too_much_is_refused(tmp_path: Path):
    with zipfile.ZipFile(tmp_path / "farm.kmz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("doc.kml", b"0" * 40_000_000)
    with pytest.raises(PlanError, match="unpacks to more than 16 MiB"):
        read_field(tmp_path / "farm.kmz")
