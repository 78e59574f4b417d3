"""Fields that are made to break a reader, for `python -m tests.lab.plans.hostile`."""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Iterator
from typing import Any

from tests.lab.plans.hostile_plans import star


def kml(coordinates: str, before: str = "", inner: str = "") -> str:
    return (
        f'<?xml version="1.0"?>{before}<kml xmlns="http://www.opengis.net/kml/2.2"><Document>'
        f"<Placemark><name>n</name><Polygon><outerBoundaryIs><LinearRing><coordinates>{coordinates}"
        f"</coordinates></LinearRing></outerBoundaryIs>{inner}</Polygon></Placemark></Document></kml>"
    )


def words(corners: list[list[float]]) -> str:
    return " ".join(f"{a!r},{b!r},0" for a, b in corners)


SQUARE = [[11.0, 48.0], [11.002, 48.0], [11.002, 48.002], [11.0, 48.002], [11.0, 48.0]]
BOMB = (
    '<!DOCTYPE kml [<!ENTITY a "aaaaaaaaaa">'
    + "".join(
        f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in zip("abcdefgh", "bcdefghi", strict=True)
    )
    + "]>"
)


def geojson(rings: list[Any], **more: Any) -> str:
    return json.dumps({"type": "Polygon", "coordinates": rings} | more)


def zipped(name: str, content: str | bytes) -> bytes:
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, content)
    return made.getvalue()


def isoxml(points: list[list[float]], polygon: str = "1", ring: str = "1") -> str:
    made = "".join(f'<PNT A="2" C="{b}" D="{a}"/>' for a, b in points)
    return (
        '<ISO11783_TaskData VersionMajor="4" VersionMinor="0"><PFD A="PFD1" C="f" D="1">'
        f'<PLN A="{polygon}"><LSG A="{ring}">{made}</LSG></PLN></PFD></ISO11783_TaskData>'
    )


def fields() -> Iterator[tuple[str, str | bytes]]:
    """Name and content of each field; of a shapefile the .shp, with a .prj beside."""
    yield "good.kml", kml(words(SQUARE))
    yield "bomb.kml", kml("&i;", BOMB)
    yield "external.kml", kml("&x;", '<!DOCTYPE kml [<!ENTITY x SYSTEM "file:///etc/passwd">]>')
    yield "nan.kml", kml("nan,nan nan,1 2,nan 3,3")
    yield "inf.kml", kml("inf,1 2,2 3,3 inf,1")
    yield "crossing.kml", kml("11,48 11.01,48.01 11.01,48 11,48.01 11,48")
    yield "pole.kml", kml("0,90 90,89.999 180,89.999 -90,89.999 0,90")
    yield "date-line.kml", kml("179.999,1 -179.999,1 -179.999,1.002 179.999,1.002 179.999,1")
    yield "world.kml", kml("-180,-90 180,-90 180,90 -180,90 -180,-90")
    yield "beyond.kml", kml("1e300,1e300 1e301,1 1,1 1e300,1e300")
    yield "corners-1e5.kml", kml(words(star(100_000)))
    yield "corners-1e6.kml", kml(words(star(600_000)))
    yield "corners-9999.kml", kml(words(star(9_998)))
    yield "line.kml", kml("11,48 11.001,48")
    yield "point.kml", kml("11,48 11,48 11,48 11,48")
    yield "words.kml", kml("a,b c,d e,f")
    yield "empty.kml", ""
    yield "deep.kml", "<a>" * 200_000
    yield (
        "deep-closed.kml",
        '<kml xmlns="x">' + "<Folder>" * 100_000 + "</Folder>" * 100_000 + "</kml>",
    )
    yield "placemarks.kml", "<kml>" + "<Placemark/>" * 1_000_000 + "</kml>"
    yield (
        "nested-placemarks.kml",
        "<kml>" + "<Placemark>" * 50_000 + "</Placemark>" * 50_000 + "</kml>",
    )
    yield "attributes.kml", "<kml " + " ".join(f'a{k}="1"' for k in range(500_000)) + "/>"
    yield "encoding.kml", b'<?xml version="1.0" encoding="utf-7"?><kml/>'
    yield (
        "utf16.kml",
        kml(words(SQUARE)).replace('"1.0"', '"1.0" encoding="utf-16"').encode("utf-16"),
    )
    hole = (
        "<innerBoundaryIs><LinearRing><coordinates>{}</coordinates></LinearRing></innerBoundaryIs>"
    )
    small = words(
        [[11 + 1e-4 + a / 40 * 0, b] for a, b in [[0, 48.0005], [0, 48.0006], [0, 48.0007]]]
    )
    yield "flat-holes.kml", kml(words(SQUARE), inner=hole.format(small) * 5_000)
    yield (
        "holes.kml",
        kml(
            words(SQUARE),
            inner="".join(
                hole.format(
                    words(
                        [
                            [11 + 4e-5 * i + d, 48 + 4e-5 * j + e]
                            for d, e in ((1e-5, 1e-5), (2e-5, 1e-5), (1e-5, 2e-5), (1e-5, 1e-5))
                        ]
                    )
                )
                for i in range(45)
                for j in range(45)
            ),
        ),
    )
    yield "bomb.kmz", zipped("doc.kml", b"<kml>" + b" " * 1_000_000_000 + b"</kml>")
    yield "bomb-31.kmz", zipped("doc.kml", b"<kml>" + b"<a/>" * 7_500_000 + b"</kml>")
    yield "none.kmz", zipped("x.txt", "x")
    yield "broken.kmz", zipped("doc.kml", kml(words(SQUARE)))[:200]
    yield "nested.kmz", zipped("doc.kml", zipped("doc.kml", kml(words(SQUARE))))
    yield "good.geojson", geojson([SQUARE])
    yield "nan.geojson", geojson([[[math.nan, 48], [1, 2], [2, 1], [math.nan, 48]]])
    yield (
        "crossing.geojson",
        geojson([[[11, 48], [11.01, 48.01], [11.01, 48], [11, 48.01], [11, 48]]]),
    )
    yield "digits.geojson", geojson([SQUARE]).replace("11.002", "9" * 200_000)
    yield "deep.geojson", "[" * 200_000
    nested: Any = {"type": "Polygon", "coordinates": [SQUARE]}
    for _ in range(300):
        nested = {"type": "GeometryCollection", "geometries": [nested]}
    yield "nested.geojson", json.dumps(nested)
    yield "corners-1e5.geojson", geojson([star(100_000)])
    yield "corners-1e6.geojson", geojson([star(500_000)])
    yield (
        "features.geojson",
        json.dumps(
            {
                "type": "FeatureCollection",
                "features": [{"type": "Feature", "geometry": None}] * 400_000,
            }
        ),
    )
    feature = {"type": "Feature", "geometry": {"type": "Polygon", "coordinates": [SQUARE]}}
    yield (
        "features-alike.geojson",
        json.dumps({"type": "FeatureCollection", "features": [feature] * 100_000}),
    )
    yield "crs.geojson", geojson([SQUARE], crs={"properties": {"name": "x" * 1_000_000}})
    yield "crs-list.geojson", geojson([SQUARE], crs=[])
    yield "crs-number.geojson", geojson([SQUARE], crs={"properties": 5})
    yield "empty-rings.geojson", geojson([])
    yield "null-corners.geojson", geojson([[None, None, None]])
    yield "string-corners.geojson", geojson([["a", "b", "c", "a"]])
    yield "flat.geojson", geojson([[1, 2, 3]])
    yield "holes.geojson", geojson([SQUARE, *[SQUARE] * 3_000])
    yield "bool.geojson", "true"
    yield "list.geojson", "[1,2,3]"
    yield "good.xml", isoxml(SQUARE)
    yield "odd.xml", isoxml(SQUARE, polygon="9", ring="9")
    yield "nan.xml", isoxml([[math.nan, math.nan]] * 4)
    yield "missing.xml", isoxml(SQUARE).replace(' C="48.0"', "")
    yield "corners-1e5.xml", isoxml(star(100_000))
    yield (
        "many-holes.xml",
        isoxml(SQUARE)
        .replace(
            "</PFD>",
            '<PLN A="6"><LSG A="1">'
            + "".join(f'<PNT A="2" C="{b}" D="{a}"/>' for a, b in star(2000, 1e-4))
            + "</LSG></PLN></PFD>",
        )
        .replace(
            "</PFD>",
            (
                '<PLN A="1"><LSG A="1">'
                + "".join(f'<PNT A="2" C="{b}" D="{a}"/>' for a, b in SQUARE)
                + "</LSG></PLN>"
            )
            * 400
            + "</PFD>",
        ),
    )
    yield "fields.xml", "<ISO11783_TaskData>" + "<PFD/>" * 1_000_000 + "</ISO11783_TaskData>"
    yield "bomb.xml", BOMB + "<ISO11783_TaskData>&i;</ISO11783_TaskData>"
    yield "other.xml", "<gpx/>"
    shp = shapefile_of([SQUARE])
    yield "good.shp", shp
    yield "cut.shp", shp[:-20]
    yield "header.shp", shp[:100]
    yield "short.shp", shp[:40]
    yield "count.shp", shp[:144] + (10**9).to_bytes(4, "little") + shp[148:]
    yield "parts.shp", shp[: 148 - 8] + (10**9).to_bytes(4, "little") + shp[144:]
    yield "long.shp", shp + bytes(20_000_000)
    yield "records.shp", shp[:100] + shp[100:] * 100_000
    yield "large.shp", shp + bytes(200_000_000)
    yield "large.kml", kml(" " * 200_000_000)
    yield "large.geojson", " " * 200_000_000
    yield "spaces.kml", kml(" " * 30_000_000)
    yield "commas.kml", kml("," * 30_000_000)
    yield "commas.geojson", "[" + "0," * 15_000_000 + "0]"
    yield "objects.geojson", "[" + "{}," * 10_000_000 + "0]"
    yield "lists.geojson", geojson([]).replace("[]", "[" + "[]," * 10_000_000 + "[]]")
    yield "elements.kml", "<kml>" + "<a/>" * 8_000_000 + "</kml>"


def shapefile_of(rings: list[list[list[float]]]) -> bytes:
    import shapefile

    shp, shx, dbf = io.BytesIO(), io.BytesIO(), io.BytesIO()
    made: Any = shapefile.Writer
    with made(shp=shp, shx=shx, dbf=dbf, shapeType=shapefile.POLYGON) as writer:
        writer.field("n")
        writer.poly([ring[::-1] for ring in rings])
        writer.record("a")
    return shp.getvalue()
