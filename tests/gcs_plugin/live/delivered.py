"""One stream of messages as it may reach a listener: smoothly, in bursts, or on a slow computer."""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from thrustmargin.gcs_plugin.live.alarms.alarm import AlarmEvent
from thrustmargin.gcs_plugin.live.link_vehicles import Fleet
from thrustmargin.gcs_plugin.live.watch.update import WatchSettings
from thrustmargin.gcs_plugin.mavlink.frame import Frame
from thrustmargin.models.model.rotor_model import RotorModel

ROUND_S = 0.25  # s between two looks at what came
ESC_IDS = (11030, 11031, 11032, 291)  # ESC_TELEMETRY_1_TO_4 and on, ESC_STATUS


@dataclass(frozen=True, slots=True, kw_only=True)
class Delivery:
    """How a stream arrives: in bursts every `burst_s` of the ground's clock (0: as it was sent),
    and analysed only every `analysed_s`, though every round takes what came and checks the link."""

    burst_s: float = 0.0
    analysed_s: float = 0.0


SMOOTH = Delivery()
DELIVERIES = {
    "bursts": Delivery(burst_s=1.7),
    "slow": Delivery(analysed_s=6.3),
    "bursts on a slow computer": Delivery(burst_s=1.1, analysed_s=4.1),
}


def at_esc_rate(frames: Sequence[Frame], rate_hz: float) -> Iterator[Frame]:
    """Yield the frames with ESC telemetry thinned to at most `rate_hz` of each message."""
    due: dict[tuple[int, int], float] = {}
    for frame in frames:
        if frame.id in ESC_IDS:
            key = frame.system, frame.id
            if frame.stamp_us * 1e-6 < due.get(key, 0.0) - 0.02:
                continue
            due[key] = max(due.get(key, 0.0), frame.stamp_us * 1e-6 - 0.02) + 1.0 / rate_hz
        yield frame


def events_of(
    frames: Sequence[Frame],
    model: RotorModel,
    delivery: Delivery = SMOOTH,
    settings: WatchSettings | None = None,
) -> list[tuple[int, AlarmEvent]]:
    """Return every event of a stream that is delivered so, with the vehicle's id."""
    fleet = Fleet(model, settings)
    events: list[tuple[int, AlarmEvent]] = []
    waiting = deque(_arriving(frames, delivery.burst_s))
    now_us = waiting[0].stamp_us
    analysed_us = now_us
    while waiting:
        now_us += round(ROUND_S * 1e6)
        came = []
        while waiting and waiting[0].stamp_us <= now_us:
            came.append(waiting.popleft())
        fleet.take(came)
        if now_us - analysed_us >= delivery.analysed_s * 1e6:
            analysed_us = now_us
            events += [(u.vehicle, e) for u in fleet.updates() for e in u.events]
        events += fleet.tick(now_us)
    events += [(u.vehicle, e) for u in fleet.updates() for e in u.events]
    events += fleet.tick(now_us)
    return events + [(u.vehicle, e) for u in fleet.finish() for e in u.events]


def _arriving(frames: Sequence[Frame], burst_s: float) -> Iterator[Frame]:
    for frame in frames:
        if not burst_s:
            yield frame
            continue
        burst_us = round(burst_s * 1e6)
        yield frame._replace(stamp_us=-(-frame.stamp_us // burst_us) * burst_us)


def told(events: Sequence[tuple[int, AlarmEvent]]) -> list[tuple[int, str, str, int | None, float]]:
    """Return vehicle, what happened, alarm, rotor and the vehicle's clock of each event."""
    return [(n, e.kind, e.alarm.name, e.alarm.rotor, round(e.time_s, 3)) for n, e in events]
