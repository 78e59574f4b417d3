"""A constant is another one wherever it was imported, and itself again afterwards."""

from tests.lab.undeclared.sensitivity import changed, scaled
from thrustmargin.models.identification.answer import cross_validation, floor
from thrustmargin.models.identification.sets import discrepancy


def test_a_changed_constant_is_changed_where_it_is_used_and_only_for_a_while():
    with changed("answer.cross_validation", "FIFTHS", 7):
        assert (cross_validation.FIFTHS, floor.FIFTHS) == (7, 7)
    assert (cross_validation.FIFTHS, floor.FIFTHS) == (5, 5)


def test_a_constant_of_the_same_name_elsewhere_stays():
    with changed("sets.discrepancy", "FORM", 0.1):
        assert (discrepancy.FORM, discrepancy.FORM) == (0.1, 0.1)
        from thrustmargin.models.identification.rows import noise

        assert noise.FORM == 0.25


def test_numbers_are_scaled_as_what_they_are():
    assert scaled("sets.set_search.BEAM", 12, 0.5) == 6
    assert scaled("rows.candidates.RANGE", (0.02, 0.98), 2.0) == (0.04, 0.96)
    assert scaled("certainty.SURE", 0.95, 2.0) == 0.95**0.5
    assert scaled("sets.search_space.SCATTER_LIMITS", (0.5, 10.0), 2.0) == (1.0, 20.0)
