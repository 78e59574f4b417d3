"""Which rows become final, and when an aircraft has landed, by rows of a clock in whole seconds."""

import numpy as np
import pytest

from thrustmargin.gcs_plugin.live.watch.landed_flight import LandedFlights
from thrustmargin.gcs_plugin.live.watch.settled_rows import RowHorizon, SettledRows
from thrustmargin.gcs_plugin.live.watch.update import WatchSettings, when_asked
from thrustmargin.models.model.model_file import shipped_model
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

MODEL = physics_model(load_airframe("topxgun-f16"))


def test_a_row_is_final_once_all_that_its_prediction_looks_ahead_to_is_known():
    horizon = RowHorizon(2.0)
    assert horizon.settled(np.arange(5.0), 0, at_once=False) == slice(0, 3)  # 0, 1 and 2 s
    assert horizon.settled(np.arange(6.0), 5, at_once=False) == slice(3, 4)
    # The window has lost its first two rows; the last two known are still open.
    assert horizon.settled(np.arange(2.0, 8.0), 4, at_once=False) == slice(2, 4)
    assert horizon.settled(np.arange(2.0, 8.0), 6, at_once=True) == slice(4, 6)  # no more will come
    horizon.settled(np.arange(5.0), 0, at_once=False)
    horizon.restart()
    assert horizon.settled(np.arange(3.0), 0, at_once=False) == slice(0, 1)


def test_without_effects_every_row_is_final_as_soon_as_it_is_there():
    rows = SettledRows(MODEL)
    assert rows.settled(np.arange(5.0), 0, at_once=False) == (slice(0, 5), slice(0, 5))
    assert rows.settled(np.arange(5.0), 3, at_once=False) == (slice(3, 5), slice(3, 5))


def test_with_effects_predictions_are_final_later_and_at_once_at_the_end():
    rows = SettledRows(shipped_model())  # its effects look 1.9 s ahead, the search for faults not
    assert rows.settled(np.arange(5.0), 0, at_once=False) == (slice(0, 3), slice(0, 5))
    assert rows.settled(np.arange(5.0), 5, at_once=True) == (slice(3, 5), slice(5, 5))


@pytest.mark.parametrize("together", [True, False])
def test_the_landing_is_the_first_row_on_the_ground_however_many_rows_come_at_once(together: bool):
    flying = np.array([False, True, True, False, False, True, False])
    stamps = 1_000_000 * np.arange(1, 8)
    landed = [0, 0, 0, 4_000_000, 4_000_000, 0, 7_000_000]
    flights = LandedFlights(1, MODEL, WatchSettings(), when_asked)
    if together:
        flights.follow_landing(flying, stamps)
        assert flights.landed_us == landed[-1]
        return
    for k, known in enumerate(landed):
        flights.follow_landing(flying[k : k + 1], stamps[k : k + 1])
        assert flights.landed_us == known
