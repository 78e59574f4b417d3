"""A vehicle that speaks the mission and log protocols byte by byte, with faults on request.

MAVSDK has no server for logs, and its mission server is no ArduPilot. Reads its orders as JSON from
the first line of standard input, says "ready", and runs until standard input is closed:
  port, system_id, autopilot (MAV_AUTOPILOT), items (rows of MISSION_ITEM_INT),
  claims (number of items that it says it has), home (degE7, degE7, mm),
  logs {number: [unix seconds, file]}, drop (one LOG_DATA in so many is lost, the first time),
  silent_after (LOG_DATA sent before it falls silent), mute (heartbeats only),
  key (hex: it signs, and hears only what is signed), overstate (bytes that its list of logs adds
  to every size), parameters (rows of name, value, MAV_PARAM_TYPE), lose_parameters (indices that
  are lost the first time),
  heartbeat (s between two), chatter (other messages all the time).
Each further line of JSON replaces the orders that it names.
"""

import json
import os
import struct
import sys
import threading
import time
from pathlib import Path

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil

CHUNK = 90


#: MAV_PARAM_TYPE of whole numbers -> how PX4 puts them into the bytes of a float.
WHOLE = {1: "<B", 2: "<b", 3: "<H", 4: "<h", 5: "<I", 6: "<i"}


class Vehicle:
    def __init__(self, orders: dict) -> None:
        self.orders = orders
        self.link = mavutil.mavlink_connection(
            f"udpout:127.0.0.1:{orders['port']}",
            source_system=orders.get("system_id", 1),
            source_component=1,
        )
        if "key" in orders:
            self.link.setup_signing(bytes.fromhex(orders["key"]))
        self.logs = {
            int(n): (t, Path(f).read_bytes()) for n, (t, f) in orders.get("logs", {}).items()
        }
        self.sent = 0
        self.dropped: set[tuple[int, int]] = set()
        self.last_heartbeat = self.last_current = 0.0

    def run(self) -> None:
        while True:
            if time.monotonic() - self.last_heartbeat > self.orders.get("heartbeat", 0.1):
                self.last_heartbeat = time.monotonic()
                self.link.mav.heartbeat_send(2, self.orders.get("autopilot", 3), 81, 0, 3)
            if "chatter" in self.orders:
                self.link.mav.vfr_hud_send(0, 0, 0, 0, 0, 0)
            if "items" in self.orders and time.monotonic() - self.last_current > 0.5:
                self.last_current = time.monotonic()
                self.link.mav.mission_current_send(0, self.items_in_all())
            message = self.link.recv_match(blocking=True, timeout=0.02)
            mine = getattr(message, "target_system", 0) in (0, self.orders.get("system_id", 1))
            if message is not None and mine and not self.orders.get("mute"):
                answer = getattr(self, message.get_type().lower(), None)
                if answer is not None:
                    answer(message)

    def items_in_all(self) -> int:
        """As MISSION_CURRENT counts: without home, 65535 for none."""
        return max(len(self.orders["items"]) - 1, 0) or 65535

    def command_long(self, message) -> None:
        home = self.orders.get("home")
        if message.command == 512 and message.param1 == 242 and home:
            self.link.mav.home_position_send(*home, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)

    def mission_request_list(self, message) -> None:
        self.link.mav.mission_count_send(
            message.get_srcSystem(),
            message.get_srcComponent(),
            self.orders.get("claims", len(self.orders.get("items", []))),
        )

    def mission_request_int(self, message) -> None:
        self.link.mav.mission_item_int_send(
            message.get_srcSystem(),
            message.get_srcComponent(),
            message.seq,
            *self.orders["items"][message.seq % len(self.orders["items"])],
        )

    def param_request_list(self, _) -> None:
        for index in range(len(self.orders.get("parameters", []))):
            if index not in self.orders.get("lose_parameters", []):
                self.send_parameter(index)

    def param_request_read(self, message) -> None:
        self.send_parameter(message.param_index)

    def send_parameter(self, index: int) -> None:
        name, value, kind = self.orders["parameters"][index]
        if self.orders.get("autopilot", 3) == 12 and kind in WHOLE:
            value = struct.unpack("<f", struct.pack(WHOLE[kind], value).ljust(4, b"\0"))[0]
        count = len(self.orders["parameters"])
        self.link.mav.param_value_send(name.encode(), value, kind, count, index)

    def log_request_list(self, message) -> None:
        for number, (unix, data) in self.logs.items():
            if message.start <= number <= message.end:
                self.link.mav.log_entry_send(
                    number,
                    len(self.logs),
                    max(self.logs),
                    unix,
                    len(data) + self.orders.get("overstate", 0),
                )
        if not self.logs:
            self.link.mav.log_entry_send(0, 0, 0, 0, 0)

    def log_request_data(self, message) -> None:
        data = self.logs[message.id][1]
        for offset in range(message.ofs, min(message.ofs + message.count, len(data)), CHUNK):
            place = (message.id, offset)
            self.sent += 1
            if self.sent > self.orders.get("silent_after", 1e18):
                return
            drop = self.orders.get("drop")
            if drop and self.sent % drop == 0 and place not in self.dropped:
                self.dropped.add(place)
                continue
            chunk = data[offset : offset + CHUNK]
            self.link.mav.log_data_send(
                message.id, offset, len(chunk), [*chunk.ljust(CHUNK, b"\0")]
            )


def main() -> None:
    orders = json.loads(sys.stdin.readline())
    threading.Thread(target=Vehicle(orders).run, daemon=True).start()
    print("ready", flush=True)
    for line in sys.stdin:
        orders.update(json.loads(line))


main()
