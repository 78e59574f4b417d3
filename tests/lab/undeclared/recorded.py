"""Data sets made of recorded ArduCopter SITL flights, with a change put into their reports.

The flights are the good ones of the campaign, with the noise, gusts and turns of that simulator.
A change alters rotor speeds through thrust, by its own law, or what the tank gauge shows. The model
that they are held against has seen these flights without the change: what is tested is naming,
intervals and silence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from tests.lab.undeclared.conditions import PAUSE_S, Condition, Implant
from tests.lab.undeclared.crafts import CRAFTS, GRAVITY, Craft
from tests.lab.undeclared.days import Day
from tests.lab.undeclared.plan import DataSet, draw_implants, planned_kind
from tests.lab.undeclared.plant import Flight
from tests.lab.undeclared.rotor_aero import Array
from thrustmargin.models.flight import FlightTrack

CAMPAIGN = Path(__file__).resolve().parents[3] / "sitl_logs" / "campaign"
F16 = CRAFTS[0]  # of the simulated one: mass, tank and arms alike
CURVE, TORQUE_RATIO = 2.011e-5, 0.049  # N/rpm², m: of that simulation
#: Changes whose law needs no more than a log has.
RECORDED_ROUND = (
    *["none"] * 4, "rotor", "rotor", "mass", "cg", "cg of tank", "gauge gain", "air", "fouling",
    "speed with voltage", "tilt", "lag", "mixed", "mixed", "jet", "shed", "band", "flex", "flap",
)  # fmt: skip


@cache
def hosts() -> tuple[FlightTrack, ...]:
    """The good flights of the campaign, in the order of their names."""
    from thrustmargin.gcs_plugin.logs import read_log

    return tuple(read_log(path).track for path in sorted(CAMPAIGN.glob("*.tlog")))


def implanted(
    track: FlightTrack, implants: Sequence[Implant], clock_start: float = 0.0
) -> FlightTrack:
    """The track as it would have been reported with these changes."""
    condition, loss, day = Condition(), 0.0, Day()
    for implant in implants:
        condition, day = implant.on(condition), implant.at(day)
        loss = implant.truth.get("loss", loss)
    effect = np.stack(
        [np.ones(4), -F16.position[:, 1], F16.position[:, 0], TORQUE_RATIO * F16.spin]
    )
    thrust = CURVE * track.rotor_speed_rpm**2
    felt = np.linalg.norm(track.specific_force_frd, axis=1)
    felt = np.where(np.isfinite(felt), felt, GRAVITY)
    thrust = thrust + (condition.hidden_mass * felt / 4.0)[:, None]
    whole, seconds = thrust.sum(axis=1), track.time_s
    filled = track.tank_kg / F16.tank_litres
    ahead, aside = (c + f * filled for c, f in zip(condition.cg, condition.cg_full, strict=True))
    unit = F16.typical_mass * GRAVITY * F16.arm
    roll = -aside * whole + condition.jet * unit * (track.spraying == 1.0)
    pitch = ahead * whole
    if condition.flap:
        pitch = pitch + condition.flap * unit / (1.0 + np.exp((4.5 - track.airspeed) / 0.3))
    yaw = -np.sin(condition.tilt) * F16.arm * thrust[:, condition.tilted]
    demand = np.column_stack([0.0 * whole, roll, pitch, yaw])
    thrust = thrust + np.nan_to_num(demand) @ np.linalg.inv(effect).T
    share = np.full_like(thrust, day.density / Day().density)
    share *= 1.0 - condition.fouling * (1.0 - np.exp(-seconds / 200.0))[:, None] / 0.777
    share *= 1.0 - condition.shed * ((seconds / 70.0) % 1.0)[:, None]
    j, load = condition.rotor, 4.0 * thrust[:, condition.rotor] / unit * F16.arm
    share[clock_start + seconds >= condition.cut_from, j] *= 1.0 - loss
    share[:, j] *= 1.0 - condition.flex * np.maximum(load - 0.5, 0.0)
    share[:, j] *= 1.0 - condition.band * np.exp(
        -((np.sqrt(np.maximum(load, 0.0)) - 1.03) ** 2) / 0.03**2
    )
    rpm = np.sqrt(np.maximum(thrust / share, 0.0) / CURVE)
    rpm *= 1.0 + condition.speed_with_voltage * (track.voltage / 53.2 - 1.0)[:, None]
    rpm = at_time(seconds, rpm, seconds - condition.speed_delay)
    return replace(
        track,
        rotor_speed_rpm=np.where(track.flying[:, None], rpm, track.rotor_speed_rpm),
        tank_kg=track.tank_kg / condition.gauge_gain,
        pressure=track.pressure * day.pressure / Day().pressure,
        temperature=track.temperature + day.temperature - Day().temperature,
        altitude=track.altitude + day.altitude,
    )


def at_time(time: Array, values: Array, wanted: Array) -> Array:
    """Columns of (T, C) interpolated at other times."""
    return np.stack([np.interp(wanted, time, column) for column in values.T], axis=1)


def recorded_case_of(seed: int) -> tuple[str, Craft]:
    """The kind of a seed, and the aircraft."""
    return planned_kind(seed, RECORDED_ROUND), F16


def build_recorded(seed: int, kind: str | None = None) -> DataSet:
    """Four recorded flights to fit and one held out, with the change that the seed draws.

    A change of the gauge is one of the liquid too: the recorded weight is what was flown, so the
    flights without it are the recorded ones with their own gauge.
    """
    rng = np.random.default_rng([seed, 14])
    kind = kind or planned_kind(seed, RECORDED_ROUND)
    if kind not in RECORDED_ROUND:
        raise ValueError(
            f"{kind!r} cannot be put into a recording; {', '.join(RECORDED_ROUND)} can"
        )
    implants = tuple(draw_implants(kind, rng, F16))
    chosen = [hosts()[i] for i in rng.choice(len(hosts()), 5, replace=False)]

    def season(of: Sequence[Implant]) -> tuple[Flight, ...]:
        return tuple(
            Flight(track=implanted(t, of, PAUSE_S * i), dense=0.0) for i, t in enumerate(chosen)
        )

    flights = season(implants)
    return DataSet(
        seed=seed,
        kind=kind,
        craft=F16,
        implants=implants,
        fit=flights[:4],
        held_out=flights[4:],
        without=tuple(season(implants[:k] + implants[k + 1 :]) for k in range(len(implants))),
        dense=(0.0,) * 5,
    )
