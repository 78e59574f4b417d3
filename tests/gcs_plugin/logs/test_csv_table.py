"""A flight as CSV: it reads back to the last digit, and a wrong table says what is wrong."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from tests.flight_channels import assert_same_channels, reported_channels
from tests.gcs_plugin.logs.csv_files import write_csv
from tests.made_sources import sent
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.commands.shared.log_flights import log_lines
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.logs.csv_table import COLUMNS, read_csv
from thrustmargin.gcs_plugin.logs.inspection import inspect_log
from thrustmargin.gcs_plugin.wording.check_words import source_words, statement_words
from thrustmargin.models.errors import AirframeError, LogError
from thrustmargin.models.flight import TRACK_CHANNELS, FlightTrack, Origin
from thrustmargin.models.physics.airframe import airframe_names, load_airframe

NUMBERS = st.floats(allow_nan=True, allow_infinity=False, width=64)


def same_numbers(a: FlightTrack, b: FlightTrack) -> None:
    np.testing.assert_array_equal(a.time_s, b.time_s)
    np.testing.assert_array_equal(a.flying, b.flying)
    assert_same_channels(a, b)


def same(a: FlightTrack, b: FlightTrack) -> None:
    same_numbers(a, b)
    assert (a.name, a.origin, a.start_unix_s) == (b.name, b.origin, b.start_unix_s)
    assert dict(a.sources).items() <= dict(b.sources).items()


def test_a_recorded_flight_reads_back_to_the_last_digit(sitl_logs, tmp_path):
    track = read_log(sitl_logs / "campaign/v4_m10_q2.5.tlog").track
    write_csv(track, tmp_path / "flight.csv")
    again = read_csv(tmp_path / "flight.csv", 0)[0]
    same(track, again)
    assert source_words(again.sources["tank_kg"]) == "NAMED_VALUE_FLOAT TANK"


@settings(max_examples=50, deadline=None)
@given(data=st.data(), rotors=st.integers(3, 8), rows=st.integers(1, 5))
def test_any_track_reads_back_to_the_last_digit(tmp_path_factory, data, rotors, rows):
    given_channels = {}
    for channel, column in TRACK_CHANNELS.items():
        shape = column.shape(rows, rotors)
        given_channels[channel] = data.draw(arrays.arrays(np.float64, shape, elements=NUMBERS))
    # At least one number a rotor channel: a column that is empty throughout is not written.
    given_channels["rotor_speed_rpm"][0, 0] = 1.0
    steps = data.draw(arrays.arrays(np.float64, rows, elements=st.floats(1e-3, 1e3)))
    track = FlightTrack.of(
        name=data.draw(st.text(st.characters(exclude_categories=("C", "Z")), max_size=8)),
        time_s=np.cumsum(steps),
        rotor_count=rotors,
        flying=data.draw(arrays.arrays(np.bool_, rows)),
        origin=Origin(latitude_deg=36.65, longitude_deg=116.9, altitude=5.0),
        start_unix_s=data.draw(st.none() | st.floats(1e9, 4e9)),
        sources={"tank_kg": sent('a, "quoted" source, µ')},
        **given_channels,
    )
    path = tmp_path_factory.getbasetemp() / "any.csv"
    write_csv(track, path)
    same(track, read_csv(path, 0)[0])


def test_the_documented_names_are_the_ones_that_are_read(tmp_path):
    names = [name for columns in COLUMNS.values() for name in columns]
    rotors = [name for name, channel in TRACK_CHANNELS.items() if channel.per_rotor]
    names += [f"{name}_{k}" for name in rotors for k in range(1, 5)]
    header = ",".join(["time_s", *names, "flying"])
    can_be = {"pressure": "90000", "temperature": "300"}
    can_be |= {f"rotor_speed_rpm_{k}": "900" for k in range(1, 5)}
    can_be |= {n: "310" for n in names if "_temperature_" in n}
    row = ",".join(can_be.get(name, "0.5") for name in ["time_s", *names, "flying"])
    (tmp_path / "all.csv").write_text(f"{header}\n{row}\n")
    log = read_log(tmp_path / "all.csv")
    assert log.format == "CSV"
    assert all(log.track.reports(channel) for channel in TRACK_CHANNELS)
    assert not any("not used" in note for note in map(statement_words, log.track.notes))
    import thrustmargin.gcs_plugin.logs.csv_table as module

    assert module.__doc__ is not None
    for stem in ("time_s", "position_north", "tank_kg", "rotor_speed_rpm_1", "throttle_1"):
        assert stem in module.__doc__


def test_empty_cells_and_missing_columns_are_unknown(tmp_path):
    (tmp_path / "some.csv").write_text("time_s,airspeed,tank_kg\n0,3.5,\n0.1,,9.9\n")
    track = read_log(tmp_path / "some.csv").track
    np.testing.assert_array_equal(track.airspeed, [3.5, np.nan])
    np.testing.assert_array_equal(track.tank_kg, [np.nan, 9.9])
    assert not track.reports("voltage")
    assert any("no ESC telemetry" in note for note in map(statement_words, track.notes))
    assert track.rotor_count == 0
    assert track.rotor_speed_rpm.shape == (2, 0)
    six = next(a for a in map(load_airframe, airframe_names()) if a.rotor_count != 4)
    track = read_log(tmp_path / "some.csv", airframe=six).track
    assert track.rotor_count == six.rotor_count


def test_unknown_columns_are_named_and_left_out(tmp_path):
    (tmp_path / "x.csv").write_text("time_s,airspeed,colour\n0,3.5,red\n1,3.6,blue\n")
    assert any(
        "columns not used: colour" in n
        for n in map(statement_words, read_log(tmp_path / "x.csv").track.notes)
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time,airspeed\n0,1\n", "no column time_s"),
        ("time_s,airspeed\n", "no rows"),
        ("time_s,airspeed\n0,1\n0,2\n", "row 2"),
        ("time_s,airspeed\n1,1\n0.5,2\n", "row 2"),
        ("time_s,airspeed\nnan,1\n", "row 1"),
        ("time_s,airspeed\n0,fast\n", "not a table of numbers"),
        ("time_s,airspeed\n0,1,2\n", "not a table of numbers"),
        ("time_s,airspeed,airspeed\n0,1,2\n", "there twice"),
        ("time_s,colour\n0,1\n", "no column but time_s"),
        ("# {broken\ntime_s,airspeed\n0,1\n", "not JSON"),
        ('# {"origin": {"latitude_deg": 1}}\ntime_s,airspeed\n0,1\n', "longitude_deg"),
    ],
)
def test_a_wrong_table_says_where_it_is_wrong(tmp_path, text, said):
    (tmp_path / "wrong.csv").write_text(text)
    with pytest.raises(LogError) as error:
        read_log(tmp_path / "wrong.csv")
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_a_heading_of_one_endless_cell_is_refused(tmp_path):
    path = tmp_path / "wide.csv"
    path.write_text(f"{'x' * 200_000},time_s\n1,2\n")
    with pytest.raises(LogError, match=r"names no column time_s; found 'xxx"):
        read_log(path)


def test_a_table_of_another_rotor_count_is_refused(tmp_path):
    names = [f"rotor_speed_rpm_{k}" for k in range(1, 7)]
    (tmp_path / "six.csv").write_text(f"time_s,{','.join(names)}\n0,1,2,3,4,5,6\n")
    with pytest.raises(AirframeError, match="6 rotors"):
        read_log(tmp_path / "six.csv", airframe=load_airframe("topxgun-f16"))


def test_text_that_is_neither_log_nor_table_is_refused(tmp_path):
    (tmp_path / "notes.tlog").write_text("Dear diary,\nflew today.\n")
    with pytest.raises(LogError, match=r"is text, but neither .*CSV"):
        read_log(tmp_path / "notes.tlog")


ROTORS = "rotor_speed_rpm_1,rotor_speed_rpm_2,rotor_speed_rpm_3"
ROWS = f"time_s,airspeed,{ROTORS}\n0,1.5,2000,2001,2002\n0.1,2.5,,2003,2004\n"


ENCODINGS = ("utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be")
#: separator, quote, whether 1.5 is 1,5, encoding, end of a line
WAYS = [(s, q, c, "utf-8", "\n") for s in ",;\t" for q in ("", '"') for c in (False, True)]
WAYS.remove((",", "", True, "utf-8", "\n"))  # cannot be read by anyone
WAYS += [(";", '"', True, code, end) for code in ENCODINGS for end in ("\n", "\r\n", "\r")]


@pytest.mark.parametrize(("separator", "quote", "comma", "encoding", "end"), WAYS)
def test_tables_as_other_programs_write_them(tmp_path, separator, quote, comma, encoding, end):
    lines = []
    for line in ROWS.splitlines():
        cells = [quote + (c.replace(".", ",") if comma else c) + quote for c in line.split(",")]
        lines.append(separator.join(cells))
    (tmp_path / "x.log").write_bytes((end.join(lines) + end).encode(encoding))
    track = read_log(tmp_path / "x.log").track
    np.testing.assert_array_equal(track.time_s, [0.0, 0.1])
    np.testing.assert_array_equal(track.airspeed, [1.5, 2.5])
    np.testing.assert_array_equal(track.rotor_speed_rpm, [[2000, 2001, 2002], [np.nan, 2003, 2004]])


def test_a_torn_row_is_left_out_and_counted_and_many_are_no_table(tmp_path):
    (tmp_path / "x.csv").write_text('# {"notes": ["by hand"]}\ntime_s,airspeed\n0,1\n1,2\n2')
    track = read_log(tmp_path / "x.csv").track
    np.testing.assert_array_equal(track.airspeed, [1.0, 2.0])
    assert tuple(map(statement_words, track.notes[:2])) == ("by hand", "1 torn row(s) are left out")
    (tmp_path / "x.csv").write_text("time_s,airspeed\n0,1\n1,2,3\n2")
    with pytest.raises(LogError, match="2 rows have another number of columns than the 2"):
        read_log(tmp_path / "x.csv")


def test_a_line_that_names_the_separator_is_passed_over(tmp_path):
    (tmp_path / "x.csv").write_text("sep=;\ntime_s;airspeed\n0;1\n1; 2,5\n")
    np.testing.assert_array_equal(read_log(tmp_path / "x.csv").track.airspeed, [1.0, 2.5])


@pytest.mark.slow
def test_the_csv_of_a_report_is_the_flight_again_to_the_last_digit(sitl_logs, tmp_path):
    log = str(sitl_logs / "campaign/v4_m16_q2.5.tlog")
    assert run(["report", log, "--out", str(tmp_path / "one.html")]) == 0
    track, again = read_log(log).track, read_log(tmp_path / "one.csv").track
    reported = reported_channels(track)
    assert {"position_ned", "velocity_ned", "attitude", "specific_force_frd"} <= reported
    assert reported_channels(again) == reported
    same_numbers(again, track)
    assert run(["report", log, log, "--out", str(tmp_path / "two.html")]) == 0
    two = read_log(tmp_path / "two.csv").track
    same_numbers(two, again)
    assert any(
        "2 flights in the file: the first is read" in note
        for note in map(statement_words, two.notes)
    )


def test_a_heading_may_have_our_unit_behind_it_and_no_other(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("time_s [s],voltage [V],current [mA],flying [0/1]\n0,50,3,1\n1,51,3,0\n")
    track = read_csv(path, 4)[0]
    np.testing.assert_array_equal(track.voltage, [50.0, 51.0])
    np.testing.assert_array_equal(track.flying, [True, False])
    assert not track.reports("current")
    assert "columns not used: current [mA]" in list(map(statement_words, track.notes))


@pytest.mark.parametrize(
    ("start", "known"),
    [
        *((word, None) for word in ("-9e10", "0", "true", "946684799", "4102444800", "1e300")),
        ("946684800", 946_684_800.0),  # the year 2000
        ("4102444799", 4_102_444_799.0),
    ],
)
def test_a_date_that_no_flight_has_is_none(tmp_path, start, known):
    path = tmp_path / "t.csv"
    path.write_text(f'# {{"start_unix_s": {start}}}\ntime_s,airspeed\n0,1\n1,2\n')
    assert read_csv(path, 0)[0].start_unix_s == known


def test_columns_that_only_another_flight_of_the_file_fills_are_none_of_the_first(tmp_path):
    path = tmp_path / "t.csv"
    rotors = ",".join(f"rotor_speed_rpm_{k} [rpm]" for k in range(1, 7))
    path.write_text(f"flight_number,time_s [s],{rotors}\n1,0,9,9,9,9,,\n2,0,9,9,9,9,9,9\n")
    assert read_csv(path, 0)[0].rotor_count == 4


@pytest.mark.parametrize(
    "about",
    [
        '{"notes": ' + "[" * 5000 + "]" * 5000 + "}",
        '{"origin": {"latitude_deg": 1e300, "longitude_deg": 0, "altitude": 0}}',
        '{"origin": {"latitude_deg": 1' + "0" * 400 + ', "longitude_deg": 0, "altitude": 0}}',
    ],
)
def test_a_comment_line_that_cannot_be_is_refused(tmp_path, about):
    (tmp_path / "x.csv").write_text(f"# {about}\ntime_s,airspeed\n0,1\n1,2\n")
    with pytest.raises(LogError, match="comment line"):
        read_log(tmp_path / "x.csv")


@pytest.mark.parametrize(
    "about",
    [
        '{"start_unix_s": 1' + "0" * 400 + "}",
        '{"start_unix_s": Infinity}',
        '{"name": {"a": 1}, "sources": [1], "notes": 7}',
        "[" * 5000,
        "time, as the logger has it",
    ],
)
def test_what_a_comment_line_says_amiss_is_passed_over(tmp_path, about):
    (tmp_path / "x.csv").write_text(f"# {about}\ntime_s,airspeed\n0,1\n1,2\n")
    track = read_log(tmp_path / "x.csv").track
    assert (track.name, track.start_unix_s, track.notes[1:]) == ("x.csv", None, ())


def test_time_in_milliseconds_is_refused_with_what_showed_it(sitl_logs, tmp_path):
    track = read_log(sitl_logs / "campaign/v4_m10_q2.5.tlog").track
    path = tmp_path / "ms.csv"
    write_csv(replace(track, time_s=track.time_s * 1000.0), path)
    said = "rows 100 s apart: time_s must be in s; a file columns.toml beside it states other units"
    with pytest.raises(LogError, match=said):
        read_csv(path, 0)


def test_a_column_of_another_unit_is_not_used_and_said(tmp_path):
    # Percent: what idles or stands would pass as a share. A gauge that says -1 knows nothing.
    rows = [f"{t / 10},{0 if t < 20 else 55},{2000 + t},-1" for t in range(100)]
    path = tmp_path / "percent.csv"
    path.write_text("\n".join(["time_s,throttle_1,rotor_speed_rpm_1,tank_kg", *rows]))
    log = read_log(path)
    track = log.track
    assert not track.reports("throttle")
    assert not track.reports("tank_kg")
    assert track.reports("rotor_speed_rpm")
    (said,) = (note for note in map(statement_words, track.notes) if note.startswith("throttle"))
    assert said.startswith("throttle: 80 of 100 rows are not within 0 to 1: not used")
    assert said in log_lines(log, stated=False)
    found = inspect_log(log, load_airframe("topxgun-f16-sitl")).findings
    assert ("units", "warning", said) in [(f.check, f.level, f.words) for f in found]
    # A few that cannot be are the sensor's.
    rows[50] = rows[50].replace(",55,", ",-7,")
    path.write_text(
        "\n".join(["time_s,throttle_1", *(r.rsplit(",", 2)[0] for r in rows)]).replace(
            ",55", ",0.55"
        )
    )
    track = read_log(path).track
    assert np.isfinite(track.throttle).sum() == 99
