"""Flights set aside on disk are the same flights, and a search holds one of them at a time."""

import gc
import weakref
from dataclasses import replace
from typing import Any

import numpy as np

from tests.gcs_plugin.logs.csv_files import write_csv
from tests.models.made_flights import curve_model, made_flights, table
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.workshop.identify.identify import TracksOnDisk
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.loop import identify, identify_checked
from thrustmargin.models.identification.next_flight.manoeuvres import FlownLimits
from thrustmargin.models.identification.rows import usable_flights


class Counted(TracksOnDisk):
    """Counts how many of its tracks are in memory at once."""

    most = 0

    def __getitem__(self, which):
        track = super().__getitem__(which)
        if isinstance(track, FlightTrack):
            gc.collect()
            self.alive = [one for one in getattr(self, "alive", []) if one() is not None]
            self.alive.append(weakref.ref(track))
            self.most = max(self.most, len(self.alive))
        return track


def on_disk(folder, tracks, kind=TracksOnDisk) -> Any:
    found = kind(folder)
    for track in tracks:
        found.append(track)
    return found


def test_tracks_come_back_as_they_were_in_their_order(tmp_path):
    first, *others = made_flights(4)
    error = np.linspace(0.1, 0.2, first.time_s.size)
    wanted = [replace(first, standard_errors={"tank_kg": error}), *others]
    both = on_disk(tmp_path, wanted[:3]) + on_disk(tmp_path, wanted[3:])
    assert len(both) == 4
    kept = both.stored[0].track
    assert kept.rotor_speed_rpm.base is None  # no view that would keep the rows in memory
    assert [t.name for t in both[1:3]] == [t.name for t in wanted[1:3]]
    for found, track in zip(both, wanted, strict=True):
        assert (found.name, found.sources) == (track.name, track.sources)
        np.testing.assert_array_equal(found.rotor_speed_rpm, track.rotor_speed_rpm)
        np.testing.assert_array_equal(found.wind_ned, track.wind_ned)
        assert found.statements == track.statements
    np.testing.assert_array_equal(both[0].standard_errors["tank_kg"], error)


def test_a_search_holds_one_flight_at_a_time_and_answers_as_from_memory(tmp_path):
    tracks, model = made_flights(3, loss=0.08, duration=30.0), curve_model()
    few = table(["rotor_degradation"])
    aside = on_disk(tmp_path, tracks, Counted)
    gc.freeze()  # what other tests have left is not looked through again and again
    found = identify_checked(aside, model, catalogue=few)
    other = identify(tracks, model, catalogue=few)
    assert found.to_json() == other.to_json()
    assert FlownLimits.from_tracks(aside) == FlownLimits.from_tracks(tracks)
    assert aside.most == 2  # one, and the one before it while it is read


def test_the_command_checks_the_motor_order_of_a_log_once_and_leaves_nothing_behind(
    tmp_path, monkeypatch
):
    checked, check = [], usable_flights.check_motor_order

    def counted(track, airframe):
        checked.append(track.name)
        return check(track, airframe)

    monkeypatch.setattr(usable_flights, "check_motor_order", counted)
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    monkeypatch.setattr("tempfile.tempdir", None)
    (tmp_path / "temporary").mkdir()
    logs = [tmp_path / f"flight{k}.csv" for k in range(3)]
    for track, path in zip(made_flights(3, duration=40.0), logs, strict=True):
        write_csv(track, path)
    words = [*map(str, logs[:2]), "--held-out", str(logs[2])]
    assert run(["identify", *words, "--airframe", "topxgun-f16"]) == 0
    assert len(checked) == 3
    assert not list((tmp_path / "temporary").iterdir())
