"""A vehicle of MAVSDK's own: keeps the mission that is uploaded to it, serves it, reports home.

Usage: mission_server.py PORT SYSTEM_ID [HOME: latitude,longitude,altitude]; says "ready" when up.
"""

import sys
import threading

from mavsdk import Configuration, Mavsdk
from mavsdk.plugins.mission_raw_server import MissionRawServer
from mavsdk.plugins.telemetry_server import Position, TelemetryServer


def main() -> None:
    port, system_id = sys.argv[1:3]
    mavsdk = Mavsdk(Configuration.create_manual(int(system_id), 1, True))
    mavsdk.add_any_connection(f"udpout://127.0.0.1:{port}")
    component = mavsdk.server_component_by_id(1)
    server = MissionRawServer(component)
    server.subscribe_incoming_mission(
        lambda result, plan, _: print(result.name, len(plan.mission_items), flush=True)
    )
    ended = threading.Event()
    home = [float(v) for v in sys.argv[3].split(",")] if len(sys.argv) > 3 else []
    telemetry = TelemetryServer(component)

    def report() -> None:
        while not ended.wait(0.5) and home:
            # MAVSDK 4.1 sends the altitude times 1e-3 where HOME_POSITION has it in mm.
            telemetry.publish_home(Position(home[0], home[1], home[2] * 1e6, 0.0))

    reporter = threading.Thread(target=report)
    reporter.start()
    print("ready", flush=True)
    sys.stdin.read()  # until the test closes it
    ended.set()
    reporter.join()
    mavsdk.destroy()


main()
