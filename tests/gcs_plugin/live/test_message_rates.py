"""What is asked of a vehicle that follows, forgets, is overruled, or never answers."""

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.live.live_vehicle import SECOND, Vehicle, as_frame
from thrustmargin.gcs_plugin.link.sender import Sender
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.gcs_plugin.live.message_rates import RateRequester, needed_messages
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

COMPONENT = 25  # MAV_COMP_ID_USER1
MODEL = physics_model(load_airframe("topxgun-f16-sitl"))
ATTITUDE, ESCS, PRESSURE = 30, 11030, 29


class Aboard:
    """A vehicle that sends ATTITUDE and ESC telemetry as it is asked to, in the place of a link.

    `deaf`: it does as it likes. Without a wish they come at 1 Hz, as a restart leaves them.
    """

    def __init__(self, **vehicle: Any) -> None:
        self.vehicle = Vehicle(**vehicle)
        self.fleet = Fleet(MODEL)
        self.requester = RateRequester(Sender(self), 4)  # type: ignore[arg-type]
        self.parser = dialect.MAVLink(None)
        self.rates: dict[int, float] = {}
        self.deaf = False
        self.rounds = 1  # ticks from one round to the next
        self.heard: list[tuple[float, Any]] = []  # s of flight, message
        self.parameters: dict[str, float] = {}
        self.count = 1000
        self.at_s = 0.0
        self.answers: list[Any] = []

    def send(self, data: bytes, *, system: int | None = None, forwards: bool = False) -> None:
        del system, forwards
        messages: list[Any] = self.parser.parse_buffer(data) or []
        for message in messages:
            self.heard.append((self.at_s, message))
            if message.get_type() == "COMMAND_LONG" and not self.deaf:
                self.rates[int(message.param1)] = 1e6 / message.param2
            if message.get_type() == "PARAM_REQUEST_READ" and message.param_id in self.parameters:
                value = self.parameters[message.param_id]
                self.answers.append(
                    dialect.MAVLink_param_value_message(
                        message.param_id.encode(), value, 9, self.count, 65535
                    )
                )

    def fly(self, seconds: float) -> None:
        for tick in range(round(seconds * 10)):
            self.at_s += 0.1
            self.vehicle.clock_s += 0.1
            self.vehicle.stamp_us += SECOND // 10
            frames = [self.vehicle.frame(answer) for answer in self.answers]
            self.answers.clear()
            parts = [(ATTITUDE, self.vehicle.attitude), (ESCS, self.vehicle.escs)]
            for number, part in parts:
                if tick % max(round(10 / self.rates.get(number, 1.0)), 1) == 0:
                    frames.append(as_frame(part(), self.vehicle.stamp_us))
            if tick % 10 == 0:
                frames.append(as_frame(self.vehicle.heartbeat(), self.vehicle.stamp_us))
            self.fleet.take(frames)
            if tick % 10 == 0:
                self.fleet.updates()
            for _ in range(0 if tick % self.rounds else 2):
                self.requester.on_round(self.fleet, self.vehicle.stamp_us)

    def asked(self, number: int) -> list[float]:
        """When a message was asked for, s."""
        return [
            at
            for at, message in self.heard
            if message.get_type() == "COMMAND_LONG" and int(message.param1) == number
        ]

    def named(self, name: str) -> list[float]:
        return [at for at, m in self.heard if getattr(m, "param_id", "") == name]


def test_a_vehicle_that_follows_is_asked_once_one_request_at_a_time():
    aboard = Aboard()
    aboard.fly(15.0)
    assert len(aboard.asked(ATTITUDE)) == len(aboard.asked(ESCS)) == 1
    commands = [m for _, m in aboard.heard if m.get_type() == "COMMAND_LONG"]
    assert {(m.command, m.target_system, m.get_srcComponent()) for m in commands} == {
        (511, 1, COMPONENT)
    }
    rates = {int(m.param1): 1e6 / m.param2 for m in commands}
    assert rates == {n: pytest.approx(hz, rel=1e-3) for n, hz in needed_messages(3, 4).values()}
    times = [at for at, m in aboard.heard if m.get_type() != "HEARTBEAT"]
    assert max(times.count(at) for at in times) <= 2  # a tenth of a second


def test_rates_that_another_station_lowers_are_renewed_within_five_seconds():
    aboard = Aboard()
    aboard.fly(15.0)
    for _ in range(2):
        lowered = aboard.at_s
        aboard.rates = dict.fromkeys(aboard.rates, 2.0)
        aboard.fly(10.0)
        renewed = [at for at in aboard.asked(ATTITUDE) if at > lowered]
        assert len(renewed) == 1
        assert renewed[0] - lowered <= 5.0
        assert aboard.rates[ATTITUDE] == pytest.approx(10.0)


@pytest.mark.parametrize("rounds", [1, 5, 10])
def test_however_rare_the_rounds_all_is_asked_for_within_five_seconds_and_escs_first(rounds):
    aboard = Aboard()
    aboard.rounds = rounds
    aboard.fly(20.0)
    lowered = aboard.at_s
    aboard.rates = dict.fromkeys(aboard.rates, 2.0)
    aboard.fly(10.0)
    commands = [(at, int(m.param1)) for at, m in aboard.heard if m.get_type() == "COMMAND_LONG"]
    assert commands[0][1] == ESCS
    renewed = [
        (at, number) for at, number in commands if at > lowered and number in (ATTITUDE, ESCS)
    ]
    assert [number for _, number in renewed] == [ESCS, ATTITUDE]
    assert max(at for at, _ in renewed) - lowered <= 5.0


def test_after_a_restart_all_is_asked_for_again_within_five_seconds():
    aboard = Aboard(clock_s=500.0)
    aboard.fly(15.0)
    back = aboard.at_s
    aboard.vehicle.clock_s, aboard.rates = 2.0, {}
    aboard.fly(6.0)
    for number in (ATTITUDE, ESCS, PRESSURE):
        assert any(back < at <= back + 5.0 for at in aboard.asked(number)), number


@pytest.mark.slow
def test_a_vehicle_that_does_not_follow_is_asked_ever_more_rarely_and_it_is_said():
    aboard = Aboard()
    aboard.deaf = True
    aboard.fly(100.0)
    times = aboard.asked(ATTITUDE)
    assert 5 <= len(times) <= 7
    assert times[-1] - times[-2] > 40.0
    came, asked = aboard.fleet.vehicles[1].not_followed["ATTITUDE"]
    assert (round(came), asked) == (1, 10.0)
    aboard.deaf = False
    aboard.fly(70.0)
    assert "ATTITUDE" not in aboard.fleet.vehicles[1].not_followed
    assert aboard.fleet.vehicles[1].not_followed["SCALED_PRESSURE"] == (0.0, 2.0)


def test_a_pause_of_the_link_is_no_lowered_rate():
    aboard = Aboard()
    aboard.fly(15.0)
    aboard.vehicle.clock_s += 8.0
    aboard.vehicle.stamp_us += 8 * SECOND
    aboard.fly(10.0)
    assert len(aboard.asked(ATTITUDE)) == 1


def test_parameters_that_are_missing_are_asked_for_by_name_until_they_have_come():
    aboard = Aboard()
    functions = {f"SERVO{n}_FUNCTION": 32.0 + n if n <= 8 else 0.0 for n in range(1, 17)}
    functions["SERVO9_FUNCTION"] = 22.0
    aboard.parameters = {n: v for n, v in functions.items() if n != "SERVO8_FUNCTION"}
    aboard.fly(20.0)
    watch = aboard.fleet.vehicles[1]
    # A part of the outputs counts no motors: the heartbeat says a quad.
    assert (watch.state.facts.rotor_count, watch.state.facts.rotor_evidence) == (4, "MAV_TYPE 2")
    assert len(aboard.named("SERVO8_FUNCTION")) >= 2
    assert len(aboard.named("SERVO7_FUNCTION")) == 1
    assert aboard.named("SERVO9_MIN")
    aboard.parameters = functions
    aboard.fly(20.0)
    assert watch.state.facts.rotor_count == 8
    assert watch.state.facts.rotor_evidence == "SERVOn_FUNCTION"


def test_a_parameter_that_does_not_exist_is_given_up_once_all_are_known():
    aboard = Aboard()
    aboard.parameters = {f"SERVO{n}_FUNCTION": 0.0 for n in range(1, 17)}
    aboard.count = 16
    aboard.fly(15.0)
    assert len(aboard.named("WP_SPD")) == 1


def test_px4_is_asked_for_its_own_messages():
    names = needed_messages(12, 4)
    assert names["ESC_STATUS"] == (291, 10.0)
    assert "ESC_TELEMETRY_1_TO_4" not in names
    assert "ESC_TELEMETRY_5_TO_8" in needed_messages(3, 8)
