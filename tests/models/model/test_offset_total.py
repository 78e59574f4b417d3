"""What is followed is not forgiven: a rotor is named by the total of its offsets since a repair."""

from typing import Any

import numpy as np
import pytest

from thrustmargin.models.model.mode_walk import FlightOffsets, mode_columns
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.offset_total import rotor_total

DAY_S = 86_400.0
FLIGHTS, DAYS = 40, 12
#: from day to day and among the flights of a day, of each mode, as flights of `tests.lab.slow_loss`
#: have it
OF_DAYS = (0.005, 0.0024, 0.002, 0.012)
OF_FLIGHTS = (0.0015, 0.0001, 0.0001, 0.0002)


def season(seed, loss=lambda _: 0.0, rotor=2, count=FLIGHTS):
    """Offsets of flights whose rotor, from 0, has lost a share of its thrust at each."""
    rng = np.random.default_rng(seed)
    days = rng.normal(0.0, OF_DAYS, (DAYS, 4))
    column = mode_columns(shipped_model().airframe)[rotor]
    made = []
    for k in range(count):
        day = k * DAYS // FLIGHTS
        faster = 1.0 / np.sqrt(1.0 - loss(k)) - 1.0
        offset = days[day] + rng.normal(0.0, OF_FLIGHTS) + faster * column / 4.0
        made.append(
            FlightOffsets(
                flight=f"{k}",
                start_unix_s=day * DAY_S + 600.0 * k,
                longitude_deg=0.0,
                offset=tuple(offset),
                error=(1e-4,) * 4,
                rows=900,
            )
        )
    return made


def total(flights, **since) -> Any:
    """The weak rotor by the total of the offsets."""
    return rotor_total(flights, shipped_model(), **since)


def first_named(flights, **since) -> Any:
    """The number of flights after which a rotor is first named, and what is said then."""
    for count in range(1, len(flights) + 1):
        if found := total(flights[:count], **since):
            return count, found
    return None, None


@pytest.mark.parametrize("rotor", range(4))
def test_a_rotor_that_loses_a_little_each_flight_is_named_before_six_per_cent(rotor):
    count, found = first_named(season(rotor, lambda k: 0.004 * (k + 1), rotor))
    assert found.rotor == rotor
    assert 0.004 * count < 0.06
    assert found.low <= 0.004 * count <= found.high
    whole = total(season(rotor, lambda k: 0.004 * (k + 1), rotor))
    assert whole.loss == pytest.approx(0.16, abs=0.012)
    assert whole.since_unix_s < 2 * DAY_S
    assert whole.flights == 40


@pytest.mark.parametrize("seed", range(10, 30))
def test_days_of_a_sound_aircraft_name_no_rotor(seed):
    assert first_named(season(seed))[1] is None


def test_a_load_that_stays_is_no_rotor():
    heavier = [
        FlightOffsets(
            flight=one.flight, start_unix_s=one.start_unix_s, longitude_deg=0.0,
            offset=(one.offset[0] + 0.03, *one.offset[1:]), error=one.error, rows=900,
        )
        for one in season(5)
    ]  # fmt: skip
    assert first_named(heavier)[1] is None


def test_a_noted_repair_starts_the_sum_anew():
    worn = season(7, lambda k: 0.004 * (k + 1) if k < 20 else 0.0)
    repaired = worn[20].start_unix_s - 1.0
    assert total(worn[:20]).rotor == 2
    for count in range(21, 41):
        assert total(worn[:count], since_unix_s=repaired) is None
    assert total([]) is None


def test_a_sudden_loss_that_stays_is_dated():
    cracked = season(8, lambda k: 0.08 if k >= 20 else 0.0)
    found = total(cracked[:30])
    assert found.rotor == 2
    assert found.loss == pytest.approx(0.08, abs=0.015)
    assert abs(found.since_unix_s - cracked[20].start_unix_s) <= DAY_S


def test_after_a_repair_that_nobody_noted_no_rotor_is_named():
    worn = season(9, lambda k: 0.004 * (k + 1) if k < 20 else 0.0)
    repaired = worn[20].start_unix_s
    for count in range(21, 41):
        assert total(worn[:count], jump_unix_s=repaired) is None
    # A jump that is no repair changes nothing.
    assert total(worn[:20], jump_unix_s=worn[17].start_unix_s).rotor == 2
