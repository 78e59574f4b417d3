"""A flown mission beside its forecast, in words: every screen shows thrust left."""

import math

from thrustmargin.gcs_plugin.wording.aircraft_words import mission_words
from thrustmargin.mission.forecast.experience import FlownMission, SaidFlown


def test_shares_in_use_are_shown_as_thrust_left_and_the_unknown_as_unknown():
    mission = FlownMission(
        stretches=4,
        complete=True,
        seconds=SaidFlown(said=93.0, flown=83.0),
        energy_wh=SaidFlown(said=97.0, flown=math.nan),
        leg_use=SaidFlown(said=0.60, flown=0.62),
        peak_use=SaidFlown(said=0.88, flown=math.nan),
    )
    said = mission_words(mission)
    assert "93 s, flown 83; 97 Wh, flown unknown; " in said
    assert "thrust left on legs 40 %, flown 38 %; at least 12 %, flown unknown" in said
