"""Many vehicles on one loopback port: a recorded flight under many system ids.

Arguments: log, port, vehicles, messages a second of each, seconds, first second of the log. Prints
how many messages it sent and how late the latest was.
"""

import socket
import sys
import time
from pathlib import Path

from fastcrc import crc16

from thrustmargin.gcs_plugin.mavlink.layouts import layouts
from thrustmargin.gcs_plugin.mavlink.scan import stamped_frames


def renumbered(frame: bytes, system: int, sequence: int) -> bytes:
    """The same message of another vehicle."""
    body = frame[1:4] + bytes([sequence % 256, system]) + frame[6 : 10 + frame[1]]
    extra = bytes([layouts()[int.from_bytes(frame[7:10], "little")].crc_extra])
    check = crc16.mcrf4xx(extra, crc16.mcrf4xx(body))
    return frame[:1] + body + check.to_bytes(2, "little")


def main(log: Path, port: int, vehicles: int, rate: float, seconds: float, skip: float) -> None:
    read = [(stamp, data) for stamp, data in stamped_frames(log) if data[5] == 1]
    start = read[0][0] + skip * 1e6
    flown = [data for stamp, data in read if stamp >= start][: round(rate * seconds)]
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    out.connect(("127.0.0.1", port))
    began, late, sent = time.monotonic(), 0.0, 0
    for number, data in enumerate(flown):
        ahead = began + number / rate - time.monotonic()
        if ahead > 0.0:
            time.sleep(ahead)
        late = max(late, -ahead)
        for system in range(1, vehicles + 1):
            out.send(renumbered(data, system, number))
            sent += 1
    print(sent, round(late, 3), flush=True)


if __name__ == "__main__":
    main(
        Path(sys.argv[1]),
        int(sys.argv[2]),
        int(sys.argv[3]),
        *(float(argument) for argument in sys.argv[4:7]),
    )
