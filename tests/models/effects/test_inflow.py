"""Axial inflow is called climb only where the aircraft climbs, not where it flies tilted."""

from types import SimpleNamespace

import numpy as np
import pytest

from tests.models.known_effects import known_effect
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_model import model_channels

CLIMB = known_effect("climb_inflow")


def weight_on(path) -> float:
    model = shipped_model()
    x = model_channels(model, read_log(path, airframe=model.airframe).track)
    flying = np.isfinite(x.advance_ratio) & (x.time_s > 20.0) & (x.time_s < 200.0)
    assert CLIMB.weight is not None
    return float(CLIMB.weight({"slope": 1.0}, x.rows(flying)))


def test_climbs_have_the_weight_and_level_flight_has_not(sitl_logs):
    assert weight_on(sitl_logs / "dev" / "climb_1.tlog") > 2.0
    assert weight_on(sitl_logs / "campaign" / "v6_m4_q1.5.tlog") < 0.5
    assert weight_on(sitl_logs / "dev" / "windy_2.tlog") < 0.5


def test_the_parts_of_the_inflow_add_up(sitl_logs):
    model = shipped_model()
    track = read_log(sitl_logs / "dev" / "climb_1.tlog", airframe=model.airframe).track
    x = model_channels(model, track)
    hover = np.sqrt(x.total_mass * 9.80665 / 4 / model.airframe.thrust_coefficient)
    climb = -track.velocity_ned[:, 2] * np.cos(track.attitude[:, 0]) * np.cos(track.attitude[:, 1])
    expected = climb * 60.0 / (hover * model.airframe.propeller_diameter)
    known = np.isfinite(expected)
    assert x.climb_ratio[known] == pytest.approx(expected[known], abs=1e-12)


def test_it_is_worth_a_name_from_a_share_of_the_inflow_that_is_climb():
    """Inflow that scatters by 0.1, of which climb is 0.03: twice the least share of 15 %."""
    swing = np.array([1.0, -1.0, 1.0, -1.0])
    x = SimpleNamespace(advance_ratio=0.05 + 0.1 * swing, climb_ratio=0.03 * swing)
    assert CLIMB.weight is not None
    assert CLIMB.weight({"slope": 1.0}, x) == pytest.approx(2.0)
    level = SimpleNamespace(advance_ratio=np.zeros(4), climb_ratio=np.zeros(4))
    assert CLIMB.weight({"slope": 1.0}, level) == 0.0
