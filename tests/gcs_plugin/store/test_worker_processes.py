"""Work in several processes: in order, in this process where there is one, and a death is said."""

import os

import pytest

from thrustmargin.gcs_plugin.store.worker_processes import in_processes
from thrustmargin.models.errors import DataError


def where(number: int) -> tuple[int, int]:
    return number, os.getpid()


def die(number: int) -> None:
    os._exit(number)


def test_with_one_process_or_one_item_it_is_this_process():
    assert list(in_processes(where, [3, 1], 1)) == [(3, os.getpid()), (1, os.getpid())]
    assert list(in_processes(where, [3], 4)) == [(3, os.getpid())]
    assert list(in_processes(where, [], 4)) == []


def test_with_several_the_results_are_in_order_and_of_other_processes():
    found = list(in_processes(where, range(4), 2))
    assert [number for number, _ in found] == [0, 1, 2, 3]
    assert os.getpid() not in {process for _, process in found}


def test_a_process_that_dies_is_an_error_of_one_line():
    with pytest.raises(DataError, match="a process died"):
        list(in_processes(die, [1, 2], 2))
