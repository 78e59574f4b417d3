"""A change of a known aircraft in words: size, since when, the search's answer, what to do."""

from dataclasses import replace

import pytest

from thrustmargin.gcs_plugin.wording.aircraft_words import change_words
from thrustmargin.models.model.aircraft_change import (
    AircraftChange,
    CauseKind,
    CausingEffect,
    ChangeCause,
    ChangeKind,
    ChangeMode,
    ModeChange,
)
from thrustmargin.models.model.offset_total import RotorTotal

LIGHTER = AircraftChange(
    kind=ChangeKind.OFFSET,
    modes=(
        ModeChange(mode=ChangeMode.COLLECTIVE, rpm=-140.0, low_rpm=-180.0, high_rpm=-100.0,
                   faster=(), slower=(0, 1, 2, 3)),
        ModeChange(mode=ChangeMode.YAW, rpm=60.0, low_rpm=40.0, high_rpm=80.0,
                   faster=(0, 1), slower=(2, 3)),
    ),
    since_log="120.BIN",
    mass_kg=-1.0, mass_low_kg=-1.3, mass_high_kg=-0.7,
)  # fmt: skip
NAMED = ChangeCause(
    kind=CauseKind.NAMED,
    flights=1,
    effects=(
        CausingEffect(
            effect="rotor_degradation", rotor=2, parameter="loss", unit="1",
            value=0.08, low=0.07, high=0.09,
        ),
    ),
    error_before_rpm=41.3,
    error_after_rpm=10.8,
)  # fmt: skip


def test_an_offset_has_its_size_since_when_and_the_mass_that_would_make_it():
    said = change_words(LIGHTER)
    assert said.startswith(
        "since 120.BIN all rotors turn 140 rpm (100 to 180) slower, rotors 1, 2 turn 60 rpm "
        "(40 to 80) faster and 3, 4 slower, as if it were 1 kg (0.7 to 1.3) lighter; "
    )
    assert "weigh it" in said
    assert said.endswith("thrustmargin aircraft NAME --changed PART")


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (NAMED, "the search finds a weak rotor 3 8 % (7 to 9): error 41 -> 11 rpm"),
        (
            replace(NAMED, kind=CauseKind.UNEXPLAINED, effects=()),
            "no effect explains it (error 41 rpm by the state before)",
        ),
        (
            ChangeCause(kind=CauseKind.NOT_SEARCHED, flights=0),
            "too little flight to search for its cause",
        ),
    ],
)
def test_the_search_says_what_it_found(found, words):
    assert words in change_words(replace(LIGHTER, explanation=found))


def test_a_total_names_the_rotor_and_asks_to_look_at_it():
    total = RotorTotal(
        rotor=2, loss=0.055, low=0.04, high=0.07, since_unix_s=0.0, flights=14, probability=0.98
    )
    said = change_words(replace(LIGHTER, kind=ChangeKind.WEAK_ROTOR, rotor=total))
    assert said.startswith(
        "since 120.BIN rotor 3 has come to lose 6 % (4 to 7) of its thrust, by all 14 flights "
        "together; "
    )
    assert "3" in said.split("; ")[-1]
    assert "weigh" not in said


def test_a_model_that_no_longer_fits_says_how_often_and_by_chance():
    fits = AircraftChange(
        kind=ChangeKind.COVERAGE, since_log="a.BIN", coverage=0.41, coverage_by_chance=0.76
    )
    assert "41 % of rotor speeds are inside its interval, by chance at least 76 %" in change_words(
        fits
    )
