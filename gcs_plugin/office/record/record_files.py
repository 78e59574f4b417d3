"""Write the record as JSON, CSV and PDF, and the treated area as GeoJSON and shapefile."""

from __future__ import annotations

import io
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import shapely
import shapely.geometry
from markupsafe import escape

from thrustmargin.gcs_plugin.office.record.applied import Applied, Pass, cut_at_date_line
from thrustmargin.gcs_plugin.office.record.job_record import JobRecord
from thrustmargin.gcs_plugin.office.record.record_words import (
    LEFT_OUT,
    NO_RULE,
    TITLES,
    liquid_words,
    missing_words,
)
from thrustmargin.gcs_plugin.reports.paper.pdf_page import pdf_bytes
from thrustmargin.gcs_plugin.reports.shared import page_shell
from thrustmargin.models.whole_file import whole_file

#: WGS 84 as the .prj file that GIS programs expect with a shapefile.
WGS84 = (
    'GEOGCS["GCS_WGS_1984",DATUM["D_WGS_1984",SPHEROID["WGS_1984",6378137.0,298.257223563]],'
    'PRIMEM["Greenwich",0.0],UNIT["Degree",0.0174532925199433]]'
)


#: All files that a record can have; files of an earlier record are deleted.
NAMES = (
    *(f"record.{ending}" for ending in ("json", "csv", "pdf")),
    *(f"applied.{ending}" for ending in ("geojson", "shp", "shx", "dbf", "prj")),
)


def write_record(record: JobRecord, done: Applied | None, folder: Path) -> list[Path]:
    """Write the files of a record into `folder` and return their paths.

    They are record.json, .csv and .pdf; if the treated ground is known also applied.geojson, and if
    pyshp is installed applied.shp, .shx, .dbf and .prj. All are complete before older ones are
    replaced; older files that this record lacks are deleted. Raises OSError if one cannot be
    written.
    """
    contents = {
        "record.json": page_shell.json_text(record.as_json()).encode("utf-8", "replace"),
        "record.csv": csv_text(record).encode("utf-8", "replace"),
        "record.pdf": pdf_bytes(html_text(record), {}),
    }
    if done is not None and done.ground is not None:
        contents["applied.geojson"] = page_shell.json_text(geojson(done)).encode()
        contents |= shapefile(done) if makes_shapefiles() else {}
    with ExitStack() as files:
        for name, data in contents.items():
            draft = files.enter_context(whole_file(folder / name))
            draft.touch(
                0o600
            )  # it names people and places: other users of the computer do not read it
            draft.write_bytes(data)
    for name in set(NAMES) - contents.keys():
        (folder / name).unlink(missing_ok=True)
    return [folder / name for name in contents]


def csv_text(record: JobRecord) -> str:
    """Return the record as CSV: field, value, unit, source and detail.

    Unused logs and missing fields follow the fields. Texts are written so that no spreadsheet runs
    one as a formula.
    """
    known = [
        (name, entry.value, entry.unit, str(entry.source), entry.detail)
        for name, entry in record.fields.items()
    ]
    missing = [
        (name, "", "", "missing", f"{rule['rule']}: {item['asks']}")
        for rule in record.as_json()["rules"]
        for item in rule["missing"]
        for name in item["fields"]
    ]
    left_out = [("log", one.name, "", "left out", one.reason) for one in record.left_out]
    return page_shell.csv_text(
        ("field", "value", "unit", "source", "detail"), known + left_out + missing
    )


def html_text(record: JobRecord) -> str:
    """Return the record as an HTML page, from which the PDF is made.

    It lists unused logs, fields with sources, the liquid, and what rules require and the record
    lacks.
    """
    rows = "".join(
        f"<tr><td>{escape(TITLES.get(name, name))}</td><td>{escape(_value_text(entry.value))} "
        f"{escape(entry.unit)}</td><td>{escape(entry.source)}: {escape(entry.detail)}</td></tr>"
        for name, entry in record.fields.items()
    )
    data = record.as_json()
    amounts = liquid_words(data["liquid"]["estimates"], data["liquid"]["differences"])
    liquid = "".join(f"<li>{escape(words)}</li>" for words in amounts)
    missing = "".join(f"<li>{escape(words)}</li>" for words in missing_words(data["rules"]))
    open_items = f"<h2>What rules ask for and nothing says</h2><ul>{missing}</ul>"
    left_out = "".join(f"<li>{escape(f'{one.name}: {one.reason}')}</li>" for one in record.left_out)
    left_out = left_out and f"<h2>{LEFT_OUT}</h2><ul>{left_out}</ul>"
    return (
        "<h1>Record of a spraying job</h1>"
        f"<p>made {escape(record.made_utc)}, of {escape(', '.join(record.logs))}</p>"
        f"{left_out}<h2>Fields</h2><table><tr><th>field</th><th>value</th><th>from</th></tr>"
        f"{rows}</table><h2>Liquid</h2><ul>{liquid}</ul>"
        f"{open_items if data['rules'] else f'<p>{NO_RULE}</p>'}"
    )


def _value_text(value: Any) -> str:
    """Return a value for people, numbers with four significant digits."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _pass_properties(number: int, one: Pass) -> dict[str, Any]:
    """Return the properties of a pass for GeoJSON and shapefile.

    Keys: `pass` (its number, from 1), `flight`, `start_utc` and `end_utc` (texts), `length_m` and
    `speed_m_s`. The speed is None if unknown.
    """
    return {
        "pass": number,
        "flight": one.flight,
        "start_utc": page_shell.unix_text(one.start_unix_s),
        "end_utc": page_shell.unix_text(one.end_unix_s),
        "length_m": round(one.length, 2),
        "speed_m_s": round(one.speed, 2) if one.speed == one.speed else None,
    }


def geojson(done: Applied) -> dict[str, Any]:
    """Return the treated area and the strip of each pass as a GeoJSON FeatureCollection (RFC 7946).

    Properties: `part` is "area" or "pass"; an area has `area_ha`, `whole` (complete) and `swath_m`,
    a pass those of `_pass_properties`. Coordinates are WGS 84. Shapes that are unknown or empty are
    left out.
    """
    area = {
        "part": "area",
        "area_ha": done.area / 1e4,
        "whole": done.field.whole,
        "swath_m": done.field.swath_width,
    }
    shapes = [
        ({"part": "pass", **_pass_properties(n, p)}, p.strip) for n, p in enumerate(done.passes, 1)
    ]
    return {
        "type": "FeatureCollection",
        "features": [
            {
                "type": "Feature",
                "properties": properties,
                # RFC 7946 requires outer rings to run counterclockwise.
                "geometry": shapely.geometry.mapping(
                    shapely.orient_polygons(cut_at_date_line(shape))
                ),
            }
            for properties, shape in [(area, done.ground), *shapes]
            if shape is not None and not shape.is_empty
        ],
    }


def makes_shapefiles() -> bool:
    """Return True if pyshp is installed; it is part of the extra `field`."""
    return find_spec("shapefile") is not None


def shapefile(done: Applied) -> dict[str, bytes]:
    """Return the four files of a shapefile, name -> content, with a polygon for each pass.

    A pass without a strip is left out. Needs the library pyshp.
    """
    import shapefile as pyshp

    parts = {ending: io.BytesIO() for ending in ("shp", "shx", "dbf")}
    make: Any = pyshp.Writer
    writer = make(**parts, shapeType=pyshp.POLYGON)
    for name, kind, *size in (
        ("pass", "N", 9, 0),
        ("flight", "N", 9, 0),
        ("start_utc", "C", 20),
        ("end_utc", "C", 20),
        ("length_m", "N", 14, 2),
        ("speed_m_s", "N", 10, 2),
    ):
        writer.field(name, kind, *size)
    for number, one in enumerate(done.passes, 1):
        if one.strip is not None and not one.strip.is_empty:
            writer.shape(shapely.geometry.mapping(cut_at_date_line(one.strip)))
            writer.record(*_pass_properties(number, one).values())
    writer.close()
    contents = {f"applied.{ending}": part.getvalue() for ending, part in parts.items()}
    return {**contents, "applied.prj": WGS84.encode()}
