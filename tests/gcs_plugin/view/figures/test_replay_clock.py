"""The replay's clock keeps time with the wall, at its speed, within the flight."""

import pytest

from thrustmargin.gcs_plugin.view.figures.charts import ReplayClock


class Wall:
    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def wall() -> Wall:
    return Wall()


def test_it_runs_at_its_speed_and_stops_at_the_end(wall):
    clock = ReplayClock(60.0, speed=5, wall=wall)
    wall.now += 3
    assert clock.now() == pytest.approx(15)
    clock.set_speed(10)
    wall.now += 1
    assert clock.now() == pytest.approx(25)
    wall.now += 100
    assert clock.now() == 60.0
    assert not clock.playing


def test_pausing_holds_the_time_and_playing_at_the_end_starts_over(wall):
    clock = ReplayClock(60.0, paused=True, wall=wall)
    wall.now += 10
    assert clock.now() == 0.0
    clock.play()
    wall.now += 10
    clock.pause()
    wall.now += 10
    assert clock.now() == pytest.approx(10)
    clock.seek(60.0)
    clock.play()
    assert clock.now() == 0.0
    assert clock.playing


def test_a_seek_lands_in_the_flight_and_nan_is_ignored(wall):
    clock = ReplayClock(60.0, paused=True, wall=wall)
    clock.seek(42.0)
    assert clock.now() == 42.0
    clock.seek(float("nan"))
    assert clock.now() == 42.0
    clock.seek(1e9)
    assert clock.now() == 60.0
    clock.seek(-1)
    assert clock.now() == 0.0


def test_after_its_end_it_rests_on_the_moment_that_counts_and_plays_from_the_start(wall):
    clock = ReplayClock(60.0, rest=42.0, wall=wall)
    wall.now += 100
    assert (clock.now(), clock.playing, clock.ended) == (42.0, False, True)
    clock.play()
    assert (clock.now(), clock.ended) == (0.0, False)
    clock.pause()
    clock.seek(60.0)
    assert (clock.now(), clock.ended) == (60.0, False)
