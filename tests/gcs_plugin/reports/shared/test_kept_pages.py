"""A page that is compiled once and kept says the same as one that is compiled anew."""

import os
import subprocess
import sys

ONE = "from thrustmargin.gcs_plugin.cli import main; main(sys.argv[1:])"


def page(folder, temporary, language="en") -> str:
    """The page of `fill` that a process with such a folder of temporary files writes."""
    path = folder / f"{language}.html"
    words = ["fill", "--airframe", "topxgun-f16", "--out", str(path), "--language", language]
    subprocess.run(
        [sys.executable, "-c", f"import sys; {ONE}", *words],
        env={**os.environ, "TMPDIR": str(temporary)},
        check=True,
        stdout=subprocess.DEVNULL,
    )
    return path.read_text("utf-8")


def test_a_kept_page_speaks_the_language_that_is_asked_for(tmp_path):
    first = page(tmp_path, tmp_path)
    (kept,) = tmp_path.glob("_jinja2-cache-*")
    assert kept.stat().st_mode & 0o077 == 0, "others could put their own code there"
    names = {file.name: file.stat().st_mtime_ns for file in kept.iterdir()}
    german = page(tmp_path, tmp_path, "de")
    assert {file.name: file.stat().st_mtime_ns for file in kept.iterdir()} == names, "made again"
    assert 'lang="en"' in first
    assert 'lang="de"' in german
    assert "<h1>How much to fill" in first
    assert "<h1>How much to fill" not in german


def test_without_a_folder_to_keep_it_in_the_page_is_written(tmp_path):
    (tmp_path / f"_jinja2-cache-{os.getuid()}").write_text("in the way")
    assert "<main>" in page(tmp_path, tmp_path)
