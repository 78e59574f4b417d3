"""Flights of an F16 whose arms have laws of their own, with one cause on one arm.

The plant turns a duty cycle into speed, current, voltage and heat by a motor's equations; it shares
no code with `models/checks/arms`. Arms differ as parts of one make do, and flights by fill, air and
wind.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from thrustmargin.models.flight import FlightTrack, Origin
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.provenance import Provenance, SourceKind

F16 = load_airframe("topxgun-f16-sitl")
STEP_S = 0.2
GROUND_S = 12.0
#: Of the plant's motor: Kv, rpm/V; resistance of windings, ESC and lead, ohm.
KV, WINDING, STAGE, LEAD = 62.0, 0.045, 0.006, 0.004
DAY_S = 86_400.0
CAUSES = (
    "propeller",
    "motor",
    "esc",
    "lead",
    "imbalance",
    "speed_reading",
    "current_reading",
    "voltage_reading",
    "esc_temperature_reading",
    "motor_temperature_reading",
    "desync",
    "short",
    "telemetry",
    "current_offset_reading",
    "shaken",
)
#: What the autopilot's filter makes of vibration at 1900 rpm, m/s².
LEVEL = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Bad:
    """A cause of a size, as a share, on one arm from 0.

    A desync's size is the probability of one in 5 s. Of the whole aircraft being shaken
    thirty times it is the additional level, of the usual one; its arm means nothing.
    """

    cause: str
    size: float
    arm: int = 0


def arm_flight(
    seed: int, day: int, bad: Bad | None = None, *, aircraft: int = 0, duration: float = 150.0
) -> FlightTrack:
    """A flight on a day, with a cause or none; `aircraft` is the seed of its parts."""
    parts = np.random.default_rng(1000 + aircraft)
    torque = 1.0 + 0.03 * parts.standard_normal(4)  # of each arm's power
    thrust = 1.0 + 0.01 * parts.standard_normal(4)
    resistance = LEAD * (1.0 + 0.2 * parts.standard_normal(4))
    unbalanced = 0.02 * np.abs(1.0 + 0.3 * parts.standard_normal(4))  # g
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, duration, STEP_S)
    rows = time_s.size
    flying = time_s >= GROUND_S
    tank = np.where(flying, rng.uniform(5.0, 14.0) - 0.03 * (time_s - GROUND_S), 0.0)
    tank = np.maximum(tank, 0.0) if flying.any() else tank
    air = 1.0 + 0.02 * rng.standard_normal()  # density, of 1.225 kg/m³
    # Wind and centre of gravity move arms together, by a share of thrust; gusts come and go.
    trim = np.array([[1, 1, -1, -1], [1, -1, 1, -1], [1, 1, 1, 1]]).T @ (
        np.array([0.01, 0.01, 0.005]) * rng.standard_normal(3)
    )
    gust = 0.02 * _lag(rng.standard_normal((rows, 4)), 1.0)
    by_day = 1.0 + 0.004 * rng.standard_normal(4)  # what differs from flight to flight
    load = (F16.empty_mass + tank) * 9.80665 / 4.0
    needed = load[:, None] * (1.0 + trim + gust)
    coefficient = F16.thrust_coefficient * air * thrust
    power_of = 1.15e-7 * air * torque * by_day  # W/rpm³ at the shaft
    lead, amplitude = resistance.copy(), unbalanced.copy()
    jumps = np.full(4, 0.002)
    share = {cause: np.zeros(4) for cause in CAUSES}
    if bad is not None:
        share[bad.cause][bad.arm] = bad.size
    coefficient = coefficient * (1.0 - share["propeller"])
    power_of = power_of * (1.0 - 1.25 * share["propeller"])
    amplitude = amplitude + 0.2 * share["propeller"] + share["imbalance"]
    speed = np.where(flying[:, None], np.sqrt(np.maximum(needed, 0.0) / coefficient), 0.0)
    shaft = power_of * speed**3 * (1.0 + share["motor"])
    jumps = jumps + 0.4 * share["esc"]
    sound_volts = 58.0 - 0.008 * np.maximum(time_s - GROUND_S, 0.0)
    # Of a lead, the share of the voltage that it loses more at 5 kg of tank.
    usual_amps = power_of * (np.median(speed[flying], axis=0)) ** 3 / 57.0
    lead = lead + share["lead"] * 57.0 / usual_amps
    amps, at_esc = shaft / 55.0, np.full(shaft.shape, 55.0)
    battery = sound_volts[:, None]
    for _ in range(6):  # of the battery's side: shaft power, windings, stage
        battery = sound_volts[:, None] - 0.02 * amps.sum(axis=1, keepdims=True)
        at_esc = battery - lead * amps
        lost = (WINDING + STAGE) * amps**2 + share["esc"] * shaft
        amps = np.where(flying[:, None], (shaft + lost) / at_esc, 0.0)
    duty = np.where(flying[:, None], (speed / KV + WINDING * amps) / at_esc, 0.0)
    # Of a motor: losses of winding and friction; of an ESC: stage and timing.
    into_motor = WINDING * amps**2 + share["motor"] * shaft + 0.03 * shaft
    into_esc = STAGE * amps**2 + share["esc"] * shaft * 0.6 + 0.01 * shaft
    warm = 293.0 + 3.0 * rng.standard_normal()
    hot_esc = warm + _lag(into_esc, 200.0) * 1.2
    hot_motor = warm + _lag(into_motor, 500.0) * 0.6
    said = speed * (1.0 + jumps * rng.standard_normal(speed.shape))
    said = said * (1.0 + share["speed_reading"])
    said_amps = amps * (1.0 + share["current_reading"]) + 0.3 * rng.standard_normal(amps.shape)
    said_volts = at_esc * (1.0 + share["voltage_reading"]) + 0.03 * rng.standard_normal(amps.shape)
    grown = np.stack([1.0 + share[f"{part}_temperature_reading"] for part in ("esc", "motor")])
    # What is drawn here has draws of its own, so that the flights before it stay as they are.
    further = np.random.default_rng(7_000_000 + seed)
    out_of_step = _falls(further, time_s, share["desync"])
    said = said * (1.0 - 0.3 * out_of_step)
    duty = duty * (1.0 + 0.25 * out_of_step)
    said_amps = said_amps * (1.0 + 0.5 * out_of_step)
    leak = (share["short"] + share["current_offset_reading"]) * usual_amps
    said_amps = np.where(flying[:, None], said_amps, 0.0) + leak
    # A leak heats the part that has it, and is a part of all that the battery gives.
    hot_esc = hot_esc + _lag(share["short"] * usual_amps * 57.0 * np.ones_like(amps), 200.0) * 0.05
    frames = further.binomial(50, share["telemetry"], size=(rows, 4)) / 50.0
    level = LEVEL * np.exp(0.15 * further.standard_normal()) * (speed.mean(axis=1) / 1900.0) ** 2
    level = (
        level * (1.0 + 30.0 * share["shaken"].max()) * np.exp(0.2 * further.standard_normal(rows))
    )
    level = np.hypot(level, share["imbalance"].max() * 9.80665 * (speed.mean(axis=1) / 1900.0) ** 2)
    hot_esc = np.round(warm + (hot_esc - warm) * grown[0])
    hot_motor = np.round(warm + (hot_motor - warm) * grown[1])
    shaken = amplitude * 9.80665 * (speed / 1900.0) ** 2
    shaken = shaken * np.abs(1.0 + 0.15 * rng.standard_normal(speed.shape))
    down = np.where(flying, -3.0, 0.0)
    motor = Provenance(kind=SourceKind.MESSAGE, name="RCOU", fields=("C1",))
    return FlightTrack.of(
        name=f"made_{aircraft}_{day}_{seed}.csv",
        time_s=time_s,
        rotor_count=4,
        flying=flying,
        position_ned=np.column_stack([np.zeros((rows, 2)), down]),
        velocity_ned=0.05 * rng.standard_normal((rows, 3)),
        attitude=np.zeros((rows, 3)),
        angular_rate_frd=0.01 * rng.standard_normal((rows, 3)),
        specific_force_frd=np.column_stack([np.zeros((rows, 2)), np.full(rows, -9.80665)]),
        airspeed=np.zeros(rows),
        tank_kg=tank,
        rotor_speed_rpm=np.round(said),
        throttle=np.clip(duty, 0.0, 1.0),
        voltage=battery[:, 0] + 0.03 * rng.standard_normal(rows),
        current=amps.sum(axis=1),
        esc_voltage=np.round(said_volts, 1),
        esc_current=_unless_zero(np.round(said_amps, 1)),
        esc_lost=frames,
        vibration=level,
        clipping=np.zeros(rows),
        esc_temperature=hot_esc,
        motor_temperature=hot_motor,
        vibration_per_rev=np.where(flying[:, None], shaken, np.nan),
        pressure=np.full(rows, 101325.0 * air),
        temperature=np.full(rows, 288.15),
        altitude=np.full(rows, 3.0),
        height_agl=-down,
        origin=Origin(latitude_deg=36.65, longitude_deg=116.9, altitude=0.0),
        start_unix_s=1.7e9 + DAY_S * day,
        sources={"throttle": motor, "rotor_speed_rpm": motor},
    )


def _unless_zero(values: np.ndarray) -> np.ndarray:
    """The values with NaN for 0, which a reader takes for an ESC without that sensor."""
    return np.where(values == 0.0, np.nan, values)


def _falls(rng: np.random.Generator, time_s: np.ndarray, share: np.ndarray) -> np.ndarray:
    """1 in the rows (T, R) in which a motor is out of step: 0.4 s, in a share of all 5 s."""
    fell = np.zeros((time_s.size, share.size))
    for begin in np.arange(GROUND_S + 5.0, time_s[-1] - 5.0, 5.0):
        out = rng.random(share.size) < share
        row = int(np.searchsorted(time_s, begin + 1.0 + 2.0 * rng.random()))
        fell[row : row + 2, out] = 1.0
    return fell


def _lag(values: np.ndarray, tau: float) -> np.ndarray:
    """First-order response (T, R) of `values` with the time constant `tau`, s."""
    found = np.zeros_like(values)
    for row in range(1, len(values)):
        found[row] = found[row - 1] + (values[row - 1] - found[row - 1]) * STEP_S / tau
    return found
