"""Every number that a command takes: what it cannot be is refused: one sentence, exit code 2.

The options are read from the commands themselves, so that a new one is tried too.
"""

import typing
from dataclasses import is_dataclass

import pytest

from thrustmargin.gcs_plugin.cli import COMMANDS, command_function, run

#: Words without which a command says that something else is missing.
NEEDED = {
    "fill": ["--airframe", "topxgun-f16"],
    "forecast": ["no.plan", "--fill=1"],
    "cover": ["no.kml", "--swath=5", "--out=made.plan"],
    "demo": ["no.tlog"],
    "monitor": ["udpin:127.0.0.1:0"],
    "export": ["no.tlog", "--mcap=made.mcap"],
    "record": ["no.tlog", "--out=made.pdf"],
    "learn": ["no.tlog", "--store=season"],
    "train": ["no.tlog", "--out-model=made.safetensors"],
}
#: Options for which a number below 0 makes sense.
BELOW_ZERO = {"--air-temperature", "--altitude", "--heading", "--wind-from"}
#: Taken for the sake of older command lines, and without effect.
IDLE = {("identify", "--surrogates"), ("identify", "--seed")}


def numeric(kind: typing.Any) -> type | None:
    """The int or float that an option holds, of a union or an annotated one too."""
    if kind in (int, float):
        return kind
    inside = typing.get_args(kind)
    if typing.get_origin(kind) is typing.Annotated:
        inside = inside[:1]
    return next((found for one in inside if (found := numeric(one))), None)


def options_of(owner: typing.Any) -> list[tuple[str, type]]:
    """Name and kind of each numeric option of a command, or of options that several share."""
    found = []
    for name, kind in typing.get_type_hints(owner, include_extras=True).items():
        bare = typing.get_args(kind)[0] if typing.get_origin(kind) is typing.Annotated else kind
        if is_dataclass(bare):
            found += options_of(bare)
        elif name != "return" and (number := numeric(kind)):
            named = [getattr(m, "name", None) for m in getattr(kind, "__metadata__", ())]
            option = next((n for n in named if n), name.replace("_", "-"))
            found.append((f"--{option}", number))
    return found


CASES = [
    (command, option, kind)
    for command in COMMANDS
    for option, kind in options_of(command_function(command))
    if (command, option) not in IDLE
]


def test_the_options_are_found():
    assert ("replay", "--speed", float) in CASES
    assert ("report", "--air-temperature", float) in CASES
    assert len(CASES) > 60


@pytest.mark.parametrize(("command", "option", "kind"), CASES)
def test_a_number_that_cannot_be_is_a_wrong_command_line(
    command, option, kind, capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    wrong = ["nan", "inf", "1e30"] if kind is float else [str(10**20)]
    for value in [*wrong, "-inf" if option in BELOW_ZERO else "-1"]:
        code = run([command, *NEEDED.get(command, ["no.tlog"]), f"{option}={value}"])
        said = capsys.readouterr().err.strip()
        assert (code, said.count("\n")) == (2, 0), (value, said)
        assert option.strip("-").split("-")[0] in said
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("option", ["--mass", "--arm", "--tank-litres", "--load", "--timeout"])
def test_a_new_airframe_takes_no_such_number_either(option, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for value in ("nan", "inf", "-1"):
        made = run(["airframe", "new", "--from", "no.tlog", "--out=a.toml", f"{option}={value}"])
        said = capsys.readouterr().err.strip()
        assert (made, said.count("\n")) == (2, 0), (value, said)
        assert option in said
