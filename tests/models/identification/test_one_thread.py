"""Linear algebra of the loop runs on one thread, however many the process may use."""

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from tests.models.made_flights import F16, curve_model, made_flights, table
from thrustmargin.models.identification.good_flights.commissioning import commission
from thrustmargin.models.identification.loop import identify

FLIGHTS = made_flights(3, duration=60.0)


class Stopped(Exception):
    pass


def most_threads() -> int:
    return max(pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas")


def identified(progress):
    identify(FLIGHTS, curve_model(), catalogue=table(["extra_mass"]), progress=progress)


def commissioned(progress):
    commission(None, FLIGHTS, F16, date="2025-06-01", progress=progress)


@pytest.mark.parametrize("run", [identified, commissioned])
def test_identify_and_the_calibration_of_train_use_one_thread_and_then_what_was_set(run):
    seen = []

    def note(*_: object) -> None:
        seen.append(most_threads())
        raise Stopped

    with threadpool_limits(2):
        with pytest.raises(Stopped):
            run(note)
        seen.append(most_threads())
    assert seen == [1, 2]
