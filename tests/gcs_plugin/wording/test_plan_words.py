"""Words of plans: every reason and every fault has its own, and what to do."""

from typing import get_args

from thrustmargin.gcs_plugin.wording.plan_words import (
    FAULTS,
    NOT_UNDERSTOOD,
    fault_words,
    not_understood_words,
)
from thrustmargin.mission.plan_check import PlanFault
from thrustmargin.mission.plan_items import NotUnderstood, Touched, Why


def test_every_reason_and_every_fault_has_words():
    assert set(NOT_UNDERSTOOD) == set(get_args(Why))
    assert set(FAULTS) == set(get_args(PlanFault))


def test_an_item_is_named_with_its_number_its_command_and_what_it_touches():
    touches: tuple[Touched, ...] = ("distance", "time")
    one = NotUnderstood(item=12, command=42, why="unknown command", touches=touches)
    assert not_understood_words(one) == (
        "item 12 (MAV_CMD 42): what this command does is not known; take it out, or allow for it "
        "(touches distance, time)"
    )


def test_a_fault_lists_its_first_items():
    assert fault_words("pump never on", ()) == (
        "the plan never switches the pump on; say where it is on with --pump always or --pump "
        "lines, or add DO_SPRAYER"
    )
    assert fault_words("pump on in turns", [4]).startswith("item 4: the pump stays on in turns; ")
    high = fault_words("far above home", [2, 4], 505.3)
    assert high == "items 2, 4: up to 505 m above home; is it meant above the sea?"
    assert "up to 495 m below home" in fault_words("below home", [2], -495.0)
    assert fault_words("at the height of home", [1, 2], 0.0).startswith("items 1, 2: 0 m above")
    many = fault_words("fence crossed", range(1, 13))
    assert many.startswith("items 1, 2, 3, 4, 5 and 7 more: the way leaves the geofence; ")
