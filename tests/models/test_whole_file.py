"""Files written whole: the draft of a killed program goes, that of one that runs stays."""

import subprocess
import sys
import time
from pathlib import Path

import pytest

from thrustmargin.models.whole_file import regular, whole_file

WRITES_AND_WAITS = """
import sys, time
from pathlib import Path
from thrustmargin.models.whole_file import whole_file
with whole_file(Path(sys.argv[1])) as draft:
    draft.write_text("half")
    print("begun", flush=True)
    time.sleep(60)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="there no program is asked whether it runs")
def test_the_draft_of_a_killed_program_goes_with_the_next_write(tmp_path: Path):
    other = tmp_path / "a.html"
    program = [sys.executable, "-c", WRITES_AND_WAITS, str(other)]
    with subprocess.Popen(program, stdout=subprocess.PIPE) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == b"begun\n"
        _write(tmp_path / "b.html")
        drafts = list(tmp_path.glob(".a.html*"))
        assert len(drafts) == 1  # of a program that runs
        writer.kill()
    assert drafts[0].exists()
    _write(tmp_path / "b.html")
    assert [p.name for p in tmp_path.iterdir()] == ["b.html"]


def test_a_draft_of_another_computer_stays(tmp_path: Path):
    """On a shared disk: its process ids are not ours."""
    other = tmp_path / ".a.html.99999999-00000000.part"
    other.write_text("half")
    _write(tmp_path / "b.html")
    assert other.exists()


def test_drafts_of_a_folder_of_thousands_cost_no_time(tmp_path: Path):
    for k in range(3000):
        (tmp_path / f"{k}.parquet").touch()
    began = time.process_time()
    _write(tmp_path / "b.html")
    assert time.process_time() - began < 1.0


def test_a_name_that_no_file_can_have_is_an_error_of_the_file():
    with pytest.raises(OSError, match="none that a file can have"):
        regular(Path("a\0b"))


def _write(path: Path) -> None:
    with whole_file(path) as draft:
        draft.write_text("whole")
