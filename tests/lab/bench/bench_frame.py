"""What one frame of a live link costs, beside pymavlink's parser on the same bytes.

Frames of a recorded flight, each a datagram. Ours: cut, checksum tried and fields at hand; then the
whole way to analysed rows and alarms, in a round a second, as a monitor makes of many vehicles.
pymavlink: `parse_buffer`, which makes a message of each. Times are of the processor.
"""

import time
from collections.abc import Callable

from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.gcs_plugin.mavlink.frame import FrameSplitter, fields
from thrustmargin.gcs_plugin.mavlink.scan import stamped_frames
from thrustmargin.models.model.model_file import shipped_model

ROUND_US = 1_000_000


def _microseconds(work: Callable[[], object], frames: int) -> float:
    begin = time.process_time()
    work()
    return (time.process_time() - begin) / frames * 1e6


def test_a_live_frame(benchmark, sitl_logs):
    from pymavlink.dialects.v20 import ardupilotmega

    log = sitl_logs / "campaign" / "v4_m16_q2.5.tlog"
    stamped = list(stamped_frames(log))

    def decoded() -> None:
        splitter = FrameSplitter()
        for _, data in stamped:
            for frame in splitter.feed_datagram(data, 0):
                fields(frame)

    def analysed() -> None:
        splitter, fleet, due = FrameSplitter(), Fleet(shipped_model()), 0
        for stamp_us, data in stamped:
            fleet.take(splitter.feed_datagram(data, stamp_us))
            if stamp_us >= due:
                due = stamp_us + ROUND_US
                fleet.updates()
        fleet.finish()

    def parsed() -> None:
        parser = ardupilotmega.MAVLink(None)
        for _, data in stamped:
            parser.parse_buffer(data)

    for work in (decoded, parsed):
        work()
    theirs = _microseconds(parsed, len(stamped))
    cut = _microseconds(decoded, len(stamped))
    whole: list[float] = []
    benchmark.pedantic(lambda: whole.append(_microseconds(analysed, len(stamped))), rounds=1)
    print(
        f"\nlive frame: decoded in {cut:.1f} us, pymavlink's parser {theirs:.1f} us: "
        f"{cut / theirs:.2f} x; to analysed rows and alarms {whole[0]:.0f} us"
    )
