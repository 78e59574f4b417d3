"""Tables with headings and units of others: each number worked out by hand, and what is refused."""

import numpy as np
import pytest

from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.gcs_plugin.logs.csv_table import COLUMNS, unit_of_column
from thrustmargin.gcs_plugin.wording.check_words import source_words, statement_words
from thrustmargin.models.errors import LogError
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.provenance import Meaning
from thrustmargin.models.units import UNITS

TABLE = "t,x,y,z,vx,m1,m2,m3,Vbat,temp,up,note,airspeed\n1500,1,2,3,4,100,200,60,3900,25,True,a,9\n"


def table(tmp_path, columns: str, text: str = TABLE, file: str = "columns.toml") -> FlightTrack:
    (tmp_path / "x.csv").write_text(text + text.splitlines()[1].replace("1500", "1600") + "\n")
    (tmp_path / file).write_text(columns)
    return read_log(tmp_path / "x.csv").track


def test_headings_units_and_signs_of_others_become_ours(tmp_path):
    track = table(
        tmp_path,
        """
        time_s = { column = "t", unit = "ms" }
        position_north = "x"
        position_east = { column = "y", factor = -1 }
        position_down = { column = "z", unit = "cm", factor = -1 }
        rotor_speed_rpm_1 = { column = "m1", unit = "rad/s" }
        rotor_speed_rpm_2 = { column = "m2", factor = 0.5 }
        rotor_speed_rpm_3 = { column = "m3", unit = "Hz" }
        throttle_1 = { column = "t", factor = 0.001, offset = -1 }
        voltage = { column = "Vbat", unit = "mV" }
        temperature = { column = "temp", unit = "°C" }
        flying = "up"
        tank_kg = 0
        """,
    )
    np.testing.assert_allclose(track.time_s, [1.5, 1.6])
    np.testing.assert_allclose(track.position_ned[0], [1.0, -2.0, -0.03])
    np.testing.assert_allclose(track.rotor_speed_rpm[0], [954.929659, 100.0, 3600.0])
    assert track.throttle[0, 0] == pytest.approx(0.5)
    assert track.voltage[0] == pytest.approx(3.9)
    assert track.temperature[0] == pytest.approx(298.15)
    assert track.tank_kg.tolist() == [0.0, 0.0]
    assert track.flying.tolist() == [True, True]
    assert track.airspeed[0] == 9.0  # a heading of ours stays ours
    assert any("columns not used: vx, note" in note for note in map(statement_words, track.notes))


def test_a_state_may_be_a_word_and_an_empty_cell_is_none(tmp_path):
    text = "time_s,flying,spraying\n0,false,1\n1,True,\n2,0.0,FALSE\n"
    (tmp_path / "y.csv").write_text(text)
    track = read_log(tmp_path / "y.csv").track
    assert track.flying.tolist() == [False, True, False]
    np.testing.assert_array_equal(track.spraying, [1.0, np.nan, 0.0])
    (tmp_path / "y.csv").write_text("time_s,flying\n0,perhaps\n")
    with pytest.raises(LogError, match="not a table of numbers"):
        read_log(tmp_path / "y.csv")


def test_a_quaternion_of_any_length_becomes_roll_pitch_and_yaw(tmp_path):
    """A quarter turn to the right, then 30 degrees nose up, written in axes with z up."""
    half = np.radians(15.0)
    yaw, pitch = np.array([1, 0, 0, 1]), np.array([np.cos(half), 0, np.sin(half), 0])
    w = yaw[0] * pitch[0]
    x, y, z = -yaw[3] * pitch[2], yaw[0] * pitch[2], yaw[3] * pitch[0]
    text = f"time_s,qw,qx,qy,qz\n0,{3 * w},{3 * x},{-3 * y},{-3 * z}\n1,0,0,0,0\n"
    lines = ['quaternion_w = "qw"', 'quaternion_x = "qx"']
    lines += [f'quaternion_{k} = {{ column = "q{k}", factor = -1 }}' for k in "yz"]
    (tmp_path / "x.csv").write_text(text)
    (tmp_path / "x.columns.toml").write_text("\n".join(lines))
    track = read_log(tmp_path / "x.csv").track
    np.testing.assert_allclose(np.degrees(track.attitude[0]), [0.0, 30.0, 90.0], atol=1e-9)
    assert np.isnan(track.attitude[1]).all()


def test_airspeed_is_velocity_less_wind_where_none_is_given(tmp_path):
    text = "time_s,velocity_north,velocity_east,velocity_down,wind_north,wind_east,wind_down{}\n"
    row = "0,3,0,0,0,4,0{}\n"
    (tmp_path / "x.csv").write_text(text.format("") + row.format(""))
    track = read_log(tmp_path / "x.csv").track
    assert track.airspeed.tolist() == [5.0]
    assert source_words(track.sources["airspeed"]) == "velocity less wind"
    (tmp_path / "x.csv").write_text(text.format(",airspeed") + row.format(",7"))
    assert read_log(tmp_path / "x.csv").track.airspeed.tolist() == [7.0]


def test_without_wind_the_speed_over_ground_is_the_airspeed_and_called_so(tmp_path):
    (tmp_path / "x.csv").write_text("time_s,velocity_north,velocity_east,velocity_down\n0,3,4,0\n")
    track = read_log(tmp_path / "x.csv").track
    assert track.airspeed.tolist() == [5.0]
    assert track.sources["airspeed"].meaning is Meaning.GROUND_SPEED


def test_the_file_of_one_table_goes_before_that_of_its_folder(tmp_path):
    (tmp_path / "columns.toml").write_text('time_s = "x"\nvoltage = "x"')
    track = table(tmp_path, 'time_s = "t"\nvoltage = "y"', file="x.columns.toml")
    assert track.voltage[0] == 2.0


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("time_s =", "not a file of columns"),
        ('speed = "x"', "'speed' is no column of ours"),
        ('voltage = "volts"', "no column 'volts'"),
        ("voltage = true", "needs a number, or a heading"),
        ("voltage = inf", "needs a number, or a heading"),
        ('voltage = { unit = "mV" }', "needs a number, or a heading"),
        ('voltage = { column = "Vbat", scale = 2 }', "'scale'"),
        ('voltage = { column = "Vbat", factor = "2" }', "must be numbers"),
        (f"voltage = 1{'0' * 400}", "needs a number, or a heading"),
        (f'voltage = {{ column = "Vbat", factor = 1{"0" * 400} }}', "must be numbers"),
        ('voltage = { column = "Vbat", offset = nan }', "must be numbers"),
        (f"voltage = {'9' * 5000}", "not a file of columns"),
        (f"voltage = {'[' * 5000}", "not a file of columns"),
        ('voltage = { column = "Vbat", unit = "rad" }', "'rad', which is not one of V, mV, cV"),
        ('voltage = { column = "Vbat", unit = ["mV"] }', "has the unit ['mV']"),
        ('quaternion_w = "x"', "not all of quaternion_w, quaternion_x"),
        ('voltage = "note"', "not a table of numbers"),
    ],
)
def test_a_wrong_line_is_named_in_one_sentence(tmp_path, line, said):
    with pytest.raises(LogError, match=r"^[^\n]+$") as error:
        table(tmp_path, f'time_s = "t"\n{line}')
    assert said in str(error.value)


def test_a_table_of_others_without_a_file_of_columns_says_what_to_write(tmp_path):
    (tmp_path / "x.csv").write_text(TABLE)
    with pytest.raises(LogError, match=r"in a file columns\.toml beside it"):
        read_log(tmp_path / "x.csv")


def test_every_unit_of_ours_has_those_of_others():
    names = [name for columns in COLUMNS.values() for name in columns]
    names += ["time_s", "flying", "rotor_speed_rpm_1", "throttle_12"]
    assert {unit_of_column(name) for name in names} <= set(UNITS)
    assert unit_of_column("colour") is None
