"""Parameter files as ground stations write them, and what is none."""

import os

import pytest

from thrustmargin.gcs_plugin.logs.parameter_file import read_parameters
from thrustmargin.models.errors import LogError

WANTED = {"FRAME_CLASS": 1.0, "MOT_THST_EXPO": 0.65, "SERVO1_FUNCTION": 33.0}


@pytest.mark.parametrize(
    "text",
    [
        "FRAME_CLASS,1\nMOT_THST_EXPO,0.65\nSERVO1_FUNCTION,33\n",  # Mission Planner
        "#NOTE\r\nFRAME_CLASS,1\r\nMOT_THST_EXPO,.65 # expo\r\nSERVO1_FUNCTION,33.000\r\n",
        "FRAME_CLASS      1.000000\nMOT_THST_EXPO    0.650000\nSERVO1_FUNCTION 33\n",  # MAVProxy
        "# Vehicle-Id Component-Id Name Value Type\n1\t1\tFRAME_CLASS\t1\t2\n"
        "1\t1\tMOT_THST_EXPO\t0.65\t9\n1\t1\tSERVO1_FUNCTION\t33\t4\n",  # QGroundControl
        "\ufeffFRAME_CLASS=1\nMOT_THST_EXPO=0.65\nSERVO1_FUNCTION=33\nodd line\nNAN_ONE,nan\n",
    ],
)
def test_every_ground_stations_file_is_read(tmp_path, text):
    path = tmp_path / "vehicle.param"
    path.write_bytes(text.encode())
    assert read_parameters(path) == WANTED


def test_what_is_no_parameter_file_is_refused(tmp_path):
    path = tmp_path / "none.param"
    with pytest.raises(LogError, match="cannot be read"):
        read_parameters(path)
    path.write_bytes(bytes(range(256)) * 40)
    with pytest.raises(LogError, match="no parameter in it"):
        read_parameters(path)
    os.mkfifo(tmp_path / "pipe.param")
    with pytest.raises(LogError, match="pipe"):
        read_parameters(tmp_path / "pipe.param")
