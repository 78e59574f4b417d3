"""Processor seconds a flight of `learn --store` and `report`, and of pymavlink's reading alone.

Each command is a process of its own, imports and all. What a flight adds to `learn` is the
difference of two runs, one of many flights and one of few.
"""

from pathlib import Path

from tests.lab.bench.bench_intake import MODULE, make_logs, seconds_of_pymavlink, timed
from tests.mission.fields_made import outline, rectangle
from thrustmargin.gcs_plugin.office.cover.coverage_plan import CoverageOrder, cover_field

FEW, MANY = 4, 34


def test_learn_into_a_store(benchmark, tmp_path):
    logs = make_logs(tmp_path, FEW + MANY)
    store = ["--store", str(tmp_path / "store"), "--workers", "1", "--quiet"]
    spent: list[float] = []

    def measure() -> None:
        for some in (logs[:FEW], logs[FEW:]):
            code, _, core = timed([*MODULE, "learn", *map(str, some), *store])
            assert code == 0
            spent.append(core)

    benchmark.pedantic(measure, rounds=1)
    each = (spent[1] - spent[0]) / (MANY - FEW)
    theirs = seconds_of_pymavlink(logs[:FEW]) / FEW
    print(
        f"\nlearn: {each:.3f} s of processor a flight beside {spent[0] - FEW * each:.1f} s a run; "
        f"pymavlink reads such a log in {theirs:.3f} s: {each / theirs:.2f} x"
    )


def test_help(benchmark):
    """It is there before a person waits for it: 0.3 s."""
    runs = []
    benchmark.pedantic(lambda: runs.append(timed([*MODULE, "--help"])), rounds=3)
    assert not any(code for code, _, _ in runs)
    spent = min(core for _, _, core in runs)
    print(f"\nhelp: {spent:.2f} s of processor")
    assert spent < 0.3


def test_500_hectares_are_covered_in_seconds(benchmark):
    field = outline(rectangle(2500.0, 2000.0))
    order = CoverageOrder(swath=5.0, speed=5.0, height=3.0, heading_deg=0.0)
    found = benchmark.pedantic(lambda: cover_field(field, order), rounds=1)
    assert len(found.lines.lines) == 500
    assert benchmark.stats.stats.min < 5.0


def test_report(benchmark, sitl_logs: Path, tmp_path):
    log = sitl_logs / "campaign" / "v4_m16_q2.5.tlog"
    words = [*MODULE, "report", str(log), "--out", str(tmp_path / "report.html"), "--quiet"]
    runs = []
    benchmark.pedantic(lambda: runs.append(timed(words)), rounds=3)
    assert not any(code for code, _, _ in runs)
    ours, theirs = min(core for _, _, core in runs), seconds_of_pymavlink([log])
    print(
        f"\nreport of a flight of 4 minutes: {ours:.2f} s of processor; pymavlink reads its log in "
        f"{theirs:.2f} s: {ours / theirs:.1f} x"
    )
