"""How the live monitor bears its load: many vehicles, memory over hours, and latency.

Load and memory are of `thrustmargin monitor` in a process of its own, fed over loopback UDP by
another; processor time is that of its process. Latency is measured on one computer's clock, with
Chromium headless and without a graphics card. False alarms: bench_alarms.py.
"""

import os
import resource
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tests.gcs_plugin.live.live_vehicle import ROOT, Vehicle
from tests.gcs_plugin.peers.ports import free_port, free_udp_port
from thrustmargin.gcs_plugin.live.live_monitor import LiveMonitor, MonitorSettings
from thrustmargin.gcs_plugin.live.output import Output
from thrustmargin.gcs_plugin.mavlink.scan import stamped_frames
from thrustmargin.models.model.model_file import shipped_model

SENDER = Path(__file__).with_name("many_vehicles.py")
BARE = SENDER.with_name("bare_pymavlink.py")
RUN = "import sys; from thrustmargin.gcs_plugin.cli import main; main(sys.argv[1:])"
SPEED = os.environ.get("THRUSTMARGIN_MEMORY_SPEED", "60")  # s of flight a second


class Kept(Output):
    """A subscriber that notes when each row was there, by the vehicle's clock."""

    def __init__(self) -> None:
        self.arrived: dict[float, float] = {}

    def on_update(self, update) -> None:
        now = time.monotonic()
        for row in range(update.first, update.clock_s.size):
            self.arrived[round(float(update.clock_s[row]), 3)] = now


def monitor_process(port: int, folder: Path, *shown: str) -> subprocess.Popen:
    command = ["monitor", f"udpin:127.0.0.1:{port}", "--record", str(folder)]
    command += shown or ["--no-view"]
    process = subprocess.Popen(
        [sys.executable, "-c", RUN, *command],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    )
    while not list(folder.glob("*/telemetry.tlog")):
        assert process.poll() is None, process.stderr and process.stderr.read()
        time.sleep(0.05)
    return process


def used(pid: int) -> tuple[float, float]:
    """Processor seconds and MB resident of a process (Linux)."""
    stat = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    ticks = os.sysconf("SC_CLK_TCK")
    return (int(stat[11]) + int(stat[12])) / ticks, int(stat[21]) * resource.getpagesize() * 1e-6


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_fifty_vehicles_at_fifty_messages_a_second(benchmark, sitl_logs, tmp_path):
    seconds = float(os.environ.get("THRUSTMARGIN_LOAD_SECONDS", "20"))
    log = sitl_logs / "campaign" / "v4_m16_q2.5.tlog"
    told = {}

    def measure() -> None:
        port = free_udp_port()
        process = monitor_process(port, tmp_path)
        before, _ = used(process.pid)
        arguments = [str(v) for v in (log, port, 50, 50, seconds, 45)]
        sender = subprocess.run(
            [sys.executable, str(SENDER), *arguments],
            capture_output=True,
            text=True,
            check=True,
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
        )
        after, memory = used(process.pid)
        time.sleep(3.0)
        process.send_signal(signal.SIGINT)
        _, words = process.communicate(timeout=60)
        sent, late = sender.stdout.split()
        (session,) = tmp_path.iterdir()
        kept = sum(1 for _ in stamped_frames(session / "telemetry.tlog"))
        told.update(sent=int(sent), late=late, kept=kept, cpu=(after - before) / seconds)
        told.update(memory=memory, words=words.strip().splitlines()[-3:])

    benchmark.pedantic(measure, rounds=1)
    print(
        f"\n50 vehicles x 50 messages/s for {seconds:.0f} s: {told['sent']} sent, "
        f"{told['kept']} in the recording, {told['sent'] - told['kept']} lost; "
        f"{told['cpu']:.1%} of a core, {told['memory']:.0f} MB; the sender was up to "
        f"{told['late']} s late"
    )
    print(*told["words"], sep="\n")
    benchmark.extra_info.update(told)


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize(("vehicles", "view"), [(1, False), (20, False), (20, True)])
def test_beside_a_bare_pymavlink_loop(benchmark, sitl_logs, tmp_path, vehicles, view):
    """Both hear the same vehicles x 48 messages/s at the same time, each on its own port.

    The view is served, and drawn for whoever opens it.
    """
    shown = ["--port", str(free_port()), "--no-browser"] if view else []
    seconds = float(os.environ.get("THRUSTMARGIN_LOAD_SECONDS", "20"))
    log = sitl_logs / "campaign" / "v4_m16_q2.5.tlog"
    environment = {
        **os.environ,
        "PYTHONPATH": f"{ROOT}{os.pathsep}{os.environ.get('PYTHONPATH', '')}",
    }
    told = {}

    def measure() -> None:
        port, bare_port = free_udp_port(), free_udp_port()
        process = monitor_process(port, tmp_path, *shown)
        bare = subprocess.Popen(
            [sys.executable, str(BARE), str(bare_port), str(seconds + 12)],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert bare.stdout is not None
        bare.stdout.readline()
        before, _ = used(process.pid)
        words = [str(v) for v in (vehicles, 48, seconds, 45)]
        senders = [
            subprocess.Popen(
                [sys.executable, str(SENDER), str(log), str(target), *words],
                stdout=subprocess.PIPE,
                text=True,
                cwd=ROOT,
                env=environment,
            )
            for target in (port, bare_port)
        ]
        sent = [int(sender.communicate()[0].split()[0]) for sender in senders]
        after, memory = used(process.pid)
        heard, processor = bare.communicate()[0].split()
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)
        (session,) = tmp_path.iterdir()
        kept = sum(1 for _ in stamped_frames(session / "telemetry.tlog"))
        told.update(monitor=(after - before) / seconds, bare=float(processor) / seconds)
        told.update(lost=sent[0] - kept, bare_lost=sent[1] - int(heard), memory=memory)

    benchmark.pedantic(measure, rounds=1)
    print(
        f"\n{vehicles} vehicles x 48 messages/s{' and their view' * view}: monitor "
        f"{told['monitor']:.1%} of a core, {told['memory']:.0f} MB, {told['lost']} lost; a bare "
        f"pymavlink loop beside it {told['bare']:.1%}, {told['bare_lost']} lost: "
        f"{told['monitor'] / told['bare']:.1f} x"
    )
    benchmark.extra_info.update(told)


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_memory_over_hours_of_flight_at_many_times_speed(benchmark, sitl_logs, tmp_path):
    seconds = float(os.environ.get("THRUSTMARGIN_MEMORY_SECONDS", "40"))
    log = sitl_logs / "campaign" / "v4_m16_q2.5.tlog"
    memory: list[tuple[float, float]] = []

    def measure() -> None:
        port = free_udp_port()
        process = monitor_process(port, tmp_path)
        target = f"udpout:127.0.0.1:{port}"
        stream = subprocess.Popen(
            [
                sys.executable,
                "-c",
                RUN,
                "stream",
                str(log),
                "--to",
                target,
                "--speed",
                SPEED,
                "--loop",
            ],
            cwd=ROOT,
            stderr=subprocess.DEVNULL,
        )
        began = time.monotonic()
        while (now := time.monotonic() - began) < seconds:
            memory.append((now, used(process.pid)[1]))
            time.sleep(1.0)
        stream.kill()
        stream.wait()
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)

    benchmark.pedantic(measure, rounds=1)
    third = len(memory) // 3
    early = np.mean([mb for _, mb in memory[third : 2 * third]])
    late = np.mean([mb for _, mb in memory[-third:]])
    hours = seconds * float(SPEED) / 3600
    print(
        f"\n{hours:.1f} h of flight at {SPEED} times its speed: {memory[0][1]:.0f} MB at the "
        f"start, {early:.0f} MB in the middle third, {late:.0f} MB in the last third"
    )


def test_from_the_byte_on_the_socket_to_the_analysed_row(benchmark):
    kept = Kept()
    monitor = LiveMonitor(
        shipped_model(), MonitorSettings(urls=("udpin:127.0.0.1:0",)), outputs=[kept]
    )
    monitor.start()
    address = monitor.listener.links[0].transport.address  # type: ignore[attr-defined]
    vehicle, sent = Vehicle(), {}
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def measure() -> None:
        for _ in range(200):
            frames = vehicle.tick()
            for frame in frames:
                if frame.id == 11030:
                    sent[round(vehicle.clock_s, 3)] = time.monotonic()
                out.sendto(frame.data, address)
            time.sleep(0.1)

    benchmark.pedantic(measure, rounds=1)
    time.sleep(0.5)
    monitor.close()
    # A busy computer stamps late, and the vehicle's clock is then a little off its own.
    clocks = np.array(list(kept.arrived))
    near = {clock: float(clocks[np.argmin(np.abs(clocks - clock))]) for clock in sent}
    delays = [
        1e3 * (kept.arrived[near[c]] - at) for c, at in sent.items() if abs(near[c] - c) < 0.05
    ]
    print(
        f"\nfrom the byte on the socket to the analysed row: {np.median(delays):.0f} ms (median), "
        f"{np.quantile(delays, 0.95):.0f} ms (95 %), {len(delays)} of {len(sent)} rows"
    )


WATCH = """() => {
  window.seen = [];
  let last = '';
  const look = () => {
    const colour = document.querySelector('[data-rotor="1"]')?.getAttribute('fill') ?? last;
    if (colour !== last) { last = colour; window.seen.push(Date.now()); }
  };
  new MutationObserver(look).observe(document.body, {subtree: true, childList: true,
    attributes: true, characterData: true});
}"""


def test_from_the_byte_on_the_socket_to_the_colour_in_the_browser(benchmark):
    """The rotor speeds step across the 50 % limit; the page notes when its gauge changes colour."""
    from tests.browser import open_page
    from thrustmargin.gcs_plugin.view.live_view import LiveView

    model = shipped_model()
    monitor = LiveMonitor(model, MonitorSettings(urls=("udpin:127.0.0.1:0",)))
    view = LiveView(model.airframe, port=0)
    monitor.outputs.append(view)
    monitor.start()
    address = monitor.listener.links[0].transport.address  # type: ignore[attr-defined]
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    vehicle, sent = Vehicle(), []
    seen: list[float] = []

    def measure() -> None:
        with open_page(view.url) as page:
            for turn in range(430):
                if turn == 30:
                    page.evaluate(WATCH)
                rpm = 1700 if (turn // 10) % 2 else 2300
                for frame in vehicle.tick(rpm=(rpm,) * 4):
                    if frame.id == 11030 and turn % 10 == 0 and turn > 30:
                        sent.append(time.time() * 1e3)
                    out.sendto(frame.data, address)
                time.sleep(0.1)
            seen.extend(page.evaluate("window.seen"))

    benchmark.pedantic(measure, rounds=1)
    monitor.close()
    delays = []
    for at in sent:
        after = [s - at for s in seen if 0 <= s - at < 1000]
        delays += after[:1]
    print(
        f"\nfrom the socket to the changed colour: {np.median(delays):.0f} ms (median), "
        f"{np.quantile(delays, 0.95):.0f} ms (95 %), {len(delays)} of {len(sent)} changes seen; "
        f"drawing takes {1e3 * np.median(view.draw_seconds):.1f} ms"
    )
