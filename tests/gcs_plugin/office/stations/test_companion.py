"""Container and service start a command line that the program has, for wheels that it builds."""

import json
import os
import re
import shlex
import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from tests.import_graph import ROOT

FILES = ROOT / "gcs_plugin/office/stations/companion"
DOCKERFILE = (FILES / "Dockerfile").read_text("utf-8")
SERVICE = (FILES / "thrustmargin.service").read_text("utf-8")


def of_container(name: str) -> list[str]:
    return json.loads(re.search(rf"^{name} (\[.*\])$", DOCKERFILE, re.M)[1])  # type: ignore[index]


def started() -> dict[str, list[str]]:
    """The words after `thrustmargin` of both."""
    unit = shlex.split(re.search(r"^ExecStart=(.*)$", SERVICE, re.M)[1])  # type: ignore[index]
    assert Path(unit[0]).name == "thrustmargin"
    assert of_container("ENTRYPOINT")[2].count('thrustmargin monitor "$@"') == 2
    return {"container": ["monitor", *of_container("CMD")], "service": unit[1:]}


@pytest.mark.skipif(
    shutil.which("setpriv") is None or os.getuid() != 0, reason="needs root, as in a container"
)
def test_a_folder_of_the_host_can_be_recorded_to_by_who_is_not_root():
    """The container's start, with the user `nobody` and a program that says who it is."""
    with TemporaryDirectory() as name:
        said = container_start(Path(name))
    assert said == ["nobody", "monitor --bar 8090", "written"]


def container_start(folder: Path) -> list[str]:
    """What that program says, in a folder that anybody may enter."""
    folder.chmod(0o755)
    program, held = folder / "thrustmargin", folder / "recordings"
    held.mkdir(0o755)
    program.write_text(f'#!/bin/sh\nid -un; echo "$@"; touch {held}/new && echo written\n')
    program.chmod(0o755)
    shell, option, script, name = of_container("ENTRYPOINT")
    script = script.replace("/recordings", str(held)).replace("chown thrustmargin", "chown nobody")
    script = script.replace("uid=thrustmargin", "uid=nobody").replace(
        "gid=thrustmargin", "gid=nogroup"
    )
    done = subprocess.run(
        [shell, option, script, name, "--bar", "8090"],
        env={"PATH": f"{folder}:/usr/bin:/bin:/usr/sbin"},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.splitlines()


@pytest.mark.slow
def test_both_watch_without_a_page_and_serve_the_bar(tmp_path: Path):
    from thrustmargin.gcs_plugin.cli import run

    words, service = started().values()
    folder = words.index("--record") + 1
    assert (words[:folder], words[folder + 1 :]) == (service[:folder], service[folder + 1 :])
    assert words[0] == "monitor"
    assert {"--no-view", "--announce"} <= set(words)
    assert words[words.index("--bar") + 1] == "8090"
    # The same words on a recording, in a folder of the test's.
    log = ROOT / "sitl_logs/campaign/v2_m4_q1.5.tlog"
    words[folder] = str(tmp_path)
    words[words.index("--bar") + 1] = "0"
    assert run([words[0], str(log), *words[1:], "--seconds", "0.5"]) == 0


def test_the_labels_that_blueos_reads_are_json():
    labels = dict(re.findall(r"^LABEL (\w+)='(.*?)'$", DOCKERFILE.replace("\\\n", ""), re.M))
    permissions = json.loads(labels["permissions"])
    assert permissions["HostConfig"]["NetworkMode"] == "host"
    assert {"tags", "authors", "company", "links"} <= set(labels)
    for text in labels.values():
        json.loads(text)


def test_the_bar_is_served_where_the_container_says():
    assert "EXPOSE 8090" in DOCKERFILE
    assert "127.0.0.1:8090/bar.json" in DOCKERFILE


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd here")
def test_systemd_understands_the_unit(tmp_path: Path):
    unit = tmp_path / "thrustmargin.service"
    unit.write_text(SERVICE.replace("/opt/thrustmargin/bin/thrustmargin", "/bin/true"))
    done = subprocess.run(
        ["systemd-analyze", "verify", unit], capture_output=True, text=True, check=False
    )
    assert "thrustmargin.service" not in done.stderr
