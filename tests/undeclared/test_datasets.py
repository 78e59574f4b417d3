"""Sealed data sets hold what they say, and the truth stays outside of the code under test."""

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.undeclared.changes import NAMED
from tests.undeclared.datasets import AIRCRAFT, KINDS, DataSet, bare, build
from tests.undeclared.outside import OUTSIDE
from tests.undeclared.truth import expected, rms, settled

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def sets() -> dict[str, DataSet]:
    return {kind: build(kind, seed=77) for kind in KINDS}


@pytest.mark.parametrize("kind", [*NAMED, "two"])
def test_each_change_explains_the_residual_that_it_makes(sets, kind):
    data = sets[kind]
    healthy = AIRCRAFT if data.base == "trained" else bare(data.layout)
    assert any(m.drawn for m in data.missing)
    signal, residual = [], []
    for f in data.fit:
        rows, without = settled(f), expected(f, replace(healthy, layout=f.physics.layout))
        signal.append((expected(f, f.physics) - without)[rows].ravel())
        residual.append((f.track.rotor_speed_rpm - without)[rows].ravel())
    change, left = np.concatenate(signal), np.concatenate(residual)
    assert change @ left / (change @ change) == pytest.approx(1.0, abs=0.25)
    assert rms([left - change]) < 18.0


def test_asked_changes_move_rotor_speeds_enough_to_be_found(sets):
    for kind, data in sets.items():
        assert all(m.asked for m in data.missing if m.drawn), kind
        assert data.floor_rpm < 18.0, kind
        assert (data.outside_rpm >= 8.0) == (kind in OUTSIDE), kind


def test_nothing_missing_means_nothing(sets):
    data = sets["none"]
    assert data.asked == ()
    healthy = AIRCRAFT if data.base == "trained" else bare(data.layout)
    for f in data.fit:
        assert rms([(f.track.rotor_speed_rpm - expected(f, healthy))[settled(f)]]) < 18.0


@pytest.mark.parametrize("kind", ["wind", "surge"])
def test_a_seed_gives_the_same_data_set_again_and_another_gives_another(kind):
    first, again, other = (build(kind, seed=s).fit[0].track for s in (9, 9, 10))
    for channel in ("rotor_speed_rpm", "tank_kg", "specific_force_frd", "airspeed"):
        np.testing.assert_array_equal(getattr(first, channel), getattr(again, channel))
    assert first.time_s.size != other.time_s.size or np.any(
        first.rotor_speed_rpm != other.rotor_speed_rpm
    )


def imports_of(path: Path) -> set[str]:
    tree = ast.parse(path.read_text(encoding="utf-8"))
    named = {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) and n.module}
    return named | {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}


def test_the_plant_shares_no_code_with_what_it_tests():
    for path in Path(__file__).parent.glob("*.py"):
        if path.name != "subject.py":
            of_models = {m for m in imports_of(path) if m.split(".")[0] in ("models", "mission")}
            assert of_models <= {"thrustmargin.models.flight"}, path.name


def test_the_code_subject_has_no_name_for_an_outside_effect():
    text = "\n".join(p.read_text("utf-8").lower() for p in (ROOT / "models").rglob("*.py"))
    for name in OUTSIDE:
        for spelling in (name, name.replace(" ", "_"), name.replace("-", "_").replace(" ", "_")):
            assert spelling == "surge" or spelling not in text
