"""Which aircraft a log is of: the same, another, or one that must be asked for."""

from dataclasses import replace

import pytest

from thrustmargin.gcs_plugin.store.aircraft_marks import Marks, MarksMatch, match, recognise

IDS = {"INS_ACC_ID": 3866898.0, "INS_ACC2_ID": 3866906.0, "COMPASS_DEV_ID": 658953.0}
CALIBRATED = {"INS_ACCOFFS_X": 0.115, "INS_ACCOFFS_Y": -0.02, "INS_ACCOFFS_Z": 0.31}
COMPASS = {"COMPASS_OFS_X": 12.0, "COMPASS_OFS_Y": -80.5, "COMPASS_OFS_Z": 33.0}
SPRAYER = Marks(
    board="004100213131", vehicle=1, layout="quad-x",
    sensors=IDS, accelerometer=CALIBRATED, compass=COMPASS,
)  # fmt: skip
OTHERS = {name: value + 0.01 for name, value in CALIBRATED.items()}
OTHER_COMPASS = {name: value + 5.0 for name, value in COMPASS.items()}


@pytest.mark.parametrize(
    ("log", "says"),
    [
        (SPRAYER, MarksMatch.SAME),
        # Another calibration on the same board: it was calibrated anew.
        (replace(SPRAYER, accelerometer=OTHERS, compass=OTHER_COMPASS), MarksMatch.SAME),
        # The log has no serial number, but one calibration is the same.
        (replace(SPRAYER, board="", compass=OTHER_COMPASS), MarksMatch.SAME),
        (replace(SPRAYER, layout="hexa-x"), MarksMatch.OTHER_LAYOUT),
        (replace(SPRAYER, board="", layout="hexa-x"), MarksMatch.OTHER_LAYOUT),
        (replace(SPRAYER, board="00ff"), MarksMatch.COPIED),
        (
            replace(SPRAYER, board="", accelerometer=OTHERS, compass=OTHER_COMPASS),
            MarksMatch.RECALIBRATED,
        ),
        # Two aircraft of one make and one system id: nothing but the make is the same.
        (
            replace(SPRAYER, board="00ff", accelerometer=OTHERS, compass=OTHER_COMPASS),
            MarksMatch.OTHER,
        ),
        (
            replace(SPRAYER, board="", vehicle=2, accelerometer=OTHERS, compass=OTHER_COMPASS),
            MarksMatch.OTHER,
        ),
        # A log of a station that fetched no parameters.
        (Marks(vehicle=1, layout="quad-x"), MarksMatch.UNMARKED),
        (Marks(vehicle=2, layout="quad-x"), MarksMatch.OTHER),
        (Marks(vehicle=1, layout="hexa-x"), MarksMatch.OTHER),
    ],
)
def test_marks_say_who_flew(log: Marks, says: MarksMatch):
    assert match(log, SPRAYER) is says


def test_one_known_aircraft_is_named_and_two_alike_are_asked_for():
    known = [("north", (SPRAYER,)), ("south", (replace(SPRAYER, board="00ff", sensors={}),))]
    assert recognise(SPRAYER, known).name == "north"
    without = replace(SPRAYER, board="")
    found = recognise(without, known)
    assert found.name is None
    assert [name for name, _ in found.open] == ["north", "south"]


def test_an_aircraft_is_known_by_any_of_the_marks_that_it_had():
    older = replace(SPRAYER, board="00ff", accelerometer=OTHERS, compass=OTHER_COMPASS)
    assert recognise(older, [("north", (SPRAYER, older))]).name == "north"


def test_a_log_of_nobody_known_is_of_a_new_aircraft():
    found = recognise(Marks(), [("north", (SPRAYER,))])
    assert (found.name, found.open) == (None, ())
