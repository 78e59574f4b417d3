"""Read what PX4 reports of failures in topics of a ULog: its failure detector and its ESCs.

`failure_detector_status` has flags (fd_motor, fd_imbalanced_prop and others), a mask of motors and
a metric of the imbalance of propellers; `esc_status` has failure flags of each ESC. Source: PX4
msg/FailureDetectorStatus.msg and msg/EscReport.msg.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from thrustmargin.gcs_plugin.logs.ulog_topics import MOST_MOTORS, MOTOR_1, Topic
from thrustmargin.gcs_plugin.telemetry.vehicle_events import EventKind, VehicleEvent, flag_events
from thrustmargin.models.flight import Floats

DETECTOR = "failure_detector_status"
#: Flag of the failure detector -> kind of the report and its subject.
_FLAGS: Mapping[str, tuple[EventKind, str]] = {
    "fd_roll": (EventKind.ATTITUDE_FAILURE, "roll"),
    "fd_pitch": (EventKind.ATTITUDE_FAILURE, "pitch"),
    "fd_alt": (EventKind.ATTITUDE_FAILURE, "altitude"),
    "fd_arm_escs": (EventKind.ESC_FAILURE, "arming"),
    "fd_battery": (EventKind.BATTERY, "battery"),
    "fd_motor": (EventKind.MOTOR_FAILURE, ""),
}


def px4_failure_events(topics: Mapping[str, Sequence[Topic]]) -> tuple[VehicleEvent, ...]:
    """Return the failures that PX4 reports, sorted by time: one for each time a flag is set.

    Motors in the subject count from 1. Where a mask of motors is logged, it replaces the flag
    `fd_motor`.
    """
    made = [event for topic in topics.get(DETECTOR, ())[:1] for event in _detected(topic)]
    made += [event for topic in topics.get("esc_status", ())[:1] for event in _of_escs(topic)]
    return tuple(sorted(made, key=lambda event: event.time_s))


def _detected(topic: Topic) -> Iterator[VehicleEvent]:
    """Yield the events of PX4's failure detector, one each time a flag is set.

    A mask of motors, if it ever has a bit, replaces the flag `fd_motor`.
    """
    time_s = _column(topic, "timestamp") * 1e-6
    mask = topic.get("motor_failure_mask")
    masked = mask is not None and bool(np.any(mask != 0))
    for name, (kind, subject) in _FLAGS.items():
        if name in topic and not (name == "fd_motor" and masked):
            yield from flag_events(
                kind, time_s, _column(topic, name), subject, f"{DETECTOR} {name}"
            )
    if masked:
        bits = _column(topic, "motor_failure_mask").astype(np.int64)
        for motor in range(MOST_MOTORS):
            failed = ((bits >> motor) & 1).astype(np.float64)
            text = f"{DETECTOR} motor_failure_mask"
            yield from flag_events(EventKind.MOTOR_FAILURE, time_s, failed, str(motor + 1), text)
    if "fd_imbalanced_prop" in topic:
        flag = _column(topic, "fd_imbalanced_prop")
        metric = topic.get("imbalanced_prop_metric")
        for event in flag_events(EventKind.IMBALANCE, time_s, flag, "", ""):
            row = int(np.searchsorted(time_s, event.time_s))
            shown = "" if metric is None else f", imbalanced_prop_metric {float(metric[row]):.2g}"
            yield VehicleEvent(
                event.kind, event.time_s, "", f"{DETECTOR} fd_imbalanced_prop{shown}"
            )


def _of_escs(topic: Topic) -> Iterator[VehicleEvent]:
    """Yield the events of the ESCs' own failure flags, by motor."""
    time_s = _column(topic, "timestamp") * 1e-6
    functions = [topic.get(f"esc[{k}].actuator_function", np.zeros(1)) for k in range(MOST_MOTORS)]
    named = any(np.any(function >= MOTOR_1) for function in functions)
    for place, function in enumerate(functions):
        name = f"esc[{place}].failures"
        motor = int(function[-1]) - MOTOR_1 if named else place
        if name in topic and 0 <= motor < MOST_MOTORS:
            text = "esc_status failures"
            flags = _column(topic, name)
            yield from flag_events(EventKind.ESC_FAILURE, time_s, flags, str(motor + 1), text)


def _column(topic: Topic, name: str) -> Floats:
    """Return a column of a topic as numbers."""
    return np.asarray(topic[name], dtype=np.float64)
