"""Playing a log: every frame, in order, at its time; heard by real sockets."""

import socket
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import pytest

from tests.gcs_plugin.live.live_vehicle import ROOT, SECOND, Vehicle, command, log_frames, write_log
from tests.waiting import PATIENCE
from thrustmargin.gcs_plugin.commands.flight.stream import stream
from thrustmargin.gcs_plugin.link import playback
from thrustmargin.gcs_plugin.link.playback import Played, play
from thrustmargin.gcs_plugin.link.transport import open_transport
from thrustmargin.gcs_plugin.mavlink.scan import stamped_frames
from thrustmargin.models.errors import LogError


def udp() -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
    made.bind(("127.0.0.1", 0))
    made.settimeout(PATIENCE)  # the sender is a process that must start
    return made


def short_log(path, seconds: float = 3.0):
    vehicle = Vehicle()
    frames = [f for _ in range(round(seconds * 10)) for f in vehicle.tick()]
    return write_log(path, frames), frames


class Timed:
    """A link and the clock of its player, which only waiting and sending move on."""

    ready = True

    def __init__(self, monkeypatch: pytest.MonkeyPatch, send_s: float) -> None:
        self.now_s, self.send_s = 1000.0, send_s
        self.sent: list[tuple[float, bytes]] = []  # s after the start, frame
        clock = SimpleNamespace(monotonic=lambda: self.now_s, sleep=self.sleep)
        monkeypatch.setattr(playback, "time", clock)

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds

    def receive(self, _timeout: float) -> list:
        time.sleep(0.01)
        return []

    def send(self, data: bytes) -> None:
        self.sent.append((self.now_s - 1000.0, data))
        self.now_s += self.send_s


def test_every_frame_goes_out_in_order_at_its_time(tmp_path, monkeypatch):
    path, frames = short_log(tmp_path / "a.tlog")
    link = Timed(monkeypatch, 0.0)
    played = play(path, link, speed=4.0)  # type: ignore[arg-type]
    assert [data for _, data in link.sent] == [f.data for f in frames]
    assert (played.frames, played.bytes) == (len(frames), sum(len(f.data) for f in frames))
    due = [(f.stamp_us - frames[0].stamp_us) * 1e-6 / 4.0 for f in frames]
    assert [at for at, _ in link.sent] == pytest.approx(due, abs=0.002)
    assert played.log_s == pytest.approx(2.9)


def test_delays_do_not_add_up(tmp_path, monkeypatch):
    """52 frames of 10 ms each are 0.5 s of work within the 0.9 s of the log."""
    path, _ = short_log(tmp_path / "a.tlog", 1.0)
    link = Timed(monkeypatch, 0.01)
    played = play(path, link)  # type: ignore[arg-type]
    assert link.sent[-1][0] == pytest.approx(0.9, abs=0.08)
    assert played.late_s < 0.08
    assert played.log_s == pytest.approx(0.9)


@pytest.mark.slow
def test_a_recorded_flight_streams_without_loss_at_twenty_times_its_speed(sitl_logs):
    path = sitl_logs / "onset" / "reference.tlog"
    expected = [f.data for f in log_frames(path)]
    with udp() as ear:
        target = f"udpout:127.0.0.1:{ear.getsockname()[1]}"
        process = command("stream", str(path), "--to", target, "--speed", "20")
        heard = [ear.recv(65535) for _ in expected]
        assert process.wait(timeout=120) == 0
    assert heard == expected


def test_a_looped_log_begins_again(tmp_path):
    path, frames = short_log(tmp_path / "a.tlog", 1.0)
    with udp() as ear:
        target = f"udpout:127.0.0.1:{ear.getsockname()[1]}"
        process = command("stream", str(path), "--to", target, "--speed", "20", "--loop")
        heard = [ear.recv(65535) for _ in range(2 * len(frames))]
        process.kill()
        process.wait()
    assert heard == [f.data for f in frames] * 2


def test_a_tcp_listener_is_waited_for(tmp_path):
    path, frames = short_log(tmp_path / "a.tlog", 1.0)
    transport = open_transport("tcpin:127.0.0.1:0")
    played: list[Played] = []
    thread = threading.Thread(target=lambda: played.append(play(path, transport, speed=10.0)))
    thread.start()
    time.sleep(0.3)
    assert played == []
    with socket.create_connection(transport.address) as ear:  # type: ignore[attr-defined]
        ear.settimeout(PATIENCE)
        stream = b"".join(f.data for f in frames)
        got = b""
        while len(got) < len(stream):
            got += ear.recv(65535)
    thread.join(PATIENCE)
    transport.close()
    assert got == stream


def test_stamps_that_step_back_or_pause_for_days_do_not_stop_the_music(tmp_path):
    vehicle = Vehicle()
    frames = vehicle.tick()
    vehicle.stamp_us -= 100 * SECOND
    frames += vehicle.tick()
    vehicle.stamp_us += 90_000 * SECOND
    vehicle.clock_s += 90_000.0  # that one was a pause
    frames += vehicle.tick()
    path = write_log(tmp_path / "odd.tlog", frames)
    with udp() as ear:
        transport = open_transport(f"udpout:127.0.0.1:{ear.getsockname()[1]}")
        played = play(path, transport, speed=100.0)
        transport.close()
    assert played.frames == len(frames)
    assert played.log_s == pytest.approx(60.1)


def test_damage_in_a_log_is_passed_over(tmp_path):
    path, frames = short_log(tmp_path / "a.tlog")
    data = bytearray(path.read_bytes())
    data[200:230] = bytes(30)
    path.write_bytes(data[:-5])
    found = [frame for _, frame in stamped_frames(path)]
    assert set(found) < {f.data for f in frames}
    assert len(found) >= len(frames) - 4


def test_a_file_without_frames_says_so(tmp_path):
    path = tmp_path / "empty.tlog"
    path.write_bytes(bytes(1000))
    with pytest.raises(LogError, match="no MAVLink frame"):
        list(stamped_frames(path))


@pytest.mark.parametrize(
    ("arguments", "words", "code"),
    [
        (["missing.tlog"], "missing.tlog: no such file", 1),
        (["sitl_logs/onset/reference.tlog", "--speed", "0"], "--speed 0", 2),
        (["sitl_logs/onset/reference.tlog", "--to", "nowhere"], "not a link", 1),
    ],
)
def test_the_command_tells_mistakes_in_one_line(arguments, words, code):
    program = "import sys; from thrustmargin.gcs_plugin.cli import main; main(sys.argv[1:])"
    done = subprocess.run(
        [sys.executable, "-c", program, "stream", *arguments],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )
    assert done.returncode == code
    assert words in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


@pytest.mark.parametrize("speed", [1.0, 10.0])
def test_only_a_fast_playback_says_what_it_makes_wrong(speed, tmp_path, capsys):
    path, _ = short_log(tmp_path / "a.tlog", 0.5)
    with udp() as ear:
        stream(path, to=f"udpout:127.0.0.1:{ear.getsockname()[1]}", speed=speed)
    words = " ".join(capsys.readouterr().err.split())
    assert ("the motor order are true at --speed 1 alone" in words) is (speed > 1.0)
