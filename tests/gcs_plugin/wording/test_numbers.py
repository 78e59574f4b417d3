"""Numbers as people read them, each worked out by hand."""

import math

import pytest

from thrustmargin.gcs_plugin.wording.language import (
    area,
    clock,
    duration,
    from_direction,
    joined,
    more,
    number,
    percent,
    place,
    significant,
    unbroken,
    within,
)

MINUS = "\N{MINUS SIGN}"
NOTHING = (float("nan"), float("inf"), None)


@pytest.mark.parametrize(
    ("value", "unit", "decimals", "text"),
    [
        (1234.56, "kg", 1, "1 234.6 kg"),
        (1234567.0, "", 0, "1 234 567"),
        (-3.26, "rpm", 1, f"{MINUS}3.3 rpm"),
        (-0.04, "m/s", 1, "0.0 m/s"),
        (-0.06, "m/s", 1, f"{MINUS}0.1 m/s"),
        (0.5, "", 0, "0"),  # half to even, as Python rounds
        (1.5, "", 0, "2"),
    ],
)
def test_a_number_is_rounded_grouped_and_never_minus_zero(value, unit, decimals, text):
    assert number(value, unit, decimals) == text


@pytest.mark.parametrize("value", NOTHING)
def test_what_is_not_known_says_so_in_every_form(value):
    for form in (number, percent, significant, clock, duration, area):
        assert form(value) == "unknown"
    if value is not None:
        assert from_direction(value) == "unknown"
        assert place(value, 1.0) == place(1.0, value) == ""


def test_shares_are_in_percent():
    assert percent(0.364) == "36 %"
    assert percent(0.0355, 1) == "3.5 %"  # 3.55 is just below in binary
    assert percent(-0.12) == f"{MINUS}12 %"
    assert more(0.7583) == "+75.83 %"
    assert more(-0.7583) == f"{MINUS}75.83 %"
    assert more(0.0) == "0.00 %"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.0, "0:00"),
        (52.9, "0:52"),
        (187.0, "3:07"),
        (3599.9, "59:59"),
        (3725.0, "1:02:05"),
        (-61.0, "-1:01"),
        (-0.5, "0:00"),
    ],
)
def test_a_clock_is_cut_to_the_whole_second(seconds, text):
    assert clock(seconds) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.36, "0.4 s"),
        (8.04, "8.0 s"),
        (10.4, "10 s"),
        (59.4, "59 s"),
        (59.7, "1 min"),
        (180.0, "3 min"),
        (207.6, "3 min 28 s"),
        (3600.0, "1 h 0 min"),
        (7384.0, "2 h 3 min"),
    ],
)
def test_a_duration_is_rounded(seconds, text):
    assert duration(seconds) == text


@pytest.mark.parametrize(
    ("amount", "unit", "text"),
    [
        ((0.0027, 0.0023, 0.0031), "kg", "2.7 g (2.3 to 3.1)"),
        ((0.06, 0.03, 0.09), "kg", "0.06 kg (0.03 to 0.09)"),
        ((-0.02, -0.06, 0.02), "kg", f"{MINUS}0.02 kg ({MINUS}0.06 to 0.02)"),
        ((3.1e-6, 2.2e-6, 4.0e-6), "N m", "0.0031 mN m (0.0022 to 0.0040)"),
        ((1.62e-6, 2.9e-7, 2.96e-6), "kg m²", "16 g cm² (3 to 30)"),
        ((0.0027, 0.0023, 0.0031), "s", "0.003 s (0.002 to 0.003)"),
    ],
)
def test_amounts_of_a_small_aircraft_are_in_a_smaller_unit(
    amount: tuple[float, float, float], unit, text
):
    assert joined(within(*amount, unit)) == text


def test_amounts_of_one_table_share_a_unit():
    small = (1.62e-6, 2.9e-7, 2.96e-6)
    assert (
        joined(within(*small, "kg m²", table_largest=0.3))
        == "0.0000016 kg m² (0.0000003 to 0.0000030)"
    )
    assert joined(within(*small, "kg m²", table_largest=0.01)) == "16 g cm² (3 to 30)"


def test_areas_are_in_hectares_from_a_tenth_of_one_on():
    assert area(999.4) == "999 m²"
    assert area(1000.0) == "0.10 ha"
    assert area(4434.8) == "0.44 ha"


def test_places_and_directions_have_the_right_sign():
    assert place(12.4, -40.4) == "12 m north, 40 m west of the start"
    assert place(-11.0, 30.0) == "11 m south, 30 m east of the start"
    assert from_direction(142.0) == "from SE (142°)"
    assert from_direction(359.0) == "from N (359°)"
    assert from_direction(22.4) == "from N (22°)"
    assert from_direction(22.6) == "from NE (23°)"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (101228.0, "101 228"),
        (12.3456, "12.35"),
        (0.00027, "0.0003"),
        (2.5e10, "2.500e+10"),
        (0.0, "0.0000"),
        (-1234.4, f"{MINUS}1 234"),
    ],
)
def test_significant_digits_follow_the_size(value, text):
    assert significant(value) == text
    assert math.isfinite(value)


def test_a_number_and_its_unit_stay_on_one_line():
    assert unbroken("9.0 kg in 2 parts") == "9.0\N{NO-BREAK SPACE}kg in 2 parts"
    assert unbroken("1 234 rpm.") == "1\N{NO-BREAK SPACE}234\N{NO-BREAK SPACE}rpm."


@pytest.mark.parametrize(
    ("value", "low", "high", "unit", "factor", "shown"),
    [
        (0.08, 0.078, 0.082, "%", 100.0, "8 % (7.8 to 8.2)"),
        (0.0796, 0.079, 0.0802, "%", 100.0, "7.96 % (7.90 to 8.02)"),
        (12.3456, 12.0, 12.7, "kg", 1.0, "12.3 kg (12.0 to 12.7)"),
        (12.3456, 2.0, 22.0, "kg", 1.0, "12 kg (2 to 22)"),
        (0.012, 0.0003, 0.0237, "%", 100.0, "1.2 % (0.0 to 2.4)"),
        (0.5, 0.0, 1.0, "kg", 1.0, "0.5 kg (0.0 to 1.0)"),
        (12.3456, 8.0, 16.0, "kg", 1.0, "12 kg (8 to 16)"),
        (-3.0, -4.0, -2.0, "N", -1.0, "3 N (2 to 4)"),
        (1234.0, 934.0, 1534.0, "rpm", 1.0, "1 200 rpm (900 to 1 500)"),
        (0.0, -0.2, 0.2, "", 1.0, "0 (−0.2 to 0.2)"),
    ],
)
def test_an_amount_has_no_digit_that_its_interval_does_not_allow(
    value, low, high, unit, factor, shown
):
    assert " ".join(within(value, low, high, unit, factor=factor)) == shown


def test_more_decimals_come_only_where_the_ends_would_look_alike():
    assert within(0.08, 0.0798, 0.0802, "%", factor=100.0, most=1) == ("8 %", "(7.98 to 8.02)")
    assert within(0.0801, 0.0787, 0.0815, "%", factor=100.0, most=1) == ("8 %", "(7.9 to 8.2)")


def test_an_amount_without_an_interval_stands_alone():
    assert within(1.0, float("nan"), float("nan"), "N") == ("1.00 N", "")
