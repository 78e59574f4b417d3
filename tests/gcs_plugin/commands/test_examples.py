"""Every example of every --help runs as it stands, from an empty folder, on what is bundled."""

import re
import shlex
from collections.abc import Iterator

import pytest

from thrustmargin.gcs_plugin.cli import COMMANDS, USAGE, command_function, run
from thrustmargin.gcs_plugin.commands.airframe.check import (
    AirframeCheck,
    AirframeList,
    AirframeShow,
)
from thrustmargin.gcs_plugin.commands.airframe.new import AirframeNew
from thrustmargin.gcs_plugin.commands.flight.fetch import FetchLog, FetchMission

#: First words of examples that need a vehicle or last as long as a flight.
WAITS = ("monitor", "fetch", "replay", "stream", "demo")
#: Those that need several flights of one's own, or a store of them.
OWN_FLIGHTS = ("train", "fleet", "learn")


def examples() -> Iterator[str]:
    """The line behind `Example:` in the help of each command."""
    parts = (AirframeCheck, AirframeList, AirframeShow, AirframeNew, FetchLog, FetchMission)
    texts = [USAGE, *(part.__doc__ or "" for part in parts)]
    texts += [command_function(name).__doc__ or "" for name in COMMANDS]
    for text in texts:
        found = re.search(r"Example: thrustmargin (.*?)\n *(?:\n|$)", f"{text}\n\n", re.S)
        assert found is not None, text
        yield " ".join(found[1].split())


ALL = sorted(set(examples()))


def test_every_command_has_an_example():
    assert {line.split()[0] for line in ALL} == {*COMMANDS}


@pytest.mark.slow
@pytest.mark.parametrize("line", [one for one in ALL if not one.startswith(WAITS + OWN_FLIGHTS)])
def test_an_example_runs_from_any_folder(line, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run(shlex.split(line)) == 0, capsys.readouterr().err
