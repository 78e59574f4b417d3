"""Fixtures shared by all tests: recorded flights, and the folder of measured data if given."""

import os
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def sitl_logs() -> Path:
    return ROOT / "sitl_logs"


@pytest.fixture(scope="session")
def measured_folder() -> Path:
    folder = os.environ.get("THRUSTMARGIN_MEASURED", "")
    if not folder or not Path(folder).is_dir():
        pytest.skip("THRUSTMARGIN_MEASURED does not name the folder of measured data")
    return Path(folder)
