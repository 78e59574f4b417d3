"""Imports point one way, down from the commands to the errors; docs/architecture.md draws it."""

import graphlib
import subprocess
import sys

import pytest

from tests.import_graph import ROOT, floors, imported, module_graph, modules, room, room_graph
from tests.import_graph import rooms as all_rooms

#: From the ground up; rooms on one line know nothing of each other.
ORDER = (
    ("models",),
    ("models.physics",),
    ("models.network", "models.checks"),
    ("models.effects",),
    ("models.model",),
    ("models.identification",),
    ("mission",),
    ("gcs_plugin.wording", "gcs_plugin.mavlink"),
    ("gcs_plugin.link", "gcs_plugin.telemetry"),
    ("gcs_plugin.logs", "gcs_plugin.store"),
    ("gcs_plugin.live",),
    ("gcs_plugin.vehicle", "gcs_plugin.view"),
    ("gcs_plugin.reports",),
    ("gcs_plugin.commands",),
    ("gcs_plugin.workshop", "gcs_plugin.office"),
    ("gcs_plugin",),
)
RANK = {name: rank for rank, line in enumerate(ORDER) for name in line}
#: What a room may not import though it stands above it, and why.
KEPT_APART = {
    ("gcs_plugin.reports", "gcs_plugin.view"): "a page needs no screen",
    ("gcs_plugin.reports", "gcs_plugin.vehicle"): "a page needs no aircraft",
    ("gcs_plugin.reports", "gcs_plugin.live"): "a page is made from a log",
}
#: Libraries of the edge, which arrays in, arrays out has no use for.
EDGE = {"pymavlink", "mavsdk", "viser", "socket", "pyulog", "pyarrow", "plotly", "MAVProxy"}


def upward(targets_of: dict[str, set[str]]) -> list[str]:
    """Imports that do not point down, as `a -> b`."""
    return [
        f"{name} -> {target}"
        for name, targets in targets_of.items()
        for target in sorted(targets)
        if room(name) != room(target)
        and (RANK[room(target)] >= RANK[room(name)] or (room(name), room(target)) in KEPT_APART)
    ]


def test_every_room_has_its_place_in_the_order():
    assert sorted(all_rooms()) == sorted(RANK)


def test_every_import_points_down():
    assert upward(module_graph()) == []


@pytest.mark.parametrize(
    ("name", "target"),
    [
        ("models.errors", "models.flight"),
        ("models.physics.thrust", "models.network.network"),
        ("models.network.network", "models.checks.motor_order"),
        ("gcs_plugin.reports.shared.page_shell", "gcs_plugin.view.page.view_page"),
        ("gcs_plugin.link.transport", "gcs_plugin.telemetry.rows"),
        ("mission.plan", "gcs_plugin.cli"),
    ],
)
def test_an_import_that_points_up_or_aside_is_seen(name: str, target: str):
    assert name in modules()
    assert target in modules()
    seen = upward({name: {target}})
    assert seen == ([] if room(name) == room(target) else [f"{name} -> {target}"])


def test_errors_and_sources_know_nothing_and_the_flight_only_them():
    graph = module_graph()
    assert graph["models"] == graph["models.errors"] == set()
    assert graph["models.statement"] == set()
    assert graph["models.provenance"] == {"models.statement"}
    assert graph["models.flight"] == {"models.errors", "models.provenance", "models.statement"}


def test_no_modules_import_each_other_in_a_circle():
    try:
        order = list(graphlib.TopologicalSorter(module_graph()).static_order())
    except graphlib.CycleError as circle:
        pytest.fail(" -> ".join(circle.args[1]))
    assert len(order) == len(modules())


def test_the_house_has_at_most_22_rooms_on_12_floors():
    assert len(all_rooms()) <= 22
    heights = floors(room_graph())
    assert max(heights.values()) <= 12, heights


def test_pages_of_different_kinds_share_only_what_is_shared():
    kinds = {"identify", "margin", "model"}
    of_the_margin_report = {"streams", "record"}  # the same numbers in other files
    for name, targets in module_graph().items():
        if name.startswith("gcs_plugin.reports."):
            own = name.split(".")[2]
            seen = {t.split(".")[2] for t in targets if t.startswith("gcs_plugin.reports.")}
            allowed = {"margin" if own in of_the_margin_report else own}
            assert seen & kinds <= allowed & kinds, name


@pytest.mark.parametrize("package", ["models", "mission"])
def test_arrays_in_arrays_out_needs_no_library_of_the_edge(package: str):
    libraries = {
        name: {m.split(".")[0] for m in imported(path)} & EDGE
        for name, path in modules().items()
        if name.split(".")[0] == package
    }
    assert {name: found for name, found in libraries.items() if found} == {}


def test_only_the_network_and_fitting_name_torch():
    naming = {
        room(name)
        for name, path in modules().items()
        if any(m.split(".")[0] == "torch" for m in imported(path))
    }
    assert naming <= {"models.network", "models.effects", "models.identification"}


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
