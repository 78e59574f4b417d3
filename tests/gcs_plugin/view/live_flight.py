"""A monitor with its view, fed over loopback by vehicles that fly in real time."""

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from tests.gcs_plugin.live.live_vehicle import Vehicle
from thrustmargin.gcs_plugin.live.console import status_lines
from thrustmargin.gcs_plugin.live.live_monitor import LiveMonitor, MonitorSettings
from thrustmargin.gcs_plugin.view.live_view import LiveView
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

AIRFRAME = load_airframe("topxgun-f16-sitl")


class Live:
    """A monitor with its view, and vehicles that fly in real time."""

    def __init__(self) -> None:
        settings = MonitorSettings(urls=("udpin:127.0.0.1:0",))
        self.monitor = LiveMonitor(physics_model(AIRFRAME), settings)
        self.view = LiveView(
            AIRFRAME,
            port=0,
            status=lambda: status_lines(self.monitor.status()),
            clock=self.monitor.now_us,
        )
        self.monitor.outputs.append(self.view)
        self.monitor.start()
        self.address = self.monitor.listener.links[0].transport.address  # type: ignore[attr-defined]
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def fly(self, seconds: float, *vehicles: Vehicle, rpm: int = 1700) -> None:
        for _ in range(round(seconds * 10)):
            for vehicle in vehicles:
                for frame in vehicle.tick(rpm=(rpm, rpm, rpm, rpm)):
                    self.socket.sendto(frame.data, self.address)
            time.sleep(0.1)

    @contextmanager
    def flown(self, *vehicles: Vehicle) -> Iterator["Throttle"]:
        """The vehicles fly on, however long the caller looks at the page, as the throttle says."""
        throttle, ended = Throttle(), threading.Event()

        def fly() -> None:
            while not ended.is_set():
                if throttle.rpm is None:
                    time.sleep(0.1)
                else:
                    self.fly(0.1, *vehicles, rpm=throttle.rpm)

        thread = threading.Thread(target=fly, daemon=True)
        thread.start()
        try:
            yield throttle
        finally:
            ended.set()
            thread.join()


class Throttle:
    """Rotor speed at which vehicles fly; None: they are silent."""

    rpm: int | None = 1700


@contextmanager
def flying() -> Iterator[Live]:
    live = Live()
    try:
        yield live
    finally:
        live.monitor.close()
        live.view.stop()
        live.socket.close()
    live.monitor.check()
