"""The module in a real MAVProxy, which hears a recorded flight over loopback UDP."""

import importlib.util
import json
import os
import re
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import numpy as np
import pytest

from tests.gcs_plugin.live.live_vehicle import Vehicle, log_frames
from tests.gcs_plugin.peers.ports import free_udp_port
from tests.gcs_plugin.peers.udp_sender import send_frames, sending_frames
from tests.waiting import until
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.gcs_plugin.live.watch.update import WatchSettings
from thrustmargin.gcs_plugin.live.watch.vehicle_monitor import VehicleMonitor
from thrustmargin.gcs_plugin.mavlink.frame import frame_of
from thrustmargin.gcs_plugin.mavlink.scan import stamped_frames
from thrustmargin.gcs_plugin.office.stations.mavproxy_worker import (
    MarginOptions,
    MarginWorker,
    NewestFigures,
    fields,
    reading,
    share,
    summary,
)
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.model_file import save_model, shipped_model
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

MODULE = "thrustmargin.gcs_plugin.mavproxy_module"
PEERS = Path(__file__).parents[2] / "peers"
INSTALLED = importlib.util.find_spec("MAVProxy") is not None
if not INSTALLED and os.environ.get("THRUSTMARGIN_REQUIRE_MAVPROXY"):
    pytest.fail("THRUSTMARGIN_REQUIRE_MAVPROXY is set and the extra [mavproxy] is not installed")
in_mavproxy = [
    pytest.mark.slow,
    pytest.mark.skipif(not INSTALLED, reason="the extra [mavproxy] is not installed"),
]


class MavProxy:
    """One MAVProxy process; commands go to its standard input, `wait` reads what it prints."""

    def __init__(self, folder: Path, *commands: str) -> None:
        self.port = free_udp_port()
        path = f"{PEERS}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"
        self._process = subprocess.Popen(
            [
                *(sys.executable, "-u", "-m", "MAVProxy.mavproxy"),
                *(f"--master=udpin:127.0.0.1:{self.port}", "--no-state", "--nowait"),
                *(f"--cmd={c}" for c in ("module load mavproxy_probe", *commands)),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=folder,
            env={**os.environ, "HOME": str(folder), "PYTHONPATH": path},
        )
        self.printed: list[str] = []
        self._read = 0
        threading.Thread(target=self._collect, daemon=True).start()

    def _collect(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.printed.append(re.sub(r"^(\w+> )+", "", line.rstrip("\n")))

    def begin(self) -> None:
        """What was printed so far counts no longer."""
        self.printed.clear()
        self._read = 0

    def do(self, command: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(command + "\n")
        self._process.stdin.flush()

    def wait(self, pattern: str, timeout: float = 120.0) -> re.Match[str]:
        """The next line printed that has `pattern`; lines before it are passed over."""
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            while self._read < len(self.printed):
                self._read += 1
                if found := re.search(pattern, self.printed[self._read - 1]):
                    return found
            time.sleep(0.02)
        raise AssertionError(f"{pattern!r} not in:\n" + "\n".join(self.printed))

    def ask(self, command: str, pattern: str) -> re.Match[str]:
        self._read = len(self.printed)
        self.do(command)
        return self.wait(pattern)

    def ask_until(self, command: str, pattern: str, answer: str) -> re.Match[str]:
        """Ask again until what is answered, a line with `answer`, has the pattern."""
        deadline = time.monotonic() + 120.0
        while not (found := re.search(pattern, self.ask(command, answer).string)):
            assert time.monotonic() < deadline, "\n".join(self.printed)
            time.sleep(0.2)
        return found

    def probe(self) -> dict[str, Any]:
        return json.loads(self.ask("probe", "PROBE(.*)")[1])

    def wait_for_field(self, name: str, colours: set[str], text: str = "") -> None:
        """Until the console's field `name` has one of the colours and the text (a pattern)."""
        deadline = time.monotonic() + 120.0
        while True:
            shown, colour, _ = self.probe()["fields"].get(name, ["", "", ""])
            if colour in colours and re.search(text, shown):
                return
            assert time.monotonic() < deadline, (name, shown, colour)
            time.sleep(0.2)

    def close(self) -> int:
        assert self._process.stdin is not None
        self._process.stdin.close()
        try:
            return self._process.wait(120)
        except subprocess.TimeoutExpired:
            self._process.kill()
            raise


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "weight.safetensors"
    save_model(physics_model(load_airframe("topxgun-f16-sitl")), path)
    return path


@pytest.fixture(scope="module")
def flight(sitl_logs: Path) -> list[tuple[int, bytes]]:
    """(µs from the first, frame) of a flight: take-off with 16 kg at 45 s, then spraying."""
    found = list(stamped_frames(sitl_logs / "campaign" / "v4_m16_q2.5.tlog"))
    start = found[0][0]
    return [(t - start, data) for t, data in found if t - start < 140e6]


@pytest.fixture(scope="module")
def one_mavproxy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[MavProxy]:
    running = MavProxy(tmp_path_factory.mktemp("mavproxy"))
    try:
        yield running
    finally:
        running.close()


@pytest.fixture
def mavproxy(one_mavproxy: MavProxy, model: Path) -> Iterator[MavProxy]:
    """The one MAVProxy with the module loaded anew, its model given."""
    one_mavproxy.ask("forget", "forgotten")
    one_mavproxy.begin()
    one_mavproxy.ask(f'module load {MODULE}:{{"model":"{model}"}}', f"Loaded module {MODULE}")
    yield one_mavproxy
    one_mavproxy.ask(f"module unload {MODULE}", f"Un(loaded|able to find) module {MODULE}")


def part(flight: list[tuple[int, bytes]], start: float, stop: float) -> list[tuple[int, bytes]]:
    """What was recorded from `start` to `stop` s."""
    return [(stamp, data) for stamp, data in flight if start * 1e6 <= stamp < stop * 1e6]


def play(flight: list[tuple[int, bytes]], port: int, start: float, stop: float, speed: float):
    """Send what was recorded from `start` to `stop` s; returns when it is sent."""
    send_frames(part(flight, start, stop), port, speed)


def playing(flight: list[tuple[int, bytes]], port: int, start: float, stop: float, speed: float):
    """Play on a thread meanwhile, and no longer than the caller looks."""
    return sending_frames(part(flight, start, stop), port, speed)


def watched(
    flight: list[tuple[int, bytes]], start: float, stop: float, model: Path
) -> NewestFigures:
    """What `live.vehicle_monitor` makes of the same frames in this process."""
    from thrustmargin.models.model.model_file import load_model

    fleet = Fleet(load_model(model))
    chosen = part(flight, start, stop)
    last = None
    for n, (stamp, data) in enumerate(chosen, start=1):
        frame = frame_of(data, stamp_us=1_700_000_000_000_000 + stamp)
        assert frame is not None
        fleet.take([frame])
        if n % 100 == 0 or n == len(chosen):
            for update in fleet.updates():
                last = reading(update, 0.0)
    assert last is not None
    return last


def nearly(line: str) -> str:
    """Return the pattern of a line whose shares may be 3 points off.

    Rotor speeds carry no clock: which row they are in is by when this machine heard them.
    """
    line = re.escape(line.replace(" %", "%"))
    line = re.sub(r"0\\\.(\d\d)", lambda m: f"0.({_around(int(m[1]))})", line)
    line = re.sub(r"(\d+)%", lambda m: f"({_around(int(m[1]))}) %", line)
    return re.sub(r"rotor\\ \d", r"rotor [1-4]", line)


def _around(number: int) -> str:
    return "|".join(str(near) for near in range(number - 3, number + 4))


class TestInMavproxy:
    pytestmark = in_mavproxy

    def test_margin_prints_what_the_watch_makes_of_the_same_frames(
        self, mavproxy: MavProxy, flight, model: Path
    ):
        mavproxy.ask("margin", "margin: no vehicle heard yet")
        first, second, *_ = summary(watched(flight, 40.0, 70.0, model), 0.5, 0.0)
        assert "flying: thrust left" in first
        play(flight, mavproxy.port, 40.0, 70.0, 4.0)
        vehicle, numbers = first.split(": ", 1)
        shown = rf"^{vehicle}, OLD: \d+ s ago: {nearly(numbers)}$"
        mavproxy.ask_until("margin", shown, "^margin: no|^vehicle 1")
        mavproxy.wait(f"^{nearly(second)}$")
        mavproxy.wait(r"  tank 15\.\d kg by NAMED_VALUE_FLOAT TANK, empty after ")

    def test_everything_is_computed_off_the_main_thread(self, mavproxy: MavProxy, flight):
        play(flight, mavproxy.port, 40.0, 45.0, 4.0)
        mavproxy.ask_until("margin", "vehicle 1", "^margin: no|^vehicle 1")
        mavproxy.ask("spy", "spying")
        play(flight, mavproxy.port, 45.0, 53.0, 4.0)
        seen = mavproxy.probe()
        assert seen["analysed_on"] == ["thrustmargin"]
        assert "thrustmargin" in seen["threads"]
        assert not seen["torch"]
        assert {field[2] for field in seen["fields"].values()} == {"main_loop"}

    def test_a_limit_is_set_and_announced_when_the_margin_falls_under_it(
        self, mavproxy: MavProxy, flight
    ):
        name = "margin max-utilisation"
        assert mavproxy.ask(name, f"{name} (.*)")[1] == "50%"
        for wrong in ("x", "50", "0", "1", "-1", "nan"):
            mavproxy.ask(f"{name} {wrong}", f"{name} {wrong} is not a share")
        assert mavproxy.ask(name, f"{name} (.*)")[1] == "50%"
        mavproxy.ask(f"{name} 80%", f"{name} 80%")
        with playing(flight, mavproxy.port, 50.0, 140.0, 1.0):
            mavproxy.wait_for_field("Margin", {"green"}, r"^Left [34]\d % R[1-4]$")
            assert not [line for line in mavproxy.printed if line.startswith("Thrust left")]
            mavproxy.ask(f"{name} 0.4", f"{name} 40%")
            mavproxy.wait(r"Thrust left [345]\d% below 60%(, rotor [1-4])?: fly gently")
            mavproxy.ask("margin", "ALARM Thrust left")
            mavproxy.wait_for_field("Margin", {"red"})
            mavproxy.wait_for_field("OneOut", {"orange"}, r"^OneOut 0\.9\d$")
            mavproxy.wait_for_field("Tank", {"black"}, r"^Tank 1[2-6]\.\d kg$")

    def test_airframe_and_tank_are_set_in_its_own_syntax(self, tmp_path: Path, flight):
        """And at simulation speeds other than 1, here 8 and a third."""
        running = MavProxy(tmp_path, f"module load {MODULE}")
        try:
            running.wait(f"Loaded module {MODULE}")
            play(flight, running.port, 0.0, 44.0, 8.0)
            play(flight, running.port, 44.0, 46.0, 0.33)
            running.ask("margin airframe no-such", "margin airframe no-such")
            told = running.wait("margin: .*no-such.*")[0]
            assert "--" not in told
            running.ask("margin airframe topxgun-f16-sitl", "margin airframe topxgun-f16-sitl")
            running.ask("margin tank none", "margin tank none")
            running.ask("margin tank", "margin tank none")
            with playing(flight, running.port, 46.0, 140.0, 1.0):
                margin = r"vehicle 1, flying: thrust left [34]\d %"
                running.ask_until("margin", margin, "^margin: no|^vehicle 1")
                running.ask_until("margin", "inferred from hover", "^  tank")
                running.wait("airframe topxgun-f16-sitl, given")
                # Mission and parameters were heard before the options were changed.
                ahead = "rest of the route: "
                running.ask_until("margin", ahead, f"{ahead}|unknown: route ahead")
            running.ask("margin load heavy", "margin load heavy is no number")
        finally:
            running.close()

    def test_what_is_old_is_grey_and_said_to_be_old(self, mavproxy: MavProxy, flight):
        play(flight, mavproxy.port, 50.0, 58.0, 4.0)
        mavproxy.wait("Telemetry lost in flight: fly by sight")
        old = r"vehicle 1, flying, OLD: \d+ s ago: thrust left [34]\d %"
        mavproxy.ask_until("margin", old, "^margin: no|^vehicle 1")
        mavproxy.wait_for_field("Margin", {"grey"}, "^Left --$")
        with playing(flight, mavproxy.port, 58.0, 140.0, 1.0):
            # Which of the two ended is by whether whole reports or parts of them came first.
            mavproxy.wait("over: (Telemetry lost|Reports unusable) in flight")
            mavproxy.wait_for_field("Margin", {"red", "green"})

    def test_damage_on_the_link_does_no_harm(self, mavproxy: MavProxy, flight):
        torn = [
            (t, data[:-3] if n % 9 == 0 else data[5:] if n % 10 == 0 else data)
            for n, (t, data) in enumerate(flight)
        ]
        play(torn, mavproxy.port, 40.0, 60.0, 4.0)
        margin = r"vehicle 1, flying.*: thrust left [34]\d %"
        mavproxy.ask_until("margin", margin, "^margin: no|^vehicle 1")

    def test_it_can_be_unloaded_and_loaded_again(self, mavproxy: MavProxy, flight, model: Path):
        play(flight, mavproxy.port, 40.0, 44.0, 4.0)
        mavproxy.ask(f"module unload {MODULE}", f"Unloaded module {MODULE}")
        mavproxy.ask("margin", "Unknown command 'margin'")
        mavproxy.ask_until("probe", r'"threads": \[((?!thrustmargin)[^]])*\]', "PROBE")
        loaded = f'{MODULE}:{{"model":"{model}","max_utilisation":0.55}}'
        mavproxy.ask(f"module load {loaded}", "Loaded module")
        mavproxy.ask("margin max-utilisation", "margin max-utilisation 55%")
        mavproxy.ask(f"module reload {loaded}", f"Reloaded module {MODULE}")
        mavproxy.ask("margin", "margin: no vehicle heard yet")
        assert mavproxy.probe()["threads"].count("thrustmargin") == 1

    def test_view_opens_a_page_of_its_own_process_that_hears_the_vehicle(
        self, mavproxy: MavProxy, flight
    ):
        address = mavproxy.ask("margin view", r"margin view: (http://127\.0\.0\.1:\d+)")[1]
        deadline = time.monotonic() + 120.0
        page = b""
        while not page:
            assert time.monotonic() < deadline, "\n".join(mavproxy.printed)
            try:
                page = urlopen(address, timeout=100).read()
            except OSError:
                time.sleep(0.2)
        assert b"<html" in page
        mavproxy.ask("margin view", f"margin view is open: {address}")
        play(flight, mavproxy.port, 40.0, 44.0, 4.0)
        mavproxy.ask(f"module unload {MODULE}", f"Unloaded module {MODULE}")
        with pytest.raises(OSError, match="refused"):
            urlopen(address, timeout=100)

    def test_a_view_that_cannot_start_says_why(self, tmp_path: Path, flight, model: Path):
        copy = tmp_path / "gone.safetensors"
        copy.write_bytes(model.read_bytes())
        running = MavProxy(tmp_path, f'module load {MODULE}:{{"model":"{copy}"}}')
        try:
            running.wait(f"Loaded module {MODULE}")
            play(flight, running.port, 40.0, 44.0, 4.0)
            running.ask_until("margin", "vehicle 1", "^margin: no|^vehicle 1")
            copy.unlink()  # which the module has read by now
            running.ask("margin view", "margin view: http")
            running.wait(r"margin view ended: thrustmargin: .*gone\.safetensors")
            running.ask("margin", "^vehicle 1")
        finally:
            running.close()

    def test_a_model_that_is_not_there_is_named(self, tmp_path: Path):
        running = MavProxy(tmp_path, f'module load {MODULE}:{{"model":"absent.safetensors"}}')
        try:
            running.wait("margin: .*absent.safetensors")
            running.ask("margin", "margin: .*absent.safetensors")
            running.ask("margin bla", "margin: thrust margin of every vehicle")
        finally:
            running.close()


@pytest.mark.skipif(not INSTALLED, reason="the extra [mavproxy] is not installed")
def test_importing_the_module_does_nothing():
    code = (
        "import sys, threading\n"
        f"import {MODULE}\nimport importlib\n"
        f"importlib.reload(sys.modules['{MODULE}'])\n"
        "assert threading.active_count() == 1\n"
        "heavy = {'thrustmargin.models.flight', 'torch', 'viser', 'mavsdk'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout == done.stderr == ""


# --- words ------------------------------------------------------------------------------------

NOW = NewestFigures(
    vehicle=3,
    stamp=100.0,
    flying=True,
    margin=0.423,
    rotor=2,
    margin_predicted=0.45,
    redundancy=0.96,
    tank_kg=12.25,
    tank_source="by NAMED_VALUE_FLOAT TANK",
    seconds_to_empty=294.4,
    margin_full=0.39,
)


def test_a_row_that_is_computed_late_is_as_old_as_its_report():
    worker = MarginWorker(MarginOptions())
    fleet, vehicle = Fleet(physics_model(load_airframe("topxgun-f16-sitl"))), Vehicle(1)
    for _ in range(20):
        fleet.take(list(vehicle.tick(rpm=(1700,) * 4)))
    update = fleet.updates()[-1]
    stamp_us = np.full_like(update.stamp_us, round((time.time() - 7.0) * 1e6))
    worker._show(fleet, [replace(update, stamp_us=stamp_us)])
    assert time.monotonic() - worker.readings[1].stamp == pytest.approx(7.0, abs=6.0)


def test_who_hears_an_alarm_and_asks_gets_the_figures_of_the_same_round(model: Path):
    """The whole flight is computed in one round where the thread began late, on a busy machine."""
    worker, vehicle = MarginWorker(MarginOptions(model=str(model))), Vehicle(1)
    at_the_alarm: list[tuple[str, list[int]]] = []

    class Heard(deque):
        def append(self, message):
            at_the_alarm.append((message[1], [*worker.readings]))

    worker.messages = Heard()
    for _ in range(20):
        for frame in vehicle.tick():
            worker.put(frame.data)
    worker._looked = time.monotonic() + 10.0
    worker.start()
    until(lambda: at_the_alarm)
    worker.stop()
    assert [heard for words, heard in at_the_alarm if "Telemetry lost" in words] == [[1]]


def test_a_silent_esc_hides_no_margin_of_the_other_rotors():
    fleet, vehicle = Fleet(physics_model(load_airframe("topxgun-f16-sitl"))), Vehicle(1)
    for _ in range(20):
        fleet.take(list(vehicle.tick(rpm=(1700, 1800, 2300, 1700))))
    update = fleet.updates()[-1]
    whole = reading(update, 0.0)
    track = update.analysis.track
    speeds = track.rotor_speed_rpm.copy()
    speeds[:, 0] = np.nan
    silent = analyse(replace(track, rotor_speed_rpm=speeds), update.analysis.model)
    now = reading(replace(update, analysis=silent), 0.0)
    assert (now.rotor, now.margin) == (whole.rotor, whole.margin) == (3, pytest.approx(now.margin))
    speeds[:] = np.nan
    silent = analyse(replace(track, rotor_speed_rpm=speeds), update.analysis.model)
    now = reading(replace(update, analysis=silent), 0.0)
    assert now.basis == "predicted"
    assert now.margin == now.margin_predicted
    text, colour = fields(now, 0.9, 0.1)["Margin"]
    assert text == f"Left ≈ {100 * now.margin:.0f} % R{now.rotor}"
    assert colour == "orange"  # never green without a measurement
    assert now.margin_predicted == pytest.approx(silent.margin_predicted[-1].min())


def test_the_summary_says_everything_with_its_unit():
    assert summary(NOW, 0.5, 0.1) == [
        "vehicle 3, flying: thrust left 42 % (rotor 2), predicted 45 %, limit 50 %",
        "  one rotor lost, without yaw control, it will spin: 0.96 of the weight",
        "  tank 12.2 kg by NAMED_VALUE_FLOAT TANK, empty after 294 s of spraying, "
        "thrust left when refilled 39 %",
    ]


def test_a_margin_below_nothing_has_no_degrees():
    beyond = replace(NOW, margin=-0.12, margin_full=-0.3)
    lines = summary(beyond, 0.5, 0.1)
    assert "thrust left beyond the ceiling (rotor 2)" in lines[0]
    assert lines[2].endswith("thrust left when refilled beyond the ceiling")
    assert fields(beyond, 0.5, 0.0)["Margin"] == ("Left beyond the ceiling R2", "red")


def test_what_is_not_known_is_two_dashes():
    unknown = NewestFigures(vehicle=1, stamp=0.0)
    assert summary(unknown, 0.5, 0.0) == [
        "vehicle 1, on the ground: thrust left --, predicted --, limit 50 %",
        "  one rotor lost, without yaw control, it will spin: -- of the weight",
        "  tank -- kg, empty after -- s of spraying, thrust left when refilled --",
    ]
    assert share(float("inf")) == "--"


def test_the_rest_of_the_route_and_alarms_have_lines_of_their_own():
    more = replace(NOW, margin_ahead=0.31, alarms=("Tank empty, pump still on: switch it off",))
    assert summary(more, 0.5, 0.0)[3:] == [
        "  rest of the route: thrust left 31 %, less for moments in turns",
        "  ALARM Tank empty, pump still on: switch it off",
    ]


def test_a_problem_takes_the_place_of_numbers():
    stopped = replace(NOW, problem="two vehicles send as system 3")
    assert summary(stopped, 0.5, 0.0) == ["vehicle 3: two vehicles send as system 3"]
    assert fields(stopped, 0.5, 0.0)["Margin"] == ("Left --", "grey")
    assert summary(NewestFigures(vehicle=3), 0.5, 0.0) == ["vehicle 3: no rotor speeds yet"]


@pytest.mark.parametrize(
    ("margin", "redundancy", "colours"),
    [(0.51, 1.01, ("green", "green")), (0.49, 0.99, ("red", "orange"))],
)
def test_fields_change_colour_at_their_limits(margin, redundancy, colours):
    shown = fields(replace(NOW, margin=margin, redundancy=redundancy), 0.5, 0.0)
    assert (shown["Margin"][1], shown["OneOut"][1]) == colours


@pytest.mark.parametrize(
    ("known", "colours"),
    [
        ({"redundancy": float("nan")}, ("green", "grey")),
        ({"redundancy_low": 0.98}, ("green", "orange")),
        ({"unmeasured": 1}, ("orange", "green")),
    ],
)
def test_what_is_unknown_or_within_its_error_is_not_green(known, colours):
    good = replace(NOW, margin=0.6, ends=None, redundancy=1.05)
    shown = fields(replace(good, **known), 0.5, 0.0)
    assert (shown["Margin"][1], shown["OneOut"][1]) == colours
    assert {colour for name, (_, colour) in fields(good, 0.5, 0.0).items() if name != "Tank"} == {
        "green"
    }


def test_on_the_ground_the_margin_is_the_predicted_one(sitl_logs):
    frames = log_frames(sitl_logs / "campaign" / "v4_m10_q2.5.tlog")
    vehicle = VehicleMonitor(1, shipped_model(), WatchSettings())
    for frame in frames[: len(frames) // 20]:
        vehicle.take(frame)
    last = vehicle.updates()[-1]
    assert not last.analysis.track.flying[-1]
    now = reading(last, 0.0)
    assert (now.basis, now.margin) == ("predicted", pytest.approx(now.margin_predicted))
    assert now.unmeasured == 0


@pytest.mark.parametrize("age", [2.1, float("nan")])
def test_fields_of_old_rows_are_grey(age: float):
    assert {colour for _, colour in fields(NOW, 0.5, age).values()} == {"grey"}
    assert {colour for _, colour in fields(None, 0.5, 0.0).values()} == {"grey"}


def test_options_have_the_monitors_defaults():
    assert MarginOptions() == MarginOptions(
        model=None, airframe=None, tank="auto", max_utilisation=0.5
    )
