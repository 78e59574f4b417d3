"""Fixtures shared by all tests: recorded flights, and the folder of measured data if given."""

import gc
import os
import shutil
import signal
import sys
import tempfile
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# Before numpy is loaded, and for programs that tests start: with small matrices the threads of
# several workers would only wait for each other.
for threads in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(threads, "1")
ROOT = Path(__file__).resolve().parents[1]
# How long a busy machine takes is no property of what is tested.
settings.register_profile(
    "any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("any machine")


def pytest_configure() -> None:
    """Heed Ctrl-C even when started where it is ignored, as a shell does to background jobs.

    A child inherits an ignored signal, and the tests of a clean stop would wait for ever.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    # A program that a test starts would compile all modules anew each time: half of its start. So
    # would each worker with all tests.
    if os.environ.pop("PYTHONDONTWRITEBYTECODE", None):
        sys.dont_write_bytecode = False
    # What the developer's own aircraft taught must not reach a test, nor a day that was stated.
    os.environ["THRUSTMARGIN_HANGAR"] = os.devnull + ".none"
    os.environ["XDG_STATE_HOME"] = tempfile.mkdtemp(prefix="thrustmargin-state-")
    gc.disable()  # of what is collected nothing is garbage, and looking for it takes a third of it


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.set_threshold(50_000)  # as of the command
    gc.enable()


@pytest.hookimpl(trylast=True)  # after pytest has looked once, among what is new
def pytest_unconfigure() -> None:
    shutil.rmtree(os.environ["XDG_STATE_HOME"], ignore_errors=True)
    gc.unfreeze()  # libraries count at the end what nobody has freed
    gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Modules with most slow tests first, so that no worker is left with one at the end."""
    slow = Counter(
        item.path for item in items for mark in ("slow", "browser") if item.get_closest_marker(mark)
    )
    items.sort(key=lambda item: -slow[item.path])


@pytest.fixture(autouse=True)
def no_remembered_day(
    request: pytest.FixtureRequest,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """Give each test a folder of state of its own: no day of another test or of the user's."""
    name = f"state-{abs(hash(request.node.nodeid)):x}"
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path_factory.getbasetemp() / name))


@pytest.fixture(scope="session")
def sitl_logs() -> Path:
    return ROOT / "sitl_logs"


@pytest.fixture(scope="session")
def measured_folder() -> Path:
    folder = os.environ.get("THRUSTMARGIN_MEASURED", "")
    if not folder or not Path(folder).is_dir():
        pytest.skip("THRUSTMARGIN_MEASURED does not name the folder of measured data")
    return Path(folder)
