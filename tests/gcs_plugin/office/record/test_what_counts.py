"""What a record counts of a job: each flight once, no part for the whole, in its own place."""

import errno
import io
import json
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pypdf
import pytest
import shapely.geometry

from tests.gcs_plugin.reports.margin.report_flight import LOG, log, model
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.mavlink.frame import frame_of
from thrustmargin.gcs_plugin.mavlink.scan import stamped_frames
from thrustmargin.gcs_plugin.office.record.applied import (
    applied_swaths,
    better_logs,
    cut_at_date_line,
)
from thrustmargin.gcs_plugin.office.record.job_record import (
    field_entries,
    log_entries,
    product_entries,
)
from thrustmargin.gcs_plugin.office.record.record import counted_once
from thrustmargin.gcs_plugin.office.record.record_files import geojson
from thrustmargin.gcs_plugin.reports.paper.pdf_page import pdf_bytes
from thrustmargin.gcs_plugin.reports.shared.page_shell import csv_text
from thrustmargin.gcs_plugin.telemetry.recording import FlightLog
from thrustmargin.mission.field_file import read_field
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import FlightTrack, Origin
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.whole_file import whole_file


def with_track(**changes: object) -> FlightLog:
    """The flight with channels of its track replaced."""
    return replace(log(), track=replace(log().track, **changes))  # type: ignore[arg-type]


def middle(seconds: float) -> np.ndarray:
    """Rows of so many seconds in the middle of what is sprayed."""
    track = log().track
    on = track.time_s[(track.spraying > 0.5) & track.flying]
    return np.abs(track.time_s - np.median(on)) < seconds / 2


def without_place(seconds: float) -> FlightLog:
    lost = np.where(middle(seconds)[:, None], np.nan, log().track.position_ned)
    return with_track(position_ned=lost)


def test_a_flight_that_two_recorded_counts_once(tmp_path, capsys):
    twice = tmp_path / "logs"
    twice.mkdir()
    (twice / "ground.tlog").write_bytes(LOG.read_bytes())
    board = LOG.parents[1] / "formats" / "v4_m10_q2.5.BIN"
    (twice / "board.BIN").write_bytes(board.read_bytes())
    assert run(["record", str(twice), "--out", str(tmp_path / "out"), "--rule", "us"]) == 0
    made = json.loads((tmp_path / "out" / "record.json").read_text("utf-8"))
    # The tank lost 6.2 kg in this flight.
    assert made["fields"]["quantity_kg"]["value"] == pytest.approx(6.15, abs=0.05)
    (left,) = made["left_out"]
    assert {left["name"], *made["logs"]} == {"ground.tlog", "board.BIN"}
    assert "the same flight" in capsys.readouterr().out


def test_flights_are_the_same_at_one_time_at_one_place():
    start = log().track.start_unix_s
    assert start is not None
    north = log().track.position_ned + np.array([20.0, 0.0, 0.0])
    assert better_logs([log(), with_track(position_ned=north)]) == [None, None]
    assert better_logs([log(), with_track(start_unix_s=start + 3600.0)]) == [None, None]
    assert better_logs([log(), with_track(start_unix_s=start + 40.0)]) == [None, None]
    assert better_logs([log(), with_track(start_unix_s=start + 4.0)]) == [None, 0]
    # Simulators fly one route at once: what else is read distinguishes them.
    fuller = with_track(tank_kg=log().track.tank_kg + 0.5)
    faster = with_track(rotor_speed_rpm=log().track.rotor_speed_rpm * [1.0, 1.02, 1.0, 1.0])
    assert better_logs([log(), fuller, faster]) == [None, None, None]
    # The one that knows more stands, whichever comes first.
    assert better_logs([without_place(30.0), log(), log()]) == [1, None, 1]
    undated = with_track(start_unix_s=None)
    assert better_logs([undated, undated, log()]) == [None, 0, 0]


@pytest.mark.parametrize("seconds", [0.5, 30.0])
def test_an_area_of_which_a_part_is_lost_is_not_the_area(seconds):
    one = without_place(seconds)
    done, whole = applied_swaths([one], 5.0), applied_swaths([log()], 5.0)
    assert done is not None
    assert whole is not None
    fields = log_entries([one], done, None)
    if seconds < 1.0:  # below a hundredth of the 156 s with the pump on
        assert "area_at_least" not in fields
        assert fields["area"].value == pytest.approx(whole.area / 1e4, rel=0.01)
        return
    assert "area" not in fields
    assert 0.6 * whole.area < 1e4 * fields["area_at_least"].value < 0.9 * whole.area
    assert done.field.lost_s == pytest.approx(seconds, abs=12.0)  # the pump is off in turns


def test_a_pause_and_a_sortie_whose_pump_is_not_known_make_it_a_part():
    track = log().track
    half = np.flatnonzero(middle(1.0))[0]
    later = track.time_s + np.where(np.arange(track.time_s.size) > half, 60.0, 0.0)
    silent = with_track(spraying=np.full(track.time_s.size, np.nan))
    for logs in ([with_track(time_s=later)], [log(), silent]):
        done = applied_swaths(logs, 5.0)
        assert done is not None
        assert not done.field.whole
    both = applied_swaths([log(), with_track(spraying=np.zeros(track.time_s.size))], 5.0)
    assert both is not None
    assert both.field.whole


def test_times_are_known_where_the_place_is_not():
    nowhere = with_track(position_ned=np.full_like(log().track.position_ned, np.nan))
    done, known = applied_swaths([nowhere], 5.0), applied_swaths([log()], 5.0)
    assert done is not None
    assert known is not None
    assert (done.start_unix_s, done.end_unix_s) == (known.start_unix_s, known.end_unix_s)
    assert "area" not in log_entries([nowhere], done, None)


def test_a_job_over_the_date_line_stays_in_one_place():
    zero = log().track.origin
    assert zero is not None
    # East of 180° by the eastern part of its swaths alone.
    done = applied_swaths([with_track(origin=replace(zero, longitude_deg=180.0))], 5.0)
    assert done is not None
    latitude, longitude = map(float, log_entries([log()], done, None)["location"].value.split(", "))
    assert abs(abs(longitude) - 180.0) < 0.002
    assert latitude == pytest.approx(zero.latitude_deg, abs=0.002)
    for feature in geojson(done)["features"]:
        for part in shapely.get_parts(shapely.geometry.shape(feature["geometry"])):
            west, _, east, _ = part.bounds
            assert east - west < 0.002
            assert max(abs(west), abs(east)) <= 180.0


def test_what_is_cut_at_the_date_line_keeps_its_area():
    square = shapely.box(179.9, 10.0, 180.3, 10.1)
    parts = shapely.get_parts(cut_at_date_line(square))
    assert sorted(part.bounds[0] for part in parts) == pytest.approx([-180.0, 179.9])
    assert sum(part.area for part in parts) == pytest.approx(square.area)
    assert cut_at_date_line(shapely.box(-180.0, 0.0, -179.0, 1.0)).bounds[2] == -179.0


def test_a_field_in_which_nothing_was_sprayed_is_another(tmp_path):
    ring = [[10.0, 50.0], [10.01, 50.0], [10.01, 50.01], [10.0, 50.0]]
    (tmp_path / "far.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    with pytest.raises(DataError, match="nothing in it was sprayed"):
        field_entries(read_field(tmp_path / "far.geojson"), applied_swaths([log()], 5.0))


def test_a_dose_is_read_in_one_way_or_not_at_all():
    # 2 ha are 4.942 acres.
    assert product_entries("8 fl oz/ac", 2.0)["product_quantity"].value == pytest.approx(
        39.54, abs=0.01
    )
    assert product_entries("0,250 kg/ha", 2.0)["product_quantity"].value == 0.5
    for rate in ("1,500 ml/ha", "0 L/ha", "\uff11.5 L/ha", "9" * 400 + " L/ha", "1.5 L/ac/ha"):
        with pytest.raises(DataError, match="--rate"):
            product_entries(rate, 2.0)


def test_a_field_that_no_page_could_hold_is_refused(tmp_path, capsys):
    words = ["record", str(LOG), "--rule", "us", "--out", str(tmp_path / "job"), "--product"]
    assert run([*words, "x" * 1001]) == 2
    assert "--product has 1001 letters" in capsys.readouterr().err
    assert run([*words, "x" * 1000]) == 0


def test_a_job_of_two_days_has_both_dates():
    day = 86_400.0
    start = log().track.start_unix_s
    assert start is not None
    logs = [log(), with_track(start_unix_s=start + 2 * day)]
    found = log_entries(logs, applied_swaths(logs, 5.0), UTC)
    assert found["date"].value == "2026-11-21 to 2026-11-23"


@pytest.mark.parametrize(("year", "known"), [(1970, False), (2026, True), (2101, False)])
def test_a_clock_that_nobody_set_gives_no_date(year, known, tmp_path):
    """Stamps of a ground station whose clock was reset, of a log without the time by GPS."""
    shift_us = round((datetime(year, 3, 1, tzinfo=UTC).timestamp() - 1_795_228_092.0) * 1e6)
    frames = [
        (stamp_us + shift_us).to_bytes(8, "big") + data
        for stamp_us, data in stamped_frames(LOG)
        if (frame := frame_of(data)) is not None and frame.id != 2  # SYSTEM_TIME
    ]
    (tmp_path / "x.tlog").write_bytes(b"".join(frames))
    words = ["record", str(tmp_path / "x.tlog"), "--out", str(tmp_path / "out"), "--rule", "us"]
    assert run(words) == 0
    fields = json.loads((tmp_path / "out" / "record.json").read_text("utf-8"))["fields"]
    assert ("date" in fields, "start" in fields) == (known, known)


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_dose_typed_without_a_unit_is_asked_for_again(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.stdin", Terminal("Oil\n1\n1.5\n2 L/ha\n"))
    words = ["record", str(LOG), "--rule", "eu", "--out", str(tmp_path), "--zone", "UTC"]
    assert run(words) == 0
    fields = json.loads((tmp_path / "record.json").read_text("utf-8"))["fields"]
    assert fields["rate"]["value"] == "2 L/ha"
    made = 2.0 * fields["area"]["value"]
    assert fields["product_quantity"]["value"] == pytest.approx(made)


def test_without_a_rule_no_country_is_missing_anything(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sys.stdin", Terminal(""))  # whoever asks finds no answer
    assert run(["record", str(LOG), "--out", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "No rule was named with --rule, so none was checked." in out
    assert "missing:" not in out
    assert json.loads((tmp_path / "record.json").read_text("utf-8"))["rules"] == []
    assert "missing" not in (tmp_path / "record.csv").read_text("utf-8")


def test_maps_of_an_earlier_record_do_not_stay_beside_a_new_one(tmp_path, monkeypatch):
    words = ["record", str(LOG), "--out", str(tmp_path), "--rule", "us"]
    assert run(words) == 0
    assert (tmp_path / "applied.shp").exists()
    (tmp_path / "mine.txt").write_text("stays")
    name = "thrustmargin.gcs_plugin.office.record.record_files.makes_shapefiles"
    monkeypatch.setattr(name, lambda: False)
    assert run(words) == 0
    left = {path.name for path in tmp_path.iterdir()}
    assert {"mine.txt", "applied.geojson", "record.pdf"} <= left
    assert not [path for path in left if path.startswith("applied.") and "geojson" not in path]


def test_a_full_disk_leaves_the_earlier_record_whole_and_names_the_file(
    tmp_path, monkeypatch, capsys
):
    words = ["record", str(LOG), "--out", str(tmp_path), "--rule", "us"]
    assert run([*words, "--pilot", "first"]) == 0
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    write = Path.write_bytes

    def full(path: Path, data: bytes) -> int:
        if "record.pdf" in path.name:
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(path, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    assert run([*words, "--pilot", "second"]) == 1
    assert "record.pdf: No space left on device" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_an_error_without_a_name_is_given_that_of_the_file(tmp_path):
    with pytest.raises(OSError, match="No space") as raised, whole_file(tmp_path / "a.txt"):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert raised.value.filename == str(tmp_path / "a.txt")


def test_other_vehicles_of_a_log_are_left_out_by_name():
    two = replace(log(), vehicle=2, vehicles=(1, 2, 7))
    kept, left = counted_once([(analyse(two.track, model()), two)])
    assert len(kept) == 1
    assert [one.name for one in left] == [LOG.name]
    assert "vehicle 1, 7 of the log: vehicle 2 is read" in left[0].reason


def test_flights_of_a_table_that_are_not_read_are_named(tmp_path):
    table, out = tmp_path / "two.csv", tmp_path / "out"
    assert run(["report", str(LOG), str(LOG), "--out", str(tmp_path / "two.html")]) == 0
    assert run(["record", str(table), "--out", str(out), "--rule", "us"]) == 0
    (left,) = json.loads((out / "record.json").read_text("utf-8"))["left_out"]
    assert left["name"] == "two.csv"
    assert left["reason"].startswith("2 flights in the file: the first is read")


def test_logs_that_cannot_be_read_are_named(tmp_path):
    (tmp_path / "broken.tlog").write_bytes(b"no log")
    out = tmp_path / "out"
    assert run(["record", str(LOG), str(tmp_path / "broken.tlog"), "--out", str(out)]) == 1
    made = json.loads((out / "record.json").read_text("utf-8"))
    assert [one["name"] for one in made["left_out"]] == ["broken.tlog"]
    assert "broken.tlog" in (out / "record.csv").read_text("utf-8")
    pages = pypdf.PdfReader(out / "record.pdf").pages
    assert "broken.tlog" in "".join(page.extract_text() for page in pages)


def test_letters_that_cannot_be_printed_are_seen_to_lack():
    page = "<html><body><p>\u9c7c M\u00fcller</p></body></html>"
    text = pypdf.PdfReader(io.BytesIO(pdf_bytes(page, {}))).pages[0].extract_text()
    assert "\u25a1 M\u00fcller" in text
    assert "U+9C7C" in text


@pytest.mark.parametrize("begin", ["=", "+", "-", "@", "\t=", "\r=", "\uff1d"])
def test_no_cell_begins_as_a_formula(begin):
    assert csv_text(("a",), [(f"{begin}1",)]).splitlines()[1].lstrip('"')[0] == "'"


def test_a_pass_is_the_line_sprayed_as_wide_as_the_swath_and_its_wind_that_of_then():
    """North at 5 m/s; the pump is on from 2 to 12 s, in 3 m/s from the south, and else in 9."""
    time_s = np.arange(0.0, 30.0)
    on = (time_s >= 2.0) & (time_s <= 12.0)
    track = FlightTrack.of(
        name="made",
        time_s=time_s,
        rotor_count=4,
        position_ned=np.column_stack([5.0 * time_s, 0.0 * time_s, -3.0 + 0.0 * time_s]),
        velocity_ned=np.tile([5.0, 0.0, 0.0], (30, 1)),
        wind_ned=np.column_stack([np.where(on, 3.0, 9.0), 0.0 * time_s, 0.0 * time_s]),
        spraying=on.astype(float),
        flying=np.full(30, True),
        origin=Origin(latitude_deg=0.0, longitude_deg=11.0, altitude=0.0),
        start_unix_s=1_770_000_000.0,
    )
    one = replace(log(), track=track)
    done = applied_swaths([one], 4.0)
    assert done is not None
    (made,) = done.passes
    assert (made.length, made.speed) == pytest.approx((50.0, 5.0))
    assert made.start_unix_s == 1_770_000_002.0
    assert made.end_unix_s == 1_770_000_012.0
    # At the equator a degree is 110.57 km to the north and 111.32 km to the east (WGS 84).
    assert made.strip is not None
    assert made.strip.area * 110_570.0 * 111_320.0 == pytest.approx(200.0, rel=1e-3)
    assert log_entries([one], done, None)["wind"].value == "3.0 from 180°, at most 3.0"
