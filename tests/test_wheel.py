"""The wheel, installed where packages named `models` and `mission` stand already."""

import os
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

from tests.import_graph import ROOT, modules

pytestmark = pytest.mark.slow

ENVIRONMENT = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}


def run(*words: str | Path, cwd: Path) -> str:
    done = subprocess.run(
        list(map(str, words)),
        cwd=cwd,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    """Built from a copy, because building leaves folders behind."""
    source = tmp_path_factory.mktemp("source")
    for folder in ("models", "mission", "gcs_plugin", "sitl_logs/campaign"):
        shutil.copytree(
            ROOT / folder, source / folder, ignore=shutil.ignore_patterns("__pycache__")
        )
    for file in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / file, source)
    pip = (sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation")
    run(*pip, "--wheel-dir", source / "dist", source, cwd=source)
    (built,) = (source / "dist").iterdir()
    return built


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory) -> Path:
    """The `bin` of an environment with the wheel, packages of others, and the libraries of this."""
    place = tmp_path_factory.mktemp("installed")
    run(sys.executable, "-m", "venv", "--without-pip", place, cwd=place)
    python = place / "bin" / "python"
    pip = (sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-deps")
    run(*pip, wheel, cwd=place)
    (site,) = place.glob("lib/python*/site-packages")
    (site / "libraries.pth").write_text(sysconfig.get_path("purelib") + "\n")
    for name in ("models", "mission"):
        (site / name).mkdir()
        (site / name / "__init__.py").write_text("of = 'others'\n")
    return place / "bin"


def test_the_wheel_holds_every_module_under_one_name_and_one_flight(wheel: Path):
    names = set(zipfile.ZipFile(wheel).namelist())
    assert {n.split("/")[0] for n in names if ".dist-info/" not in n} == {"thrustmargin"}
    assert [n for n in names if n.endswith(".tlog")] == [
        "thrustmargin/sitl_logs/campaign/v4_m16_q2.5.tlog"
    ]
    files = {p.relative_to(ROOT).as_posix() for p in modules().values()}
    files = {f"thrustmargin/{f}".replace("/gcs_plugin/api/", "/") for f in files}
    assert {n for n in names if n.endswith(".py")} == files
    assert "thrustmargin/py.typed" in names


def test_nothing_clashes_with_packages_named_models_and_mission(installed: Path, tmp_path: Path):
    code = (
        "import models, mission, thrustmargin as tm\n"
        "assert models.of == mission.of == 'others'\n"
        "print(tm.__file__, tm.load_model().airframe.name)\n"
    )
    place, airframe = run(installed / "python", "-c", code, cwd=tmp_path).split()
    assert Path(place).is_relative_to(installed.parent)
    assert airframe == "topxgun-f16-sitl"


def test_the_demo_runs_from_any_folder(installed: Path, tmp_path: Path):
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "__init__.py").write_text("raise ImportError('not this one')\n")
    words = ("--seconds", "1", "--port", "0", "--no-browser")
    said = run(installed / "thrustmargin", "demo", *words, cwd=tmp_path)
    assert "http://127.0.0.1:" in said
    assert (tmp_path / "report.html").stat().st_size > 100_000
