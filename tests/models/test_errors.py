"""The line that adds an optional part to the installation."""

import json
from importlib.metadata import PackageNotFoundError
from types import SimpleNamespace

import pytest

from thrustmargin.models import errors
from thrustmargin.models.errors import InstallError, install_line, require


def installed_from(monkeypatch, source):
    """Let pip have recorded `source` as the origin of the package; None: nothing."""
    text = None if source is None else json.dumps(source)
    found = SimpleNamespace(read_text=lambda name: text if name == "direct_url.json" else None)
    monkeypatch.setattr(errors, "distribution", lambda _: found)


def test_a_folder_is_installed_from_again(tmp_path, monkeypatch):
    folder = tmp_path / "my source"
    folder.mkdir()
    installed_from(monkeypatch, {"url": folder.as_uri(), "dir_info": {}})
    assert install_line("fleet") == f'pip install "{folder}[fleet]"'
    installed_from(monkeypatch, {"url": folder.as_uri(), "dir_info": {"editable": True}})
    assert install_line("fleet") == f'pip install -e "{folder}[fleet]"'


def test_an_archive_and_a_repository_are_named_as_pip_reads_them(tmp_path, monkeypatch):
    wheel = tmp_path / "thrustmargin-1.0-py3-none-any.whl"
    wheel.touch()
    installed_from(monkeypatch, {"url": wheel.as_uri(), "archive_info": {}})
    assert install_line("field") == f'pip install "thrustmargin[field] @ {wheel.as_uri()}"'
    of_git = {"vcs": "git", "commit_id": "c6b276a9"}
    installed_from(monkeypatch, {"url": "https://example.org/t.git", "vcs_info": of_git})
    line = 'pip install "thrustmargin[field] @ git+https://example.org/t.git@c6b276a9"'
    assert install_line("field") == line


@pytest.mark.parametrize("source", [None, {"url": "file:///no/longer/there", "dir_info": {}}])
def test_an_unknown_source_is_for_its_folder(source, monkeypatch):
    installed_from(monkeypatch, source)
    assert install_line("loop") == 'pip install ".[loop]" in the folder of its source'


def test_a_copy_that_was_never_installed(monkeypatch):
    def missing(name):
        raise PackageNotFoundError(name)

    monkeypatch.setattr(errors, "distribution", missing)
    assert "in the folder of its source" in install_line("loop")


def test_a_missing_library_names_that_line(monkeypatch):
    installed_from(monkeypatch, None)
    monkeypatch.setattr(errors, "find_spec", lambda _: None)
    with pytest.raises(InstallError, match=r'needs scipy.*run: pip install "\.\[loop\]"'):
        require("cover", "scipy")
