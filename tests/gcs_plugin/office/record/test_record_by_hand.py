"""Values of a record that are worked out by hand: weather, liquid, strips, one flight."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.gcs_plugin.reports.margin.report_flight import flight, log, model
from thrustmargin.gcs_plugin.office.record import applied as liquid
from thrustmargin.gcs_plugin.office.record.applied import applied_swaths, better_logs
from thrustmargin.gcs_plugin.office.record.job_record import log_entries
from thrustmargin.gcs_plugin.office.record.record import common_density, liquids
from thrustmargin.gcs_plugin.telemetry.recording import FlightLog
from thrustmargin.models.flight import FlightTrack, Origin
from thrustmargin.models.provenance import Meaning, Provenance, SourceKind
from thrustmargin.models.statement import state

ROWS = np.arange(40.0)


def flown(sources: dict[str, Provenance] | None = None, **given: Any) -> FlightLog:
    """40 rows a second apart to the north at 1 m/s, the pump on from 10 to 29 s."""
    usual = {
        "position_ned": np.column_stack([ROWS, np.zeros(40), np.zeros(40)]),
        "spraying": ((ROWS >= 10.0) & (ROWS < 30.0)).astype(float),
        "flying": np.ones(40, bool),
        "start_unix_s": 1.7e9,
        "origin": Origin(latitude_deg=0.0, longitude_deg=0.0, altitude=0.0),
    }
    track = FlightTrack.of(name="x", time_s=ROWS, rotor_count=4, **(usual | given))
    return replace(log(), track=replace(track, sources=sources or {}))


def source(meaning: Meaning = Meaning.AS_NAMED) -> Provenance:
    return Provenance(kind=SourceKind.MESSAGE, name="X", meaning=meaning)


def test_the_wind_is_that_of_the_rows_with_the_pump_on_and_where_it_comes_from():
    # It blows 3 m/s south and 4 m/s west, then twice that: 7.5 m/s on average. It comes from
    # atan2(4, 3) = 53 degrees. Without the pump it blows north.
    wind = np.where(ROWS[:, None] < 20.0, [-3.0, -4.0, 0.0], [-6.0, -8.0, 0.0])
    one = flown(wind_ned=np.where(flown().track.spraying[:, None] > 0.5, wind, [20.0, 0.0, 0.0]))
    found = log_entries([one], applied_swaths([one], 4.0), None)["wind"]
    assert (found.value, found.unit) == ("7.5 from 53°, at most 10.0", "m/s")


@pytest.mark.parametrize(
    ("meaning", "celsius"), [(Meaning.AS_NAMED, 27.0), (Meaning.BOARD_TEMPERATURE, None)]
)
def test_a_temperature_is_that_of_the_air(meaning, celsius):
    one = flown({"temperature": source(meaning)}, temperature=np.full(40, 300.15))
    fields = log_entries([one], None, None)
    assert (fields["temperature"].value if "temperature" in fields else None) == celsius


def test_a_pump_that_is_tried_on_the_ground_sprays_nothing():
    one = applied_swaths([flown(flying=ROWS >= 15.0)], 4.0)
    assert one is not None
    assert one.start_unix_s == 1.7e9 + 15.0
    assert [p.length for p in one.passes] == [14.0]


def test_a_pass_is_a_strip_as_wide_as_the_swath():
    done = applied_swaths([flown()], 4.0)
    assert done is not None
    (one,) = done.passes
    assert one.strip is not None
    # 19 m by 4 m; at the equator a degree is 110,574 m to the north and 111,320 m to the east.
    assert one.strip.area * 110_574.0 * 111_320.0 == pytest.approx(76.0, rel=1e-3)
    assert (one.length, one.speed) == pytest.approx((19.0, 1.0))


@pytest.mark.parametrize("rising", [False, True])
def test_a_gauge_is_read_over_ten_rows_at_either_end(rising):
    level = np.select([ROWS < 10.0, ROWS < 30.0], [10.0, 8.0], 4.0)
    level = level[::-1] if rising else level
    found = liquid.gauge_estimate(flown({"tank_kg": source()}, tank_kg=level).track)
    # A tank that is fuller after the flight says nothing of what was sprayed.
    assert (None if found is None else found.kg) == (None if rising else 6.0)


def test_the_interval_by_thrust_holds_nine_of_ten(monkeypatch):
    def shown(track: FlightTrack, _: object) -> FlightTrack:
        assert np.isnan(track.tank_kg).all()  # the gauge is not asked
        errors = {"tank_kg": np.where(ROWS < 20.0, 0.3, 0.4)}
        found = replace(track, tank_kg=np.where(ROWS < 20.0, 9.0, 4.0), standard_errors=errors)
        return replace(found, sources={"tank_kg": source(Meaning.HOVER_THRUST)})

    monkeypatch.setattr(liquid, "with_load", shown)
    track = flown({"tank_kg": source()}, tank_kg=np.full(40, 7.0)).track
    found = liquid.thrust_estimate(track, model().airframe)
    assert found is not None
    # Standard errors of 0.3 and 0.4 kg make 0.5; 90 % lie within 1.645 of it.
    assert (found.kg, found.within_kg) == (5.0, pytest.approx(0.8224, abs=1e-3))


def test_litres_need_one_density_of_all_flights():
    one = flight()
    thick = replace(one[0].model.airframe, liquid_density=1.2)
    other = replace(one[0], model=replace(one[0].model, airframe=thick)), one[1]
    airframe_match = replace(one[0].airframe_match, no_verdict=("another aircraft",))
    unknown = replace(one[0], airframe_match=airframe_match), one[1]
    assert common_density([one, one]) == 1.0
    assert common_density([other]) == 1.2
    assert common_density([one, other]) is common_density([one, unknown]) is None


def test_a_pump_is_not_summed_of_a_log_that_reads_as_another_number_of_sorties(monkeypatch):
    def by(found: list[FlightLog]) -> list[str]:
        monkeypatch.setattr("thrustmargin.gcs_plugin.logs.read_sorties", lambda *_, **__: found)
        return [one.by for one in liquids([flight()])]

    track = log().track
    summed = replace(
        track.source("tank_kg"),
        kind=SourceKind.INFERRED,
        remarks=(state("as written", text="3 L/min"),),
    )
    again = replace(log(), track=replace(track, sources={**track.sources, "tank_kg": summed}))
    assert "pump" in by([again])
    assert "pump" not in by([again, again])


def moved(**changes: Any) -> FlightLog:
    return replace(log(), track=replace(log().track, **changes))


def test_clocks_of_one_flight_are_five_seconds_apart_at_most():
    start = log().track.start_unix_s
    assert start is not None
    # 2 s beyond that are 8 m at 4 m/s.
    assert better_logs([log(), moved(start_unix_s=start + 7.0)]) == [None, None]


@pytest.mark.parametrize(("metres", "stands"), [(2.0, 0), (4.0, None)])
def test_no_two_fly_within_three_metres(metres, stands):
    up = log().track.position_ned[:, :2]
    along = np.diff(up[log().track.flying], axis=0)
    lines = np.abs(along).sum(axis=0)
    # Across the lines: along them another clock would do.
    shift = np.array([metres, 0.0, 0.0] if lines[0] < lines[1] else [0.0, metres, 0.0])
    shifted = moved(position_ned=log().track.position_ned + shift)
    assert better_logs([log(), shifted]) == [None, stands]


@pytest.mark.parametrize(("from_share", "stands"), [(0.15, 0), (0.3, None)])
def test_logs_of_one_flight_share_half_of_their_time(from_share, stands):
    """Two logs of half a flight each, which share 70 and 40 % of that."""
    rows = log().track.time_s.size
    half = slice(0, rows // 2), slice(int(from_share * rows), int((from_share + 0.5) * rows))
    start, time_s = log().track.start_unix_s, log().track.time_s
    assert start is not None
    logs = [
        replace(
            log(),
            track=replace(
                (cut := log().track.rows(one)),
                time_s=cut.time_s - cut.time_s[0],
                start_unix_s=start + float(time_s[one][0]),
            ),
        )
        for one in half
    ]
    found = better_logs(logs)
    assert (found.count(None) == 1) == (stands is not None)


@pytest.mark.parametrize(("board", "stands"), [("A1", 0), ("", None)])
def test_without_a_place_one_autopilot_makes_one_flight_and_none_makes_no_such(board, stands):
    one = replace(moved(origin=None), hardware_id=board)
    assert better_logs([one, one]) == [None, stands]
