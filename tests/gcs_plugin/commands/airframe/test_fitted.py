"""`airframe new --bench` and `--hover`: fitted values with their source and interval."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.gcs_plugin.logs.csv_files import write_csv
from thrustmargin.gcs_plugin.cli import run
from thrustmargin.gcs_plugin.commands.airframe.fitted import ceiling_notes, with_data_sheet
from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.physics.airframe import load_airframe
from thrustmargin.models.scores import Estimate

ROOT = Path(__file__).resolve().parents[4]
SLOW = [str(ROOT / f"sitl_logs/campaign/v2_m{kg}_q1.5.tlog") for kg in (4, 10, 16)]
F16 = ["--layout", "quad-x", "--cells", "14", "--arm", "0.96", "--mass", "21.1"]
F16 += ["--tank-litres", "16", "--power-set", "hobbywing-x9-plus"]


@pytest.fixture
def made(tmp_path, capsys):
    """The airframe that `airframe new` makes with some options, and what was printed."""

    def make(*options: str):
        out = tmp_path / "mine.toml"
        code = run(["airframe", "new", "--out", str(out), "--force", *options])
        printed = capsys.readouterr()
        return (load_airframe(out) if code == 0 else None), printed.out + printed.err

    return make


def ends_of(source: str) -> tuple[float, float]:
    """The interval that a source states, as "(4810 to 6570)"."""
    found = re.search(r"\((\S+) to (\S+)\)", source)
    assert found
    return float(found[1]), float(found[2])


def test_hover_gives_the_simulators_curve_with_its_flights_and_interval(made):
    craft, printed = made("--hover", *SLOW, *F16)
    found = craft.quantities["thrust_coefficient"]
    at_sea_level = found.value * 1.225 / craft.reference_density
    assert at_sea_level == pytest.approx(2.011e-5, rel=0.015)
    assert not found.guessed
    assert re.search(
        r"fitted: hover of v2_m4_q1\.5\.tlog.* at 21\.1 kg and its liquid", found.source
    )
    low, high = ends_of(found.source)
    assert low < 2.011e-5 * craft.reference_density / 1.225 < high
    assert "thrust of each rotor over its share" in printed


def test_without_rotor_speeds_the_weight_sets_the_ceiling_and_says_so(made, tmp_path):
    log = read_log(SLOW[1], airframe=load_airframe("topxgun-f16-sitl"))
    silent = np.full_like(log.track.rotor_speed_rpm, np.nan)
    write_csv(replace(log.track, rotor_speed_rpm=silent), tmp_path / "silent.csv")
    craft, printed = made("--hover", str(tmp_path / "silent.csv"), *F16)
    assert "no rotor speed in silent.csv" in printed
    assert craft.quantities["max_rotor_speed_rpm"].guessed
    # The simulation makes 181 N a rotor at 58.8 V; its motors' curve is not the one assumed here.
    ends = ends_of(craft.quantities["max_rotor_speed_rpm"].source)
    low, high = (craft.thrust_coefficient * end**2 for end in ends)
    assert low < 181.0 * (craft.ceiling_voltage / 58.8) ** 2 < high


def test_a_climb_at_full_throttle_settles_the_ceiling(made, tmp_path):
    """A recorded hover with 4 s at the end of it at full output and 3,000 rpm."""
    track = read_log(SLOW[0], airframe=load_airframe("topxgun-f16-sitl")).track
    extrapolated, printed = made("--hover", SLOW[0], *F16)
    assert extrapolated.quantities["max_rotor_speed_rpm"].guessed
    assert re.search(r"a hover at 37\.1 kg uses \d+ % to \d+ % of it\. A climb at full", printed)
    flying = np.flatnonzero(track.flying)
    end = track.time_s[flying[-1]]
    up = track.flying & (track.time_s > end - 8.0) & (track.time_s < end - 4.0)
    full = np.where(up[:, None], 0.95, track.throttle)  # MOT_SPIN_MAX of these flights
    fast = np.where((up & (track.time_s > end - 7.5))[:, None], 3000.0, track.rotor_speed_rpm)
    write_csv(replace(track, throttle=full, rotor_speed_rpm=fast), tmp_path / "climb.csv")
    craft, printed = made("--hover", str(tmp_path / "climb.csv"), *F16)
    found = craft.quantities["max_rotor_speed_rpm"]
    assert not found.guessed
    assert found.value == pytest.approx(3000.0, rel=0.01)
    assert found.source.startswith("measured: climb at full output, climb.csv, ")
    low, high = ends_of(found.source)
    assert 2800.0 < low < 2950.0
    assert 3050.0 < high < 3200.0
    assert "full thrust is extrapolated" not in printed


def test_the_makers_thrust_counts_beside_an_extrapolated_ceiling():
    """Two estimates of one speed: the nearer to both by its certainty, and surer than either."""
    seen = Estimate(value=5638.0, low=4866.0, high=6531.0)  # 15 % of thrust
    both = with_data_sheet(seen, 6000.0)
    assert 5638.0 < both.value < 6000.0
    assert np.log(both.high / both.low) < np.log(seen.high / seen.low)
    # As far apart as this one of them is wrong: the interval reaches to both.
    apart = with_data_sheet(seen, 8500.0)
    assert np.log(apart.high / apart.low) > np.log(both.high / both.low)
    sure = with_data_sheet(Estimate(value=5638.0, low=5600.0, high=5676.0), 6000.0)
    assert sure.value == pytest.approx(5638.0, rel=0.005)


def test_an_extrapolated_ceiling_has_its_own_error_in_the_file(made):
    craft, _ = made("--hover", *SLOW, *F16)
    ceiling = craft.quantities["max_rotor_speed_rpm"]
    assert ceiling.guessed
    assert "by the maker's thrust" in ceiling.source
    assert 0.05 < ceiling.thrust_error < 0.2


def test_a_bench_table_gives_curve_and_ceiling_without_a_power_set(made, tmp_path):
    speed = np.linspace(1000.0, 3000.0, 9)
    rows = [f"{30 + 8.75 * k},{n},{2e-5 * n**2},48" for k, n in enumerate(speed)]
    bench = tmp_path / "bench.csv"
    bench.write_text("\n".join(["throttle,rpm,thrust_N,voltage", *rows]))
    owner = [*F16[:-2], "--propeller", "36x11.5"]
    craft, printed = made("--bench", str(bench), *owner)
    assert craft.thrust_coefficient == pytest.approx(2e-5)
    assert craft.max_rotor_speed_rpm == 3000.0
    assert craft.ceiling_voltage == 48.0
    assert not {"thrust_coefficient", "max_rotor_speed_rpm", "ceiling_voltage"} & {*craft.guessed}
    assert "T = a N² holds" in printed
    half, _ = made("--bench", str(bench), *owner, "--max-thrust-kgf", "20")
    assert half.nameplate_max_thrust == pytest.approx(196.133)  # what is stated comes first


def test_a_makers_thrust_that_the_flights_do_not_reach_is_told_apart():
    craft = load_airframe("topxgun-f16-sitl")
    reached = craft.thrust_coefficient * craft.max_rotor_speed_rpm**2
    assert ceiling_notes(replace(craft, nameplate_max_thrust=1.05 * reached)) == ()
    (note,) = ceiling_notes(replace(craft, nameplate_max_thrust=1.4 * reached))
    assert f"{1.4 * reached:.1f} N by its maker, {reached:.1f} N by thrust curve" in note


def test_a_flight_without_hover_is_refused_with_what_to_give(made):
    _, printed = made("--hover", str(ROOT / "sitl_logs/dev/windy_1.tlog"), *F16)
    assert "0 rows of steady hover" in printed
    assert "hovers for ten seconds" in printed
