"""Imports point one way: models <- mission <- gcs_plugin."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FORBIDDEN = {
    "models": {"mission", "gcs_plugin", "pymavlink", "mavsdk", "viser", "socket", "pyulog"},
    "mission": {"gcs_plugin", "pymavlink", "viser", "socket"},
}


def imported_roots(path: Path) -> set[str]:
    roots: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            roots |= {
                alias.name.removeprefix("thrustmargin.").split(".")[0] for alias in node.names
            }
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            roots.add(node.module.removeprefix("thrustmargin.").split(".")[0])
    return roots


@pytest.mark.parametrize("package", sorted(FORBIDDEN))
def test_a_layer_imports_nothing_above_it(package: str):
    files = list((ROOT / package).rglob("*.py"))
    assert files
    broken = {
        str(f.relative_to(ROOT)): sorted(imported_roots(f) & FORBIDDEN[package])
        for f in files
        if imported_roots(f) & FORBIDDEN[package]
    }
    assert broken == {}


def test_the_scan_sees_an_import_that_points_up(tmp_path: Path):
    bad = tmp_path / "bad.py"
    bad.write_text("def f():\n    from thrustmargin.gcs_plugin.cli import main\n    return main\n")
    assert "gcs_plugin" in imported_roots(bad)


def test_only_the_network_and_fitting_name_torch():
    naming = {
        str(f.relative_to(ROOT))
        for package in ("models", "mission", "gcs_plugin")
        for f in (ROOT / package).rglob("*.py")
        if "torch" in imported_roots(f)
    }
    assert naming == {
        "models/network/network.py",
        "models/identification/fit.py",
        "models/identification/problem.py",
        "models/effects/channels.py",
    }


def test_help_does_not_load_torch_or_the_view():
    code = (
        "import sys\nfrom thrustmargin.gcs_plugin.cli import run\n"
        "try:\n    run(['--help'])\nexcept SystemExit as e:\n    assert e.code == 0\n"
        "heavy = {'torch', 'viser', 'plotly', 'matplotlib', 'mavsdk'} & set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr
