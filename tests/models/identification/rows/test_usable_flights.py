"""Flights that may not be fitted, and the sentence that says why."""

from dataclasses import replace

import numpy as np
import pytest

from tests.made_sources import FROM_OUTPUTS
from tests.models.checks.test_late_speeds import flight as gusty_flight
from tests.models.checks.test_motor_order import made_flight as turning_flight
from tests.models.made_flights import F16, curve_model, made_flight
from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.errors import AirframeError, DataError
from thrustmargin.models.identification.rows.problem import assemble_flight
from thrustmargin.models.identification.rows.usable_flights import (
    require_airframe,
    require_distinct,
    too_little,
    wrong_speeds,
)
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.physics.flight_phases import training_rows

#: As the code has them, written down by hand: a change there is to be seen here.
LEAST_ROWS = 100


def test_each_flight_is_given_once():
    one, two = made_flight(1), made_flight(2)
    require_distinct([one, two])
    again = replace(one, name="copy.tlog")
    with pytest.raises(DataError, match=r"copy.tlog and made_1.csv are the same flight; give each"):
        require_distinct([one, two, again])


def test_a_short_flight_says_how_many_rows_it_has():
    assert too_little(made_flight(1), curve_model()) is None
    words = too_little(made_flight(1, duration=6.0), curve_model())
    assert words is not None
    assert words.endswith(f"needs {LEAST_ROWS}")
    assert "rotor speeds" in words


@pytest.mark.parametrize(("rows", "enough"), [(99, False), (100, True)])
def test_a_hundred_rows_are_enough(rows, enough):
    track = made_flight(1)
    use = np.flatnonzero(training_rows(track, curve_model().inputs))
    flying = track.flying.copy()
    flying[: use[20]] = flying[use[20 + rows] :] = False  # away from the ends of the log
    short = replace(track, flying=flying)
    assert int(training_rows(short, curve_model().inputs).sum()) == rows
    assert (too_little(short, curve_model()) is None) == enough


def test_a_short_flight_whose_rows_lie_mostly_beside_its_ends_has_too_few():
    """Fitting needs what lies around a row, which no row near an end of the log has."""
    track = made_flight(1, duration=30.0)
    rows = np.flatnonzero(training_rows(track, curve_model().inputs))[: LEAST_ROWS + 2]
    ends = track.rows(slice(int(rows[0]), int(rows[-1]) + 1))
    assert training_rows(ends, curve_model().inputs).sum() >= LEAST_ROWS
    words = too_little(ends, curve_model())
    assert words is not None
    assert words.endswith("Look at it with: thrustmargin inspect")
    assert not words.startswith(track.name)
    with pytest.raises(DataError):
        assemble_flight(curve_model(), ends)


def test_a_flight_without_a_channel_says_which():
    track = made_flight(1)
    bare = replace(track, rotor_speed_rpm=np.full_like(track.rotor_speed_rpm, np.nan))
    assert too_little(bare, curve_model()) == "it reports no rotor speeds"
    unknown = np.full_like(track.tank_kg, np.nan)
    empty = replace(bare, tank_kg=unknown)
    assert too_little(empty, curve_model()) == "it reports no rotor speeds and no tank level"
    inferred = replace(track, standard_errors={"tank_kg": np.ones_like(track.tank_kg)})
    assert too_little(inferred, curve_model()) == (
        "the load was inferred from these rotor speeds; state it with --load to compare them"
    )


def test_speeds_of_other_rotors_are_refused_and_outputs_are_not_asked():
    track = turning_flight(F16)
    assert wrong_speeds(track, F16) is None
    other = replace(track, rotor_speed_rpm=track.rotor_speed_rpm[:, [1, 0, 2, 3]])
    found = wrong_speeds(other, F16)
    assert found is not None
    assert statement_words(found).endswith(
        "put the rotor speeds in motor order, or give the right --airframe"
    )
    with pytest.raises(DataError, match=r"made: .*not fitted"):
        require_airframe([track, other], curve_model(), given=True)
    outputs = replace(other, sources={"rotor_speed_rpm": FROM_OUTPUTS})
    assert wrong_speeds(outputs, F16) is None


def test_speeds_of_other_seconds_are_refused_and_outputs_are_not_asked():
    track = gusty_flight(late=3.0)
    found = wrong_speeds(track, F16)
    assert found is not None
    words = statement_words(found)
    assert words.startswith("rotor speeds come 3.0 s after the acceleration")
    assert words.endswith("move them by -3.0 s; nothing was fitted")
    outputs = replace(track, sources={"rotor_speed_rpm": FROM_OUTPUTS})
    assert wrong_speeds(outputs, F16) is None


def test_another_number_of_rotors_is_refused():
    hexa = replace(curve_model(), airframe=load_airframe("agras-t20"))
    with pytest.raises(AirframeError, match="4"):
        require_airframe([made_flight(1)], hexa, given=True)
