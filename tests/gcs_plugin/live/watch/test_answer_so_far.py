"""The answer of the flight so far is that of a report of the same rows."""

from dataclasses import replace

import numpy as np
import pytest

from tests.import_graph import ROOT
from thrustmargin.gcs_plugin.live.rows.vehicle_state import VehicleState
from thrustmargin.gcs_plugin.live.watch.flight_so_far import FlightSoFar
from thrustmargin.gcs_plugin.logs.log_answer import matched_flights
from thrustmargin.models.checks.output_evidence import OutputEvidence
from thrustmargin.models.model.advice import advise
from thrustmargin.models.model.analysis import analyse, analysis_for_verdict
from thrustmargin.models.model.model_file import shipped_model

MODEL = shipped_model()
LOG = ROOT / "sitl_logs" / "campaign" / "v4_m16_q2.5.tlog"
#: As in its first seconds: while it climbs, outputs lift 38 kg of 34 kg.
CLIMB = OutputEvidence(lifted_kg=38.0, load_kg=13.0, over_speeds=0.003, error=0.105)


def flown_so_far(log, airframe_match, **more) -> FlightSoFar:
    return FlightSoFar(
        track=replace(log.track, **more),
        state=VehicleState(system=1, parameters=log.parameters),
        model=MODEL,
        airframe_match=airframe_match,
        faults=[],
        limit=0.5,
        goes_on=False,
    )


def test_a_gauge_that_stood_still_is_left_out_of_the_whole_flight():
    ((log, airframe_match),) = matched_flights(LOG, MODEL, given=False)
    stuck = flown_so_far(log, airframe_match, tank_kg=np.zeros_like(log.track.tank_kg))
    # The rotors carried 16 kg at first, so nothing is asked about the gauge and the empty mass.
    assert stuck.beyond_gauge_kg == 0.0
    assert np.nanmax(stuck.so_far.advice.fill.kg) == pytest.approx(8.69, abs=0.8)


@pytest.mark.parametrize("outputs", [None, CLIMB])
def test_the_fill_rests_on_the_outputs_of_the_whole_flight_not_of_its_first_climb(outputs):
    ((log, airframe_match),) = matched_flights(LOG, MODEL, given=False)
    so_far = flown_so_far(log, replace(airframe_match, outputs=outputs))
    reported = advise(
        analysis_for_verdict(analyse(log.track, MODEL, airframe_match=airframe_match)), limit=0.5
    ).advice
    assert so_far.advice.fill.kg == pytest.approx(reported.fill.kg, abs=0.05)
    assert so_far.advice.fill.kg == pytest.approx(8.69, abs=0.1)
    assert so_far.answer.headline.startswith("FILL LESS: FOR 3 MIN")
