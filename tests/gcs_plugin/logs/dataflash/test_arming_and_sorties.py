"""What arming, a crash check and the log's end make of the flights of one boot."""

from pathlib import Path

import numpy as np
import pytest

from tests.gcs_plugin.logs.log_files import DataFlashWriter
from thrustmargin.gcs_plugin.logs.read import read_sorties
from thrustmargin.gcs_plugin.telemetry.recording import FlightLog
from thrustmargin.gcs_plugin.telemetry.vehicle_events import EventKind
from thrustmargin.models.checks.loss_of_control import loss_of_control
from thrustmargin.models.model.advice import advise
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.model.analysis import analyse, unknown_aircraft
from thrustmargin.models.statement import state

ARMED, DISARMED, LANDED, NOT_LANDED = 10, 11, 18, 28
RNG = np.random.default_rng(6)


class Boot(DataFlashWriter):
    """One boot of a quad: ten times a second attitude, outputs and height."""

    def __init__(self) -> None:
        super().__init__()
        self.texts("ArduCopter V4.1.3", "Frame: QUAD")
        self.parameters(FRAME_CLASS=1, FRAME_TYPE=1, MOT_SPIN_MIN=0.15)
        for channel in range(1, 5):
            self.row("PARM", 1, f"SERVO{channel}_FUNCTION", 32 + channel)
        self.message("EV", "QB", "TimeUS,Id")
        self.message("ERR", "QBB", "TimeUS,Subsys,ECode")
        self.message("ATT", "Qccccc", "TimeUS,DesRoll,Roll,DesPitch,Pitch,Yaw")
        self.message("RCOU", "QHHHH", "TimeUS,C1,C2,C3,C4")
        self.message("BARO", "Qff", "TimeUS,Alt,Press")
        self.message("IMU", "Qffffff", "TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ")

    def event(self, at_s: float, number: int) -> None:
        self.row("EV", int(1e6 * at_s), number)

    def crash_check(self, at_s: float) -> None:
        self.row("ERR", int(1e6 * at_s), 12, 1)

    def flies(self, begin_s: float, end_s: float, *, over_s: float = np.inf) -> None:
        """Rows in the air, 3 m up; from `over_s` on it lies on its back."""
        for at_s in np.arange(begin_s, end_s, 0.1):
            micro, over = int(1e6 * at_s), at_s >= over_s
            roll = 178.0 if over else RNG.normal(0.0, 1.0)
            height = 0.0 if over else 3.0 + 0.1 * np.sin(at_s)
            force = 9.8 if over else -9.8 + 0.3 * np.sin(at_s)
            self.row("ATT", micro, 0, int(100 * roll), 0, int(100 * RNG.normal(0.0, 1.0)), 0)
            self.row("RCOU", micro, *(int(1500 + 40 * x) for x in RNG.normal(0.0, 1.0, 4)))
            self.row("BARO", micro, height, 101_325.0 - 12.0 * height)
            self.row("IMU", micro, *RNG.normal(0.0, 0.05, 3), 0.1, 0.1, force)

    def stands(self, begin_s: float, end_s: float) -> None:
        for at_s in np.arange(begin_s, end_s, 0.1):
            micro = int(1e6 * at_s)
            self.row("ATT", micro, 0, 0, 0, 0, 0)
            self.row("RCOU", micro, *(1100,) * 4)
            self.row("BARO", micro, 0.0, 101_325.0)
            self.row("IMU", micro, 0.0, 0.0, 0.0, 0.0, 0.0, -9.8)

    def sorties(self, folder: Path) -> tuple[FlightLog, ...]:
        path = folder / "boot.BIN"
        path.write_bytes(self.binary())
        return read_sorties(path)


def advice(log: FlightLog):
    airframe_match = AirframeMatch(basis="not known", no_verdict=(state("no airframe given"),))
    model = unknown_aircraft(log.track.rotor_count)
    return advise(analyse(log.track, model, airframe_match=airframe_match)).advice


def two_flights(*, disarmed: bool) -> Boot:
    boot = Boot()
    boot.stands(9.0, 11.0)
    boot.event(9.0, ARMED)
    boot.event(11.0, NOT_LANDED)
    boot.flies(11.0, 40.0)
    boot.event(40.0, LANDED)
    if disarmed:
        boot.event(40.1, DISARMED)
    # The log stops while disarmed, and goes on with the next arming.
    boot.event(70.0, ARMED)
    boot.stands(70.0, 72.0)
    boot.event(72.0, NOT_LANDED)
    boot.flies(72.0, 100.0)
    boot.event(100.05, LANDED)
    return boot


@pytest.mark.parametrize("disarmed", [True, False])
def test_who_is_armed_again_begins_another_flight_of_the_same_vehicle(tmp_path, disarmed):
    found = two_flights(disarmed=disarmed).sorties(tmp_path)
    assert len(found) == 2
    for log in found:
        assert log.facts.rotor_count == 4
        assert log.track.reports("throttle")
        assert log.track.flying_s == pytest.approx(28.5, abs=1.0)


def test_a_landing_that_is_the_last_word_of_a_log_is_seen(tmp_path):
    first, last = two_flights(disarmed=True).sorties(tmp_path)
    for log in (first, last):
        assert not advice(log).ends_in_flight
        assert not advice(log).begun_before


def test_a_log_that_stops_in_the_air_ends_there(tmp_path):
    boot = Boot()
    boot.event(9.0, ARMED)
    boot.stands(9.0, 11.0)
    boot.event(11.0, NOT_LANDED)
    boot.flies(11.0, 40.0)
    (log,) = boot.sorties(tmp_path)
    assert advice(log).ends_in_flight


def test_what_turned_over_and_was_disarmed_by_the_crash_check_lost_control(tmp_path):
    boot = Boot()
    boot.event(9.0, ARMED)
    boot.stands(9.0, 11.0)
    boot.event(11.0, NOT_LANDED)
    boot.flies(11.0, 40.0, over_s=35.0)
    boot.crash_check(40.0)
    boot.event(70.0, ARMED)
    boot.stands(70.0, 72.0)
    boot.event(72.0, NOT_LANDED)
    boot.flies(72.0, 100.0)
    crashed, again = boot.sorties(tmp_path)
    signs = loss_of_control(crashed.track)
    assert signs
    assert crashed.clock_start_s + signs[0].time_s == pytest.approx(35.0, abs=0.3)
    assert not loss_of_control(again.track)
    # The crash is of the first flight alone.
    kinds = [[event.kind for event in log.events] for log in (crashed, again)]
    assert EventKind.CRASH in kinds[0]
    assert EventKind.CRASH not in kinds[1]


def test_a_parameter_that_was_set_between_two_flights_is_that_of_the_second(tmp_path):
    boot = two_flights(disarmed=True)
    boot.row("PARM", int(71e6), "MOT_SPIN_MIN", 0.3)
    first, second = boot.sorties(tmp_path)
    assert first.parameters["MOT_SPIN_MIN"] == pytest.approx(0.15)
    assert second.parameters["MOT_SPIN_MIN"] == pytest.approx(0.3)
    assert first.parameters["FRAME_CLASS"] == second.parameters["FRAME_CLASS"] == 1.0
