"""A bare pymavlink loop: hears a port for so many s and prints messages and processor seconds."""

import os
import sys
import time

os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil


def main(port: str, seconds: float) -> None:
    link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", dialect="ardupilotmega")
    print("ready", flush=True)
    end, heard, began = time.monotonic() + seconds, 0, 0.0
    while time.monotonic() < end:
        message = link.recv_match(blocking=True, timeout=0.5)
        if message is not None and message.get_type() != "BAD_DATA":
            heard += 1
            began = began or time.process_time()
    print(heard, time.process_time() - began, flush=True)


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]))
