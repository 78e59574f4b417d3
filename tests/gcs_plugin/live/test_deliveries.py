"""The alarms of a stream are the same: smooth, in bursts or on a slow computer."""

from functools import cache

import pytest

from tests.gcs_plugin.live.delivered import DELIVERIES, SMOOTH, at_esc_rate, events_of, told
from tests.gcs_plugin.live.live_vehicle import ROOT, Vehicle, log_frames
from tests.gcs_plugin.live.monitored import MODEL
from thrustmargin.gcs_plugin.mavlink.frame import Frame
from thrustmargin.models.model.model_file import shipped_model

BAD_ROTOR = ROOT / "sitl_logs" / "onset" / "worn_prop_onset.tlog"
ESC = 11030  # ESC_TELEMETRY_1_TO_4
#: s by which an alarm may come at another time in bursts: messages without a clock of their own
#: take the newest one's, a row earlier, and a rotor's test may go on by a block.
IN_BURSTS = 1.1


@cache
def bad_rotor(rate_hz: float) -> tuple[Frame, ...]:
    """A flight whose propeller loses 12 % after 2.4 minutes."""
    return tuple(at_esc_rate(log_frames(BAD_ROTOR), rate_hz))


@cache
def smooth_events(rate_hz: float) -> tuple[tuple, ...]:
    return tuple(told(events_of(bad_rotor(rate_hz), shipped_model(), SMOOTH)))


@pytest.mark.parametrize(
    ("rate_hz", "delivery"),
    [
        (1.0, "bursts on a slow computer"),
        (3.0, "bursts"),
        (3.0, "slow"),
        (10.0, "bursts on a slow computer"),
    ],
)
@pytest.mark.slow
def test_a_bad_rotor_is_named_however_its_messages_come(rate_hz, delivery):
    frames, model, usual = bad_rotor(rate_hz), shipped_model(), smooth_events(rate_hz)
    assert ("raised", "rotor", 3) in [event[1:4] for event in usual]
    assert "rotor speeds" not in [event[2] for event in usual]
    made = told(events_of(frames, model, DELIVERIES[delivery]))
    assert [event[:4] for event in made] == [event[:4] for event in usual]
    allowed = IN_BURSTS if DELIVERIES[delivery].burst_s else 0.0
    assert [event[4] for event in made] == pytest.approx(
        [event[4] for event in usual], abs=allowed + 1e-9
    )


def flown(*, lost_from_s: float, lost_until_s: float) -> list[Frame]:
    """40 s of two vehicles. ESC messages of the first are missing between two times; it says
    nothing at all from 34 s to 38 s."""
    vehicles, frames = (Vehicle(1), Vehicle(2, clock_s=500.0)), []
    for tenth in range(400):
        for vehicle in vehicles:
            made = vehicle.tick(rpm=(1700,) * 4)
            now_s = tenth / 10
            if vehicle is vehicles[0] and lost_from_s <= now_s < lost_until_s:
                made = [frame for frame in made if frame.id != ESC]
            if vehicle is vehicles[0] and 34.0 <= now_s < 38.0:
                made = []
            frames += made
    return frames


@pytest.mark.parametrize("delivery", DELIVERIES)
def test_only_speeds_that_do_not_come_are_missed(delivery):
    for lost_until_s, missed in ((19.0, []), (30.0, ["raised", "cleared"])):
        frames = flown(lost_from_s=18.0, lost_until_s=lost_until_s)
        usual = told(events_of(frames, MODEL, SMOOTH))
        speeds = [event for event in usual if event[2] == "rotor speeds"]
        assert [(event[0], event[1]) for event in speeds] == [(1, kind) for kind in missed]
        if missed:
            # By the vehicle's clock, which began at 100 s: 3 s after the last speed.
            assert [event[4] for event in speeds] == pytest.approx([121.2, 131.2], abs=0.25)
        made = told(events_of(frames, MODEL, DELIVERIES[delivery]))
        link = ("telemetry", "unconfirmed", "confirmed")
        of_rows = [[e for e in es if e[2] not in link and e[1] not in link] for es in (made, usual)]
        assert sorted(e[:4] for e in of_rows[0]) == sorted(e[:4] for e in of_rows[1])
        assert sorted(e[4] for e in of_rows[0]) == pytest.approx(
            sorted(e[4] for e in of_rows[1]), abs=0.15
        )
        assert [e[0] for e in made if e[1:3] == ("raised", "telemetry")] == [1]
