"""Whole flights made by pymavlink, of four or six rotors, with a tank or without, and with a rotor
that grows weak: a .tlog, and the airframe of which it is."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.gcs_plugin.logs.tlog_files import link, stamped
from thrustmargin.models.physics.airframe import Airframe, load_airframe

G0 = 9.80665
EMPTY_KG, THRUST, DENSITY = 6.0, 1.2e-5, 1.225  # kg, N/rpm², kg/m³
MOST_RPM, CELLS = 2200.0, 6
ON_GROUND, IN_AIR = 1, 2  # MAV_LANDED_STATE


def made_airframe(folder: Path, *, tank_l: float, layout: str = "hexa-x") -> Path:
    """The airframe file of the aircraft that `made_flight` flies: quad-x or hexa-x."""
    quantities = {
        "empty_mass": (EMPTY_KG, "kg"),
        "tank_volume_l": (tank_l, "L"),
        "liquid_density": (1.0, "kg/L"),
        "arm": (0.8, "m"),
        "propeller_diameter": (0.7, "m"),
        "thrust_coefficient": (THRUST, "N/rpm^2"),
        "reference_density": (DENSITY, "kg/m^3"),
        "max_rotor_speed_rpm": (MOST_RPM, "rpm"),
        "nominal_voltage": (3.7 * CELLS, "V"),
        "ceiling_voltage": (3.7 * CELLS, "V"),
        "ceiling_voltage_exponent": (1.0, "1"),
        "torque_ratio": (0.02, "m"),
        "pump_max_flow_l_min": (2.0, "L/min"),
        "propeller_pitch": (0.25, "m"),
        "propeller_blades": (2, "1"),
        "nameplate_max_thrust": (THRUST * MOST_RPM**2, "N"),
        "motor_poles": (28, "1"),
    }
    rows = [
        f'{name} = {{ value = {value}, unit = "{unit}", source = "made" }}'
        for name, (value, unit) in quantities.items()
    ]
    head = ['name = "made"', 'title = "made"', f'layout = "{layout}"', "[quantities]"]
    path = folder / "made.toml"
    path.write_text("\n".join([*head, *rows]) + "\n")
    return path


def made_flight(
    airframe: Path,
    *,
    load_kg: float = 0.0,
    gauge_kg: float | None = None,
    weak: int | None = None,
    lost: float = 0.0,
    seconds: float = 75.0,
    after: float = 10.0,
) -> Path:
    """A hover of so many `seconds`, and s on the ground `after` it, beside its `airframe`.

    From its middle on the rotor `weak` (from 0) makes the share `lost` less thrust, and turns
    faster. `gauge_kg` is what the tank is said to hold; None: nothing says it.
    """
    craft, path = load_airframe(str(airframe)), airframe.with_suffix(".tlog")
    rotors, kind = craft.rotor_count, {4: 2, 6: 13}[craft.rotor_count]
    random, sender = np.random.default_rng(7), link()
    parts: list[bytes] = []

    def put(time_s: float, message: object) -> None:
        parts.append(stamped(bytes(message.pack(sender)), time_s))  # type: ignore[attr-defined]
        sender.seq = (sender.seq + 1) % 256

    for name, value in {"FRAME_CLASS": rotors // 2 - 1, "FRAME_TYPE": 1}.items():
        put(0.0, dialect.MAVLink_param_value_message(name.encode(), float(value), 9, 700, 0))
    up, down = 5.0, 5.0 + seconds
    for tick in range(round(10 * (down + after))):
        now = tick / 10
        flying = up <= now < down
        left = np.ones(rotors)
        if weak is not None and now > 0.5 * (up + down):
            left[weak] = 1.0 - lost
        for message in _messages(
            *(tick, kind, flying, gauge_kg, random),
            height=min(max(0.0, min(now - up, down - now)), 8.0),
            speeds=_speeds(flying, craft, load_kg, left, random),
        ):
            put(10.0 + now, message)
    path.write_bytes(b"".join(parts))
    return path


def _speeds(flying: bool, craft: Airframe, load_kg: float, left: np.ndarray, random) -> np.ndarray:
    """(R,) rpm of a hover with the noise of a controller; `left` (R,) of each rotor's thrust.

    The mixer asks for collective, roll, pitch and yaw; what it asks for holds the aircraft level.
    """
    if not flying:
        return np.zeros(left.size)
    place, spin = craft.rotor_position_frd, craft.rotor_spin
    effect = np.stack([np.ones(left.size), -place[:, 1], place[:, 0], craft.torque_ratio * spin])
    mixer = np.linalg.pinv(effect)
    wanted = np.array([(EMPTY_KG + load_kg) * G0, 0.0, 0.0, 0.0])
    asked = mixer @ np.linalg.solve(effect * left @ mixer, wanted)
    return np.sqrt(asked / THRUST * (1.0 + 0.01 * random.standard_normal(left.size)))


def _messages(tick, kind, flying, gauge_kg, random, *, height, speeds) -> Iterator[object]:
    boot, rotors = 10_000 + 100 * tick, len(speeds)
    roll, pitch = 0.01 * random.standard_normal(2)
    if tick % 10 == 0:
        armed = 0x80 if flying else 0
        yield dialect.MAVLink_heartbeat_message(kind, 3, armed, 0, 4, 3)
        yield dialect.MAVLink_extended_sys_state_message(0, IN_AIR if flying else ON_GROUND)
        yield dialect.MAVLink_scaled_pressure_message(boot, 1013.25, 0.0, 1500)
        yield dialect.MAVLink_battery_status_message(
            *(0, 0, 1, 2500, [round(3700 - tick * 0.1)] * CELLS + [65535] * (10 - CELLS)),
            *(2000, -1, -1, 80),
        )
    yield dialect.MAVLink_attitude_message(boot, roll, pitch, 0.5, 0.0, 0.0, 0.0)
    yield dialect.MAVLink_global_position_int_message(
        boot, 520000000, 50000000, round(1000 * height), round(1000 * height), 0, 0, 0, 0
    )
    yield dialect.MAVLink_vfr_hud_message(0.2, 0.2, 0, 40, height, 0.0)
    if gauge_kg is not None:
        yield dialect.MAVLink_named_value_float_message(boot, b"TANK", gauge_kg)
    # An autopilot's usual curve, of thrust over output, from 1100 to 1900 µs.
    share = np.square(speeds / MOST_RPM)
    output = (-0.35 + np.sqrt(0.35**2 + 4 * 0.65 * share)) / (2 * 0.65)
    pulses = [round(1100 + 800 * x) if flying else 1000 for x in output]
    pulses += [0] * (16 - len(pulses))
    yield dialect.MAVLink_servo_output_raw_message(boot * 1000, 0, *pulses[:8], *pulses[8:])
    counts = [tick + 1] * 4
    volts, zeros = [2200] * 4, [0] * 4
    padded = [*map(round, speeds), *[0] * (8 - rotors)]
    first, second = padded[:4], padded[4:]
    yield dialect.MAVLink_esc_telemetry_1_to_4_message(zeros, volts, zeros, zeros, first, counts)
    if rotors > 4:
        yield dialect.MAVLink_esc_telemetry_5_to_8_message(
            zeros, volts, zeros, zeros, second, counts
        )
