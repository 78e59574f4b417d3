"""Collect the monitor's newest figures as Prometheus metrics, at each request.

An unknown or old figure is left out, so that no series continues with a value of the past; the
ages show why. An alarm stays until evidence clears it, as on every other surface.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping

import numpy as np
from prometheus_client import CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from thrustmargin.gcs_plugin.live.alarms.alarm import Alarm
from thrustmargin.gcs_plugin.live.live_monitor import LiveMonitor, MonitorStatus
from thrustmargin.gcs_plugin.live.small_server import SmallServer
from thrustmargin.gcs_plugin.live.watch.update import Update
from thrustmargin.gcs_plugin.live.watch.vehicle_monitor import VehicleMonitor

#: Values of the label `level`, by MAV_SEVERITY.
LEVELS = ("emergency", "alert", "critical", "error", "warning", "notice", "info", "debug")
_ROTOR = ("vehicle", "rotor", "name", "basis")
#: Metric -> its description and its labels.
FIGURES: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "margin_ratio": ("Thrust left in the air, of one", _ROTOR),
    "margin_low_ratio": ("Low end of its 90 % interval", _ROTOR),
    "margin_high_ratio": ("High end of its 90 % interval", _ROTOR),
    "utilisation_ratio": ("Share of the rotor's maximum thrust in use", _ROTOR),
    "margin_predicted_ratio": ("Thrust left as predicted, worst rotor", ("vehicle",)),
    "redundancy_ratio": ("Worst rotor lost, yaw uncontrolled: thrust over weight", ("vehicle",)),
    "tank_kg": ("Liquid in the tank", ("vehicle",)),
    "tank_by_thrust_kg": ("Liquid in the tank as the rotors' thrust shows it", ("vehicle",)),
    "time_to_empty_seconds": ("At the present flow; +Inf: not within a flight", ("vehicle",)),
    "margin_ahead_ratio": ("Least predicted thrust left on the rest of the route", ("vehicle",)),
    "margin_full_tank_ratio": ("Predicted thrust left with a full tank", ("vehicle",)),
    "voltage_volts": ("Battery voltage", ("vehicle",)),
    "flying": ("1 off the ground", ("vehicle",)),
    "flight_level": (
        "Answer of flight or last flight: 0 damaged to 8 below limit",
        ("vehicle",),
    ),
    "next_fill_kg": ("Largest fill by that flight, at the safe end", ("vehicle",)),
    "outputs_median_ratio": ("Of an aircraft not known: its motors' outputs", ("vehicle",)),
    "outputs_most_ratio": ("The highest of them in that flight", ("vehicle",)),
    "no_verdict": ("1: the aircraft is not known, no verdict", ("vehicle",)),
}
#: Counters of the whole monitor: field of MonitorStatus -> what it counts.
COUNTS = {
    "frames": "MAVLink frames",
    "bytes": "Bytes",
    "bad_checksum": "Frames with a wrong checksum",
    "unknown": "Frames of an unknown id",
    "bytes_skipped": "Bytes of no frame",
    "refused": "Frames that are not signed as they must be",
    "kernel_drops": "Datagrams that the system dropped",
    "compute_drops": "Frames that the analysis dropped",
}
PREFIX = "thrustmargin_"
HOST = "127.0.0.1"
#: Content type of Prometheus' text format that every version reads.
TEXT = "text/plain; version=0.0.4; charset=utf-8"


class MetricsServer(SmallServer):
    """An HTTP server on this computer that answers Prometheus with a collector's metrics.

    It runs until `close`. `port` 0 takes any free port. Raises LinkError if it cannot be opened.
    """

    def __init__(self, collector: Collector, port: int) -> None:
        registry = CollectorRegistry(auto_describe=False)
        registry.register(collector)

        def answer(path: str) -> tuple[str, bytes] | None:
            return (TEXT, generate_latest(registry)) if path == "/metrics" else None

        super().__init__(answer, "--metrics", (HOST, port), for_all=False)

    @property
    def url(self) -> str:
        """Return the URL of the metrics."""
        return f"http://{HOST}:{self.port}/metrics"


class MonitorCollector(Collector):
    """The metrics of a monitor, computed at each request; usable from any thread."""

    def __init__(self, monitor: LiveMonitor) -> None:
        self._monitor = monitor

    def describe(self) -> Iterable[Metric]:
        """Return nothing: the set of metrics depends on the vehicles heard."""
        return ()

    def collect(self) -> Iterator[Metric]:
        """Yield all metrics of the monitor with their present values, for Prometheus."""
        fleet, now_us = self._monitor.fleet, self._monitor.now_us()
        watches = {str(n): w for n, w in fleet.vehicles.items() if not w.has_left(now_us)}
        yield _gauge("vehicles", "Vehicles that are heard or missed", [((), float(len(watches)))])
        limit = 1.0 - fleet.max_utilisation
        yield _gauge(
            "margin_least_ratio", "Thrust left below which an alarm is raised", [((), limit)]
        )
        yield from _age_metrics(watches, now_us)
        yield from _figure_metrics(watches, now_us, fleet.old_s)
        labels = ("vehicle", "alarm", "part", "level", "state")
        samples = [
            ((number, alarm.name, part_of(alarm), LEVELS[alarm.severity], str(alarm.state)), 1.0)
            for number, watch in watches.items()
            for alarm in list(watch.alarms.listed.values())
        ]
        yield _gauge("alarm", "1 for each alarm that stands", samples, labels)
        yield from _status_metrics(self._monitor.status())


def part_of(alarm: Alarm) -> str:
    """Return the label `part` of an alarm: `rotor 3`, `rotor 1 or 2`; empty for an alarm without a
    rotor."""
    rotors = alarm.rotors if alarm.rotor is None else (alarm.rotor,)
    return f"rotor {' or '.join(map(str, rotors))}" if rotors else ""


def _gauge(
    name: str,
    words: str,
    samples: Iterable[tuple[tuple[str, ...], float]],
    labels: tuple[str, ...] = (),
) -> GaugeMetricFamily:
    """Return a gauge called PREFIX + `name`, with `words` as its help text.

    Each sample is (values of `labels`, number); samples of NaN are left out.
    """
    family = GaugeMetricFamily(PREFIX + name, words, labels=labels)
    for values, number in samples:
        if not math.isnan(number):
            family.add_metric(values, number)
    return family


def _age_metrics(watches: Mapping[str, VehicleMonitor], now_us: int) -> Iterator[Metric]:
    """Yield one metric for each kind of age, s: of a vehicle's last message, of its newest row
    (left out before the first), and of each stale field.

    Then yield one each for the counts of missing, doubled and late frames, by vehicle and
    component. `watches` are by system id, `now_us` is the monitor's time, µs.
    """
    silent = [((n,), w.link.silent(now_us)) for n, w in watches.items()]
    yield _gauge("silence_seconds", "Since anything was heard of it", silent, ("vehicle",))
    rows = [((n,), w.last.age_s(now_us)) for n, w in watches.items() if w.last is not None]
    words = "Age of the newest figures; old ones are left out"
    yield _gauge("figures_age_seconds", words, rows, ("vehicle",))
    fields = [
        ((n, field), age) for n, w in watches.items() for field, age in w.telemetry.stale().items()
    ]
    words = "Age of a field that is no longer reported"
    yield _gauge("field_age_seconds", words, fields, ("vehicle", "field"))
    for name, words in (
        ("missing", "Frames whose numbers show that they were lost"),
        ("doubled", "Frames that came twice"),
        ("late", "Frames that newer ones overtook"),
    ):
        counted = [
            ((n, str(component)), float(getattr(sender, name)))
            for n, w in watches.items()
            for component, sender in list(w.link.senders.items())
        ]
        yield _gauge(f"link_{name}_frames", words, counted, ("vehicle", "component"))


def _figure_metrics(
    watches: Mapping[str, VehicleMonitor], now_us: int, old_s: float
) -> Iterator[Metric]:
    """Yield the metrics of the newest row (margin, tank, rotors, ...) of each vehicle.

    A vehicle is left out if its newest row is older than `old_s` s at `now_us`, µs, or if another
    vehicle has the same system id.
    """
    samples: dict[str, list[tuple[tuple[str, ...], float]]] = {name: [] for name in FIGURES}
    for number, watch in watches.items():
        update = watch.last
        if update is None or update.age_s(now_us) > old_s or watch.link.shared:
            continue
        for name, value in _vehicle_figures(update).items():
            samples[name].append(((number,), value))
        for labels, of_rotor in _rotor_figures(update):
            for name, value in of_rotor.items():
                samples[name].append(((number, *labels), value))
    for name, (words, labels) in FIGURES.items():
        yield _gauge(name, words, samples[name], labels)


def _vehicle_figures(update: Update) -> dict[str, float]:
    """Return the values of a vehicle's newest row by metric name, the unit in the name; NaN where
    unknown.

    The outputs' median and largest use are only of an aircraft without an airframe whose motor
    outputs are known.
    """
    analysis, outlook, answer = update.analysis, update.outlook, update.answer
    predicted = analysis.margin_predicted[-1]
    flying = bool(analysis.track.flying[-1])
    shown = None if answer is None else answer.contact
    if shown is not None and shown.basis != "motor outputs":
        shown = None
    return {
        "margin_predicted_ratio": float(np.min(predicted)) if predicted.size else math.nan,
        "redundancy_ratio": float(analysis.redundancy_yaw_uncontrolled[-1]),
        "tank_kg": float(analysis.track.tank_kg[-1]),
        "tank_by_thrust_kg": float(update.virtual_kg[-1]),
        "time_to_empty_seconds": outlook.seconds_to_empty,
        "margin_ahead_ratio": outlook.margin_ahead,
        "margin_full_tank_ratio": outlook.margin_full,
        "voltage_volts": float(analysis.track.voltage[-1]),
        "flying": float(flying),
        "flight_level": math.nan if answer is None else answer.gravity,
        "next_fill_kg": math.nan if answer is None else answer.fill_kg,
        "outputs_median_ratio": math.nan if shown is None else shown.median_use,
        "outputs_most_ratio": math.nan if shown is None else shown.worst_use,
        "no_verdict": float(bool(analysis.no_verdict)),
    }


def _rotor_figures(update: Update) -> Iterator[tuple[tuple[str, str, str], dict[str, float]]]:
    """Yield, for each rotor, ((number from 1, place, source of its speed), values by metric name).

    The values are of the newest row. Yield nothing on the ground or without a verdict.
    """
    analysis = update.analysis
    names = analysis.places
    if analysis.no_verdict or not analysis.track.flying[-1]:
        return
    figures = (analysis.known_utilisation, *analysis.use_ends)
    for rotor, (use, low, high) in enumerate(zip(*(f[-1].tolist() for f in figures), strict=True)):
        yield (
            (str(rotor + 1), names[rotor], str(analysis.basis_of(-1, rotor))),
            {
                "utilisation_ratio": use,
                "margin_ratio": 1.0 - use,
                "margin_low_ratio": 1.0 - high,
                "margin_high_ratio": 1.0 - low,
            },
        )


def _status_metrics(status: MonitorStatus) -> Iterator[Metric]:
    """Yield the metrics of the whole monitor: counts of frames, delay of the analysis, and
    recording.

    Metrics of the recording are missing if nothing is recorded.
    """
    for name, words in COUNTS.items():
        yield CounterMetricFamily(f"{PREFIX}link_{name}", words, value=getattr(status, name))
    yield _gauge("behind_seconds", "By which the analysis is late", [((), status.behind_s)])
    recorder = status.recorder
    if recorder is not None:
        working = float(not recorder.trouble)
        yield _gauge("recording", "1: what is heard is recorded", [((), working)])
        lost = float(recorder.frames_lost)
        yield CounterMetricFamily(f"{PREFIX}recording_lost_frames", "Not recorded", value=lost)
