"""The plugin of Mission Planner, compiled and drawn by mono against the interfaces that it uses.

It is skipped where there is no mono, unless THRUSTMARGIN_REQUIRE_MONO is set.
"""

import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[4]
PLUGIN = ROOT / "gcs_plugin/office/stations/mission_planner/thrustmargin.cs"
GREY, BLUE, RED, BLACK = "165,165,165", "66,140,208", "206,66,16", "17,17,17"
EDGES = 2  # columns of the bar's outline; 200 are all


@pytest.fixture(scope="module")
def screen(tmp_path_factory) -> Path:
    if not (shutil.which("mcs") and shutil.which("mono")):
        if os.environ.get("THRUSTMARGIN_REQUIRE_MONO"):
            pytest.fail("THRUSTMARGIN_REQUIRE_MONO is set, and there is no mono (mono-mcs)")
        pytest.skip("no mono")
    made = tmp_path_factory.mktemp("mono") / "screen.exe"
    here = Path(__file__).with_name("stand_ins.cs")
    # C# 5 is what every version of Mission Planner's compiler takes.
    words = ("mcs", "-warn:4", "-warnaserror", "-langversion:5", f"-out:{made}")
    libraries = ("-r:System.Drawing", "-r:System.Windows.Forms")
    done = subprocess.run([*words, *libraries, PLUGIN, here], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return made


@dataclass(frozen=True)
class Drawn:
    first: str
    second: str
    filled: int  # bright columns of 200 in the bar
    tall: int  # bright rows of 20 near its left end, two of them its outline
    left: str  # its colours
    edge: str


def drawn(screen: Path, *commands: str) -> list[Drawn]:
    told = "\n".join(commands) + "\n"
    done = subprocess.run(
        ["mono", screen], input=told, capture_output=True, text=True, check=True, timeout=200
    )
    rows = [line.split("|") for line in done.stdout.splitlines()]
    return [Drawn(a, b, int(n), int(m), left, edge) for a, b, n, m, left, edge in rows]


def heard(at: float, **figures: float) -> list[str]:
    return [f"take {at} {name} {value}" for name, value in figures.items()]


LOW = heard(10.0, MARGIN=41.7, MARGIN_ROT=3, MARGIN_LIM=50, MARGIN_DO=2, MARGIN_PRE=44)


def test_the_bar_shows_margin_rotor_action_and_age(screen: Path):
    (shown,) = drawn(screen, *LOW, "draw 11.2")
    assert (shown.first, shown.second) == ("Thrust left 41%, rotor 3", "fly gently  (1 s old)")
    assert (shown.left, shown.tall) == (RED, 20)
    assert 83 <= shown.filled <= 83 + EDGES + 2  # 41.7 % of 200, its outline, the limit's mark


def test_above_the_limit_it_is_blue_and_asks_for_nothing(screen: Path):
    (shown,) = drawn(screen, *heard(5, MARGIN=62, MARGIN_LIM=50, MARGIN_DO=0), "draw 5.1")
    assert (shown.first, shown.second, shown.left) == ("Thrust left 62%", "0 s old", BLUE)


def test_an_old_value_has_no_bar_and_no_colour(screen: Path):
    old, forgotten, never = drawn(screen, *LOW, "draw 13.1", "draw 70.5", "draw 5")[:3]
    for shown in (old, forgotten):
        assert shown.first == "Thrust left unknown"
        assert (shown.filled, shown.left, shown.edge) == (EDGES, BLACK, GREY)
    assert old.second == "was 41%, 3 s ago"
    assert forgotten.second == "nothing heard"
    assert never.first


def test_a_prediction_says_so_and_without_a_limit_nothing_is_judged(screen: Path):
    (shown,) = drawn(screen, *heard(10, MARGIN_PRE=44, MARGIN_ROT=3), "draw 10.5")
    assert shown.first == "Predicted thrust left 44%"
    assert (shown.edge, shown.tall) == (GREY, 10)  # a bar of 8 rows: nothing was measured


def test_an_action_of_a_newer_sender_is_left_out(screen: Path):
    last, beyond = drawn(
        screen, *LOW, "take 10 MARGIN_DO 5", "draw 10.1", "take 10 MARGIN_DO 6", "draw 10.1"
    )
    assert last.second == "CONTROL LOST  (0 s old)"
    assert beyond.second == "0 s old"


def test_a_link_that_was_replaced_is_heard_no_more(screen: Path):
    (shown,) = drawn(screen, "relink 0", "packet 1 MARGIN 60", "stray 1 MARGIN 90", "current 1")
    assert shown.first == "Thrust left 60%"


@pytest.mark.parametrize("value", ["NaN", "Infinity"])
def test_what_is_no_number_is_no_longer_known_at_once(screen: Path, value: str):
    lost, again = drawn(
        screen, *LOW, f"take 11 MARGIN {value}", "draw 11.1", "take 12 MARGIN 60", "draw 12.1"
    )
    assert lost.first == "Predicted thrust left 44%"
    assert again.first == "Thrust left 60%, rotor 3"
    (unknown,) = drawn(screen, *heard(10, MARGIN=41), f"take 11 MARGIN {value}", "draw 11.5")
    assert (unknown.first, unknown.second) == ("Thrust left unknown", "was 41%, 1 s ago")
    assert (unknown.filled, unknown.left) == (EDGES, BLACK)


def test_packets_of_the_vehicle_that_is_shown_reach_the_bar(screen: Path):
    one, two, three = drawn(
        screen, "packet 1 MARGIN 60", "packet 2 MARGIN 30", "current 1", "current 2", "current 3"
    )
    assert [one.first, two.first, three.first] == [
        "Thrust left 60%",
        "Thrust left 30%",
        "Thrust left unknown",
    ]


def test_it_asks_in_the_words_of_the_alarms(screen: Path):
    done = subprocess.run(["mono", screen, "x"], capture_output=True, text=True, check=True)
    asked = ["", "see messages", "fly gently", "slow down", "land", "CONTROL LOST"]
    assert done.stdout.strip("\n").split("|") == asked
