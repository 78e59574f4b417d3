"""Map PX4 topics to channels, and their motor outputs and ESCs to motors.

A table covers most channels; those that need more than scaling have functions. `actuator_motors`
(PX4 1.13 and later) is numbered by motor. Earlier logs have only `actuator_outputs` with the values
sent to the ESCs: one instance for each driver, some without any motor; pulses, DShot's 1 to 1999 or
UAVCAN's 1 to 8191. PX4: src/lib/mixer_module, src/drivers/dshot, src/drivers/uavcan.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from thrustmargin.gcs_plugin.mavlink.decode import attitude_from_quaternion, commanded_by_quaternion
from thrustmargin.gcs_plugin.mavlink.rules import Columns, Rule, Signal, in_si, quantity
from thrustmargin.gcs_plugin.telemetry.settings.pulse_range import (
    ranges_of_span,
    ranges_remark,
    span_of,
    whole_number,
)
from thrustmargin.gcs_plugin.telemetry.signals import Signals, in_time_order, signals_by_channel
from thrustmargin.models.flight import Floats
from thrustmargin.models.provenance import Meaning, Provenance, SourceKind
from thrustmargin.models.statement import Statement, state

#: PX4's output function of motor 1; motors 2 to 12 follow.
MOTOR_1 = 101
MOST_MOTORS = 12
_MOST_OUTPUTS = 16
_STEPS = 8  # an output with more values than these is driven: a servo is off, idle, at its ends
_FEWEST = 3  # motors of a multirotor
#: Motors, from 0, on outputs 1 to 4 where MOT_ORDERING is 1 (Betaflight).
_BETAFLIGHT = (3, 0, 1, 2)


@dataclass(frozen=True, slots=True, kw_only=True)
class UlogMotors:
    """The signals `throttle` and `esc_*` by motor from 0, and notes on them."""

    signals: list[Signal] = field(default_factory=list)
    notes: list[Statement] = field(default_factory=list)
    motor_order: Statement | None = None
    esc_order: Statement | None = None
    unused: dict[str, Statement] = field(
        default_factory=dict
    )  # channel -> what is there, and why not


def ulog_motors(topics: Mapping[str, list[Topic]], parameters: Mapping[str, float]) -> UlogMotors:
    """Return the signals of motor outputs and ESCs, numbered by motor from 0, with notes on them.

    `topics` maps a topic's name to its instances, in order. Of `actuator_motors` and `esc_status`
    only the first instance is used. Without outputs in `actuator_motors` they are those of
    `actuator_outputs`; without either there are none.
    """
    motors = UlogMotors(motor_order=state("by actuator functions"))
    for topic in topics.get("actuator_motors", [])[:1]:
        motors = _throttle(topic, motors)
    if not motors.signals and "actuator_outputs" in topics:
        motors = _outputs(topics["actuator_outputs"], parameters)
    for topic in topics.get("esc_status", [])[:1]:
        motors = _with_escs(motors, topic)
    return motors


def _throttle(topic: Topic, so_far: UlogMotors) -> UlogMotors:
    if "control" not in topic:
        return so_far
    commanded = in_si(topic, "control", "1")
    duty = np.clip(commanded, 0.0, 1.0)
    source = topic_source("actuator_motors", "control", meaning=Meaning.THRUST_DEMAND)
    motors = np.flatnonzero(np.isfinite(duty).any(axis=0)).tolist()
    signals = [topic_signal("throttle", source, topic, duty[:, k], k) for k in motors]
    notes = [
        state("output beyond full", motor=str(k + 1), low=low, high=high)
        for k in motors
        for low, high in [(float(np.nanmin(commanded[:, k])), float(np.nanmax(commanded[:, k])))]
        if low < -0.001 or high > 1.001
    ]
    return replace(so_far, signals=signals, notes=notes)


def _outputs(instances: Sequence[Topic], parameters: Mapping[str, float]) -> UlogMotors:
    """Return the motor outputs of that instance of actuator_outputs which has most of them.

    None of them, and the reason in `unused`, if it has fewer than _FEWEST motors.
    """
    best: tuple[list[Signal], Statement | None] = ([], None)
    for number, topic in enumerate(instances):
        signals = _of_instance(topic, number, parameters)
        best = max(best, signals, key=lambda signals_and_order: len(signals_and_order[0]))
    if len(best[0]) < _FEWEST:
        source = Provenance(kind=SourceKind.TOPIC, name="actuator_outputs")
        note = state("not used", source=source, why=state("no known unit"))
        return UlogMotors(unused={"throttle": note})
    return UlogMotors(signals=best[0], motor_order=best[1])


def _of_instance(
    topic: Topic, number: int, parameters: Mapping[str, float]
) -> tuple[list[Signal], Statement]:
    """Return each motor's output, 0 to 1, in instance `number` of actuator_outputs, and the order.

    The order states how outputs were matched to motors: by PX4's PWM_MAIN_FUNCn (PWM_AUX_FUNCn for
    other instances than 0), else motor n on output n for those that are driven. Empty if the values
    fit no ESC protocol.
    """
    bank = "MAIN" if number == 0 else "AUX"
    names = [name for k in range(_MOST_OUTPUTS) if (name := f"output[{k}]") in topic]
    values = [in_si(topic, name, "1") for name in names]
    functions = [
        whole_number(parameters, f"PWM_{bank}_FUNC{k + 1}") or 0 for k in range(len(values))
    ]
    on_output = {f - MOTOR_1: k for k, f in enumerate(functions) if 0 <= f - MOTOR_1 < MOST_MOTORS}
    order = state("by PWM_FUNCn", bank=bank)
    if len(on_output) < _FEWEST:
        driven = [bool(np.unique(v[v > 0]).size > _STEPS) for v in values]
        run = [*driven, False].index(False)
        on_output, order = {k: k for k in range(run)}, state("motor n on output n")
        if run == len(_BETAFLIGHT) and whole_number(parameters, "MOT_ORDERING") == 1:
            on_output = {motor: k for k, motor in enumerate(_BETAFLIGHT)}
            order = state("Betaflight's order")
    outputs = list(on_output.values())
    ranges = ranges_of_span(span_of(values[k] for k in outputs), outputs, parameters, bank=bank)
    source = topic_source("actuator_outputs", "output", meaning=Meaning.PX4_OUTPUT)
    source = source.of_instance(number or None).remarked(ranges_remark(ranges))
    signals = [
        topic_signal("throttle", source, topic, pulses.share(values[output]), motor)
        for (motor, output), pulses in zip(on_output.items(), ranges, strict=False)
    ]
    return signals, order


#: Fields of an ESC in esc_status, which are channels of that name (but for the counter), and their
#: units.
_ESC_FIELDS = (
    ("esc_voltage", "V"),
    ("esc_current", "A"),
    ("esc_temperature", "degC"),
    ("motor_temperature", "degC"),
    ("esc_errorcount", "1"),
)


def _with_escs(motors: UlogMotors, topic: Topic) -> UlogMotors:
    """Return `motors` with the ESC signals of the topic esc_status added, numbered by motor from 0.

    ESCs are matched to motors by their functions, if any is set; else by place, and then only ESCs
    that turned. Speeds are NaN while an ESC is not online. An ESC that repeats the speeds of
    another one is dropped with a note. If no ESC turned, `unused` has the reason.
    """
    signals: list[Signal] = []
    notes: list[Statement] = []
    seen: dict[int, int] = {}  # motor -> its place
    fields = [f"esc[{place}]." for place in range(MOST_MOTORS)]
    places = [f for f in fields if f"{f}esc_rpm" in topic]
    functions = [topic.get(f"{f}actuator_function", np.zeros(1)) for f in places]
    # Logs from before 2021 have no functions, or zeros: then the place is the motor.
    named = any(np.any(function >= MOTOR_1) for function in functions)
    online = topic.get("esc_online_flags")
    for place, (start, function) in enumerate(zip(places, functions, strict=True)):
        rpm = in_si(topic, f"{start}esc_rpm", "rpm")
        turned, motor = bool(np.any(rpm != 0)), int(function[-1]) - MOTOR_1 if named else place
        if not 0 <= motor < MOST_MOTORS or motor in seen or not (named or turned):
            continue
        twin = next((m for m, other in seen.items() if _same(topic, other, place)), None)
        if twin is not None and turned:
            notes.append(state("ESC repeated", place=str(place + 1), motor=str(twin + 1)))
            continue
        seen[motor] = place
        if online is not None:
            rpm = np.where((online.astype(np.int64) >> place) & 1, rpm, np.nan)
        source = topic_source("esc_status", "esc_rpm", "rpm")
        signals.append(topic_signal("esc_rpm", source, topic, rpm, motor))
        for name, unit in _ESC_FIELDS:
            if (column := f"{start}{name}") in topic:
                values = in_si(topic, column, unit)
                if unit == "degC":  # 0 is what an ESC without that sensor reports
                    values = np.where(topic[column] == 0, np.nan, values)
                source = topic_source("esc_status", name, unit)
                channel = "esc_errors" if name == "esc_errorcount" else name
                signals.append(topic_signal(channel, source, topic, values, motor))
    stated = int(topic["esc_count"].max(initial=0)) if "esc_count" in topic else 0
    if stated and stated != len(seen):
        notes.append(state("ESCs stated", stated=float(stated), seen=float(len(seen))))
    source = Provenance(kind=SourceKind.TOPIC, name="esc_status")
    still = state("not used", source=source, why=state("all at 0 rpm"))
    unused = {} if signals else {"rotor_speed_rpm": still}
    return replace(
        motors,
        signals=[*motors.signals, *signals],
        notes=[*motors.notes, *notes],
        esc_order=state("by actuator functions" if named else "motor n has ESC n"),
        unused=motors.unused | unused,
    )


def _same(topic: Topic, one: int, other: int) -> bool:
    return bool(np.array_equal(topic[f"esc[{one}].esc_rpm"], topic[f"esc[{other}].esc_rpm"]))


#: Fields of one topic by name, (n,) or, for what the log has element by element, (n, k).
Topic = Mapping[str, NDArray[Any]]


def _attitude(topic: Columns) -> Floats:
    return attitude_from_quaternion(*in_si(topic, "q", "1").T)


def _asked_attitude(topic: Columns) -> Floats:
    return commanded_by_quaternion(in_si(topic, "q_d", "1"))


def _ground_distance(topic: Columns) -> Floats:
    return np.where(topic["dist_bottom_valid"] > 0, in_si(topic, "dist_bottom", "m"), np.nan)


def _origin(topic: Columns) -> Floats:
    place = np.stack([in_si(topic, f"ref_{n}", "1") for n in ("lat", "lon", "alt")], axis=-1)
    known = (np.abs(place[:, :2]) > 0).any(axis=1) & np.isfinite(place).all(axis=1)
    place[~known] = np.nan
    return place


def _altitude(topic: Columns) -> Floats:
    above_origin = in_si(topic, "ref_alt", "m") - in_si(topic, "z", "m")
    return np.where(topic["z_global"] > 0, above_origin, np.nan)


def _level_wind(topic: Columns) -> Floats:
    north, east = (in_si(topic, f"windspeed_{way}", "m/s") for way in ("north", "east"))
    return np.stack([north, east, np.zeros(north.size)], axis=-1)


def _home(topic: Any) -> Floats:
    place = np.stack([in_si(topic, name, "1") for name in _PLACE], axis=-1)
    if "valid_hpos" in topic:
        place[topic["valid_hpos"] == 0] = np.nan
    return place


def _height(topic: Columns) -> Floats:
    return -in_si(topic, "z", "m")


def _clipping(topic: Columns) -> Floats:
    return in_si(topic, "accel_clipping", "1").sum(axis=1)


def _landed(topic: Columns) -> Floats:
    return np.where(topic["landed"] > 0, 1.0, 2.0)


_PLACE = ("lat", "lon", "alt")
_ANGLES = ("roll_body", "pitch_body")
_ARMED = 2  # arming_state
_AIR, _WARM = "vehicle_air_data", Meaning.BOARD_TEMPERATURE
_DISTANCE = ("dist_bottom", "dist_bottom_valid")
_REF = ("ref_lat", "ref_lon", "ref_alt")
_WIND = ("windspeed_north", "windspeed_east")
_POSITION, _BATTERY, _FUEL = "vehicle_local_position", "battery_status", "fuel_tank_status"
_GPS = "vehicle_gps_position"
_ABOVE_ORIGIN = "above estimator's origin"
#: Preferred sources first. A source needs all its fields. Batteries and tanks are all read, of
#: other topics the first instance.
RULES: tuple[Rule, ...] = (
    Rule("vehicle_attitude", ("q",), "attitude", convert=_attitude),
    Rule("vehicle_attitude_setpoint", ("q_d",), "asked_attitude", convert=_asked_attitude),
    Rule("vehicle_attitude_setpoint", _ANGLES, "asked_attitude", "rad"),
    Rule("vehicle_angular_velocity", ("xyz",), "angular_rate_frd", "rad/s"),
    Rule("sensor_combined", ("gyro_rad",), "angular_rate_frd", "rad/s"),
    Rule("vehicle_acceleration", ("xyz",), "specific_force_frd", "m/s/s"),
    Rule("sensor_combined", ("accelerometer_m_s2",), "specific_force_frd", "m/s/s"),
    Rule(_POSITION, ("x", "y", "z"), "position_ned", "m", note="from estimator's origin"),
    Rule(_POSITION, ("vx", "vy", "vz"), "velocity_ned", "m/s"),
    Rule(_GPS, ("vel_n_m_s", "vel_e_m_s", "vel_d_m_s"), "velocity_ned", "m/s", note="GPS"),
    Rule(_POSITION, _REF, "ekf_origin", convert=_origin),
    Rule("home_position", _PLACE, "home", convert=_home),
    Rule("vehicle_global_position", ("alt",), "altitude", "m"),
    Rule(_POSITION, ("ref_alt", "z", "z_global"), "altitude", convert=_altitude),
    Rule(_POSITION, _DISTANCE, "height_agl", convert=_ground_distance, note="above ground"),
    Rule(_POSITION, ("z",), "height_agl", convert=_height, note=_ABOVE_ORIGIN),
    Rule("vehicle_imu_status", ("accel_vibration_metric",), "vibration", "m/s/s"),
    Rule("vehicle_imu_status", ("accel_clipping",), "clipping", convert=_clipping),
    Rule("vehicle_land_detected", ("landed",), "landed", convert=_landed),
    Rule("actuator_armed", ("armed",), "armed"),
    Rule(
        "vehicle_status",
        ("arming_state",),
        "armed",
        convert=lambda t: 1.0 * (t["arming_state"] == _ARMED),
    ),
    Rule("airspeed_validated", ("true_airspeed_m_s",), "airspeed", "m/s"),
    Rule("airspeed", ("true_airspeed_m_s",), "airspeed", "m/s"),
    Rule("wind", _WIND, "wind_ned", convert=_level_wind, note="level"),
    Rule("wind_estimate", _WIND, "wind_ned", convert=_level_wind, note="level"),
    Rule(_AIR, ("baro_pressure_pa",), "pressure", "Pa"),
    Rule(_AIR, ("ambient_temperature",), "temperature", "degC", unknown=(0,)),
    Rule(_AIR, ("baro_temp_celcius",), "temperature", "degC", meaning=_WARM, unknown=(0,)),
    Rule(_BATTERY, ("voltage_v",), "battery_voltage", "V", unknown=(0.0,)),
    Rule(_BATTERY, ("current_a",), "battery_current", "A", unknown=(-1.0,)),
    Rule(_BATTERY, ("remaining",), "battery_percent", "share", unknown=(-1.0,)),
    Rule(_BATTERY, ("discharged_mah",), "battery_consumed", "mAh", unknown=(-1.0,)),
    Rule(_BATTERY, ("cell_count",), "battery_cells", unknown=(0,)),
    Rule(_BATTERY, ("capacity",), "battery_capacity", "mAh", unknown=(0,)),
    Rule(_FUEL, ("remaining_fuel",), "fuel_remaining", "ml"),
    Rule(_FUEL, ("percent_remaining",), "fuel_percent", "%", unknown=tuple(range(101, 256))),
)
#: Fields that a log has element by element, and how many there are.
VECTORS = {
    "q": 4,
    "q_d": 4,
    "xyz": 3,
    "gyro_rad": 3,
    "accelerometer_m_s2": 3,
    "control": 12,
    "accel_clipping": 3,
}
_EVERY_INSTANCE = (_BATTERY, _FUEL)
#: Topics that are read.
TOPICS = (
    *dict.fromkeys(rule.message for rule in RULES),
    "esc_status",
    "failure_detector_status",
    "actuator_motors",
    "actuator_outputs",
)


def with_vectors(topic: Topic) -> Topic:
    """Return the topic with vectors as columns (n, k) too; the columns of their elements stay."""
    vectors = {}
    for vector, width in VECTORS.items():
        elements = [f"{vector}[{i}]" for i in range(width)]
        if all(name in topic for name in elements):
            vectors[vector] = np.stack([topic[name] for name in elements], axis=-1)
    return {**topic, **vectors}


def ulog_signals(topics: Mapping[str, list[Topic]]) -> Signals:
    """Return the signals of every topic except the motors', by channel.

    `topics` maps a topic's name to its instances, in order.
    """
    signals = [signal for rule in RULES for signal in _by_rule(rule, topics)]
    return signals_by_channel(signals)


def _by_rule(rule: Rule, topics: Mapping[str, list[Topic]]) -> Iterator[Signal]:
    every = rule.message in _EVERY_INSTANCE
    for number, topic in enumerate(topics.get(rule.message, [])[: None if every else 1]):
        if all(name in topic for name in rule.fields):
            index = number if every else None
            source = replace(rule.source, kind=SourceKind.TOPIC).of_instance(index)
            yield topic_signal(rule.channel, source, topic, quantity(rule, topic), index)


def topic_source(
    topic: str, field: str, unit: str = "", meaning: Meaning = Meaning.AS_NAMED
) -> Provenance:
    """Return the source for one field of a topic."""
    return Provenance(
        kind=SourceKind.TOPIC, name=topic, fields=(field,), unit=unit, meaning=meaning
    )


def topic_signal(
    channel: str, source: Provenance, topic: Topic, values: Floats, index: int | None = None
) -> Signal:
    """Return the signal of `values` (n,) or (n, k) at the topic's own times."""
    time_s = in_si(topic, "timestamp", "1") * 1e-6
    return Signal(channel, source, *in_time_order(time_s, values), index)
