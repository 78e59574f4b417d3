"""The residual before and after on the route: two colours of one scale, in the replay's switch."""

import os
import signal
import subprocess
import sys
import urllib.request
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.gcs_plugin.logs.csv_files import write_csv
from tests.models.made_flights import curve_model, made_flight, made_flights, table
from thrustmargin.gcs_plugin.view.replay_view import ReplayView
from thrustmargin.gcs_plugin.view.scene.overlays import before_and_after, overlays_of
from thrustmargin.models.errors import DataError
from thrustmargin.models.identification.answer.model_update import update_model
from thrustmargin.models.identification.loop import identify
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.model_file import save_model
from thrustmargin.models.model.rotor_model import RotorModel


@pytest.fixture(scope="module")
def closed() -> RotorModel:
    """The curve with the worn rotor that was found on two flights."""
    flights = made_flights(2, loss=0.1)
    worn = table(["rotor_degradation"])
    return update_model(curve_model(), identify(flights, curve_model(), catalogue=worn)).model


def test_before_and_after_share_one_scale_and_differ_in_their_values(closed):
    track = made_flight(5, loss=0.1)
    old, new = analyse(track, curve_model()), analyse(track, closed)
    before, after = before_and_after(old, new)
    assert (before.name, after.name) == ("Residual before", "Residual after")
    assert before.scale == after.scale
    assert before.scale.low == -before.scale.high
    usual = np.median(np.abs(before.values))
    assert usual < before.scale.high < 2 * usual
    assert np.median(np.abs(after.values)) < 0.3 * usual
    assert before.rotor is not None
    assert np.median(before.rotor) == 0.0
    by_name = {o.name: o for o in overlays_of(new)}
    np.testing.assert_array_equal(after.values, by_name["Residual"].values)
    assert before.note == "model without effects"
    assert after.note == "model with a weak rotor 1 (front right)"


def test_two_flights_are_not_before_and_after(closed):
    with pytest.raises(DataError, match="two flights"):
        before_and_after(
            analyse(made_flight(5), curve_model()), analyse(made_flight(6, name="b.csv"), closed)
        )


def test_a_flight_without_measured_speeds_has_a_scale_all_the_same(closed):
    track = made_flight(5)
    track = replace(track, rotor_speed_rpm=np.full_like(track.rotor_speed_rpm, np.nan))
    before, _ = before_and_after(analyse(track, curve_model()), analyse(track, closed))
    assert np.isnan(before.values).all()
    assert before.scale.high == 1.0


def test_the_view_colours_by_them(closed):
    track = made_flight(5, loss=0.1)
    old, new = analyse(track, curve_model()), analyse(track, closed)
    view = ReplayView(new, overlays=before_and_after(old, new), port=0, paused=True)
    view.start()
    try:
        view.set_overlay("Residual before")
        view.set_overlay("Residual after")
        with pytest.raises(DataError, match="Residual before, Residual after"):
            view.set_overlay("Residual between")
    finally:
        view.stop()


@pytest.mark.slow
def test_replay_takes_the_model_before(closed, tmp_path):
    log, old, new = (tmp_path / n for n in ("a.csv", "old.safetensors", "new.safetensors"))
    write_csv(made_flight(5, loss=0.1), log)
    save_model(curve_model(), old)
    save_model(closed, new)
    process = subprocess.Popen(
        [
            *(
                sys.executable,
                "-c",
                "from thrustmargin.gcs_plugin.cli import main; main()",
                "replay",
                str(log),
            ),
            *("--model", str(new), "--before", str(old), "--port", "0", "--no-browser"),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).resolve().parents[3],
        env={k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")},
    )
    assert process.stdout is not None
    line = process.stdout.readline()
    assert line.startswith("replay at http://127.0.0.1:"), process.communicate()[1]
    assert urllib.request.urlopen(line.split()[2], timeout=100).status == 200
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 0, errors
