"""Recorded flights whose ESC telemetry is swapped or scaled: which part the report blames."""

import json
from pathlib import Path

import pytest

from tests.changed_speeds import changed_speeds
from thrustmargin.gcs_plugin.cli import run

WORN, ONSET = "dev/worn_prop_1.tlog", "onset/worn_prop_onset.tlog"  # rotor 1 by 8 %, 3 by 12 %
SOUND = "campaign/v4_m10_q2.5.tlog"


def report(sitl_logs: Path, tmp_path: Path, log: str, **change) -> dict:
    made = changed_speeds(sitl_logs / log, tmp_path / "flight.tlog", **change)
    out = tmp_path / "report.json"
    assert run(["report", str(made), "--json", str(out)]) == 0
    (flight,) = json.loads(out.read_text())["flights"]
    return flight


@pytest.mark.parametrize(
    ("log", "change", "rotors"),
    [
        (WORN, {"swapped": (1, 2), "rate_hz": 3.0}, [1, 2]),
        (WORN, {"swapped": (1, 2), "noise": 0.05}, [1, 2]),
        (WORN, {"swapped": (1, 3), "rate_hz": 3.0}, [1, 3]),
        (WORN, {"swapped": (1, 2), "rate_hz": 3.0, "outputs": False}, [1, 2]),
        (WORN, {"noise": 0.05, "outputs": False}, [1, 2]),
        (ONSET, {"swapped": (2, 3), "noise": 0.05}, [2, 3]),
        (WORN, {"rate_hz": 3.0}, [1]),
        (WORN, {"noise": 0.05}, [1]),
        (ONSET, {"rate_hz": 3.0}, [3]),
    ],
)
def test_a_rotor_whose_speed_may_be_anothers_is_one_of_the_two(
    sitl_logs, tmp_path, log, change, rotors
):
    flight = report(sitl_logs, tmp_path, log, **change)
    (alarm,) = flight["alarms"]
    assert alarm["rotors"] == rotors
    assert (alarm["rotor"] is None) == (len(rotors) > 1)
    which = " OR ".join(map(str, rotors))
    assert flight["verdict"]["headline"].startswith(f"ROTOR {which}")


@pytest.mark.parametrize("factor", [0.96, 1.04, 1.08])
def test_an_esc_that_reads_high_or_low_is_no_propeller(sitl_logs, tmp_path, factor):
    sound = report(sitl_logs, tmp_path, SOUND)
    flight = report(sitl_logs, tmp_path, SOUND, scale=(1.0, 1.0, factor, 1.0))
    assert flight["alarms"] == []
    assert flight["misread_speed"]["rotor"] == 3
    assert flight["misread_speed"]["factor"] == pytest.approx(factor, abs=0.01)
    # Its thrust is taken as of the true speed, so the verdict is that of the sound flight.
    assert flight["verdict"]["headline"] == sound["verdict"]["headline"]
    assert sound["misread_speed"] is None
    assert "do not fly" not in flight["verdict"]["action"]
    assert "check pole count and telemetry of the ESC of rotor 3" in flight["verdict"]["action"]


def test_without_outputs_a_high_reading_is_a_propeller_or_its_esc(sitl_logs, tmp_path):
    scale = (1.0, 1.0, 1.04, 1.0)
    flight = report(sitl_logs, tmp_path, SOUND, scale=scale, outputs=False)
    (alarm,) = flight["alarms"]
    assert (alarm["rotor"], alarm["witnessed_by_outputs"]) == (3, False)
    headline = flight["verdict"]["headline"]
    # 1 - 1.04**-2
    assert headline == "ROTOR 3, FRONT LEFT: 8 % LESS THRUST, OR ITS ESC READS 4 % HIGH"
    low = report(sitl_logs, tmp_path, SOUND, scale=(1.0, 1.0, 0.96, 1.0), outputs=False)
    assert low["alarms"] == []
    assert (low["misread_speed"]["rotor"], low["misread_speed"]["witnessed_by_outputs"]) == (
        3,
        False,
    )


@pytest.mark.parametrize("log", ["dev/worn_prop_2.tlog", "dev/worn_prop_3.tlog", ONSET])
def test_worn_propellers_keep_their_name(sitl_logs, tmp_path, log):
    flight = report(sitl_logs, tmp_path, log)
    (alarm,) = flight["alarms"]
    assert alarm["witnessed_by_outputs"]
    assert alarm["rotor"] == (3 if log == ONSET else 1)
    assert flight["misread_speed"] is None
