"""`import thrustmargin as tm`: what docs/python.md and the docstrings show runs as it stands."""

import doctest
import inspect
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

import thrustmargin as tm
from thrustmargin.models.errors import DataError

ROOT = Path(__file__).resolve().parents[3]
SLOW = {"identify"}


def test_the_public_names_are_these():
    names = ["LiveMonitor", "advise", "analyse", "forecast", "identify", "load_model"]
    names += ["read_log", "read_plan", "read_sorties"]
    assert tm.__all__ == names
    assert dir(tm) == tm.__all__
    with pytest.raises(AttributeError, match="has no attribute 'analyze'"):
        _ = tm.analyze  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] if n in SLOW else []) for n in tm.__all__]
)
def test_the_example_of_each_public_name_runs(name: str, monkeypatch):
    monkeypatch.chdir(ROOT)
    thing = getattr(tm, name)
    scope = {n: getattr(tm, n) for n in tm.__all__} | {"np": sys.modules["numpy"]}
    text = inspect.getdoc(thing)
    assert text
    example = doctest.DocTestParser().get_doctest(text, scope, name, None, 0)
    assert example.examples, f"{name} has no example"
    assert not doctest.DocTestRunner().run(example).failed


@pytest.mark.slow
def test_the_lines_of_the_page_for_python_run():
    lines = re.findall(r"```python\n(.*?)```", (ROOT / "docs/python.md").read_text("utf-8"), re.S)
    assert len(lines) == 1
    done = subprocess.run(
        [sys.executable, "-c", lines[0]], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "rotor_degradation" in done.stdout


def test_importing_the_package_loads_nothing_else():
    code = (
        "import sys; import thrustmargin; "
        "print([m for m in sys.modules if m.startswith('thrustmargin.') or m == 'numpy'])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.slow
def test_a_type_checker_sees_the_public_names(tmp_path: Path):
    use = tmp_path / "use.py"
    use.write_text(
        "import thrustmargin as tm\n"
        "track = tm.read_log('a.tlog').track\n"
        "reveal_type(tm.analyse(track, tm.load_model()))\n"
        "tm.identify(1)\n"
        "tm.analyze\n"
    )
    (tmp_path / "pyrightconfig.json").write_text(
        f'{{"extraPaths": ["{ROOT}/.venv/links"], "venvPath": "{ROOT}", "venv": ".venv"}}'
    )
    done = subprocess.run(
        [str(Path(sys.executable).with_name("pyright")), "-p", str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert 'is "FlightAnalysis"' in done.stdout
    assert len(re.findall(r" - error: ", done.stdout)) == 2, done.stdout


def test_a_flight_that_is_refused_is_told_why_in_sentences():
    log = tm.read_log(ROOT / "sitl_logs/dev/worn_prop_1.tlog")
    wrong = replace(log.track, rotor_speed_rpm=10.0 * log.track.rotor_speed_rpm)
    with pytest.raises(
        DataError, match=r"worn_prop_1.tlog: .* the ESC looks to report electrical rpm"
    ):
        tm.identify(wrong, tm.load_model())
