"""Live rotor alarms where the rotor, or whether it is one, is not sure: outputs and motor order."""

import numpy as np
import pytest

from tests.changed_speeds import changed_speeds
from thrustmargin.gcs_plugin.live.alarms.listed_alarms import Alarms
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.model.airframe_match import AirframeMatch
from thrustmargin.models.model.analysis import analyse
from thrustmargin.models.model.model_file import shipped_model

MODEL = shipped_model()


def rotor_alarms(log, *, open_pairs=()):
    """The rotor alarms that stand at the end, and all that were ever raised: rotor and rotors."""
    track = read_log(log, airframe=MODEL.airframe, sampling="hold").track
    airframe_match = AirframeMatch(open_pairs=open_pairs)
    analysis, alarms = analyse(track, MODEL, airframe_match=airframe_match), Alarms()
    nothing = np.full(track.time_s.size, np.nan)
    events = alarms.rows(analysis, 0, clock_s=track.time_s, pumped_kg=nothing, virtual_kg=nothing)
    raised = {
        (e.alarm.rotor, e.alarm.rotors) for e in events if e.raised and e.alarm.name == "rotor"
    }
    stands = [(a.rotor, a.rotors) for a in alarms.listed.values() if a.name == "rotor"]
    return stands, raised


def test_a_worn_rotor_is_named_and_with_swapped_speeds_it_is_one_of_two(sitl_logs, tmp_path):
    worn = sitl_logs / "dev" / "worn_prop_1.tlog"
    assert rotor_alarms(worn)[0] == [(1, ())]
    swapped = changed_speeds(worn, tmp_path / "s.tlog", swapped=(1, 2), rate_hz=3.0)
    stands, raised = rotor_alarms(swapped)
    assert stands == [(None, (1, 2))]
    assert raised == {(None, (1, 2))}


def test_without_outputs_an_order_that_is_not_known_leaves_the_choice(sitl_logs, tmp_path):
    worn = sitl_logs / "dev" / "worn_prop_1.tlog"
    blind = changed_speeds(worn, tmp_path / "b.tlog", outputs=False)
    assert rotor_alarms(blind)[0] == [(1, ())]
    assert rotor_alarms(blind, open_pairs=((0, 1),))[0] == [(None, (1, 2))]
    # Outputs that rise with the speed tell the rotor, whatever manoeuvres do not.
    assert rotor_alarms(worn, open_pairs=((0, 1),))[0] == [(1, ())]


@pytest.mark.parametrize("factor", [1.04, 1.08])
def test_an_esc_that_reads_high_raises_no_rotor_alarm(sitl_logs, tmp_path, factor):
    sound = sitl_logs / "campaign" / "v4_m10_q2.5.tlog"
    made = changed_speeds(sound, tmp_path / "e.tlog", scale=(1.0, 1.0, factor, 1.0))
    assert rotor_alarms(made) == ([], set())
