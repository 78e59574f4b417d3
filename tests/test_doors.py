"""Three doors: the pilot's core, the workshop and the office; an extra can be deleted."""

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.import_graph import ROOT, module_graph, modules

DOORS = ("workshop", "office")
EXTRAS = sorted(
    folder.relative_to(ROOT / "gcs_plugin").as_posix()
    for door in DOORS
    for folder in (ROOT / "gcs_plugin" / door).iterdir()
    if (folder / "__init__.py").exists()
)
COMMANDS = {
    "office/cover": {"cover"},
    "office/record": {"record"},
    "office/season": {"fleet"},
    "office/stations": {"install"},
    "office/streams": {"export"},
    "workshop/identify": {"identify"},
    "workshop/learn": {"learn", "match", "train"},
}
#: Imports every module that is there, then names the commands.
LOOK = """
import pkgutil, sys
import thrustmargin.gcs_plugin, thrustmargin.mission, thrustmargin.models
for room in (thrustmargin.models, thrustmargin.mission, thrustmargin.gcs_plugin):
    for module in pkgutil.walk_packages(room.__path__, room.__name__ + "."):
        if "mavproxy" not in module.name:
            __import__(module.name)
from thrustmargin.gcs_plugin import cli
print(*cli.COMMANDS)
"""


def extra_of(module: str) -> str | None:
    """The extra that a module stands in; None in the core."""
    parts = module.split(".")
    inside = len(parts) > 2 and parts[0] == "gcs_plugin" and parts[1] in DOORS
    return "/".join(parts[1:3]) if inside else None


def test_the_core_imports_no_extra_and_no_extra_another():
    across = {
        f"{name} -> {target}"
        for name, targets in module_graph().items()
        for target in targets
        if extra_of(target) not in (None, extra_of(name))
    }
    assert across == set()


def needed(path: Path) -> set[str]:
    """The modules that a file imports when it is loaded or runs, not those of its types alone."""
    tree = ast.parse(path.read_text("utf-8"))
    types = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        for inner in ast.walk(node)
    }
    return {
        node.module or ""
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and id(node) not in types
    }


def test_the_pilots_core_does_without_identification():
    using = {
        name
        for name, path in modules().items()
        if not name.startswith("models.identification") and extra_of(name) is None
        for target in needed(path)
        if target.startswith("thrustmargin.models.identification")
    }
    assert using == set()


def test_every_extra_is_known_here_with_its_commands():
    assert sorted(COMMANDS) == EXTRAS


def without(extras: list[str], folder: Path) -> dict[str, str]:
    """Copy the program without some extras; returns the environment in which it runs."""
    package = folder / "thrustmargin"
    package.mkdir()
    shutil.copy(ROOT / "gcs_plugin/api/__init__.py", package)
    for name in ("models", "mission", "gcs_plugin"):
        shutil.copytree(ROOT / name, package / name, ignore=shutil.ignore_patterns("__pycache__"))
    for extra in extras:
        shutil.rmtree(package / "gcs_plugin" / extra)
    return {**os.environ, "PYTHONPATH": str(folder)}


@pytest.mark.parametrize("extra", EXTRAS)
def test_the_program_runs_without_an_extra_and_lacks_its_commands_alone(extra: str, tmp_path: Path):
    environment = without([extra], tmp_path)
    done = subprocess.run(
        [sys.executable, "-c", LOOK],
        capture_output=True,
        text=True,
        check=False,
        env=environment,
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    everything = set().union(*COMMANDS.values())
    assert set(done.stdout.split()) & everything == everything - COMMANDS[extra]


def test_without_both_doors_a_flight_is_reported_and_forecast(tmp_path: Path):
    environment = without(["workshop", "office"], tmp_path)
    log = ROOT / "sitl_logs/campaign/v4_m16_q2.5.tlog"
    for words in (["report", str(log), "--out", "x.html"], ["forecast", str(log), "--fill", "8"]):
        done = subprocess.run(
            [sys.executable, "-m", "thrustmargin.gcs_plugin.cli", *words],
            capture_output=True,
            text=True,
            check=False,
            env=environment,
            cwd=tmp_path,
        )
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "x.html").stat().st_size > 100_000
