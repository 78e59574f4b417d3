"""Each thing has one place and one name: rooms and tests mirror each other."""

import ast
import re
import tomllib
from collections import defaultdict

from tests.import_graph import PACKAGES, ROOT, modules, nodes, picture, room_graph

#: Folders whose tests are those of what they make, and where.
TESTED_BY = {
    "gcs_plugin/reports/shared": "tests/gcs_plugin/reports/margin/test_page.py",
}
#: Folders of tests that mirror no folder of the source, and what they hold.
NOT_MIRRORED = {
    "tests": "this, and what all tests share",
    "tests/lab": "what measures the product, run by `make lab` and by hand",
    "tests/lab/answers": "what every command answers, and what changed, by `make answers`",
    "tests/lab/bench": "measurements of speed and memory, run by `make bench`",
    "tests/lab/fuzz": "damaged files of every kind into their readers, run by `make fuzz`",
    "tests/lab/measured": "the loop on measured data of others, run by `make measured`",
    "tests/lab/mutation": "a count of what fast tests notice, run as its first lines say",
    "tests/lab/plans": "plans made to break a reader, and one too large to be flown in a day",
    "tests/lab/undeclared": "effects that the code does not know",
    "tests/gcs_plugin/peers": "the programs at the other end of a link",
}


def source_folders() -> dict[str, list[str]]:
    """Folder -> its modules, without `__init__`."""
    folders: dict[str, list[str]] = defaultdict(list)
    for path in modules().values():
        held = folders[path.parent.relative_to(ROOT).as_posix()]
        if path.name != "__init__.py":
            held.append(path.stem)
    return folders


def test_each_folder_of_tests_has_its_room():
    folders = {p.parent.relative_to(ROOT).as_posix() for p in (ROOT / "tests").rglob("*.py")}
    alone = {f for f in folders - NOT_MIRRORED.keys() if not (ROOT / f[len("tests/") :]).is_dir()}
    assert alone == set()


def test_each_room_has_its_tests():
    bare = {
        folder
        for folder, held in source_folders().items()
        if held
        and folder not in TESTED_BY
        and not list((ROOT / "tests" / folder).glob("test_*.py"))
    }
    assert bare == set()


def singular(name: str) -> str:
    """A name as it is compared: in small letters, without the s of a plural."""
    return name.lower().replace("_", "").removesuffix("s")


def test_no_two_modules_have_names_alike():
    places: dict[str, list[str]] = defaultdict(list)
    for folder, held in source_folders().items():
        for name in held:
            places[singular(name)].append(f"{folder}/{name}")
    alike = [where for where in places.values() if len(where) > 1]
    # The module of a command has the command's name.
    assert alike == [["models/network/records", "gcs_plugin/office/record/record"]]


def test_no_two_public_classes_have_names_alike():
    """One named as another in the plural is a collection of that other."""
    places: dict[str, list[str]] = defaultdict(list)
    for name, path in modules().items():
        for node in ast.iter_child_nodes(nodes(path)[0]):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[singular(node.name)].append(f"{name}.{node.name}")
    alike = {tuple(n.split(".")[-1] for n in names) for names in places.values() if len(names) > 1}
    collections = ("Alarm", "ArmFigure", "Frame", "RotorFault")
    assert alike == {(name, f"{name}s") for name in collections}


def test_every_package_folder_and_every_data_file_is_installed():
    tools = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    folders = {
        "thrustmargin." + path.parent.relative_to(ROOT).as_posix().replace("/", ".")
        for path in modules().values()
    } - {"thrustmargin.gcs_plugin.api"}
    assert set(tools["packages"]) == folders | {"thrustmargin", "thrustmargin.sitl_logs.campaign"}
    for path in (p for package in PACKAGES for p in (ROOT / package).rglob("*") if p.is_file()):
        if path.suffix == ".py" or path.name == "py.typed" or "__pycache__" in path.parts:
            continue
        held = [
            (path.relative_to(folder), p)
            for folder in path.parents
            for p in tools["package-data"].get(
                ".".join(["thrustmargin", *folder.parts[len(ROOT.parts) :]]), ()
            )
        ]
        assert any(inside.match(p) and len(inside.parts) == p.count("/") + 1 for inside, p in held)


def test_the_version_is_the_newest_of_the_changelog():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    newest = re.search(r"^## (\S+)(.*)$", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert newest
    assert version == newest[1] + (".dev0" if newest[2] == " (unreleased)" else "")


def test_the_picture_of_the_architecture_is_that_of_the_imports():
    drawn = (ROOT / "docs" / "architecture.md").read_text()
    assert f"```mermaid\n{picture(room_graph())}\n```" in drawn, "python -m tests.import_graph"


def test_every_file_that_a_document_names_is_there():
    documents = [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")]
    named = {
        (document.name, word)
        for document in documents
        for word in re.findall(
            r"`((?:models|mission|gcs_plugin|tests|docs)/[\w/.-]*)`", document.read_text()
        )
    }
    assert {(d, w) for d, w in named if not (ROOT / w).exists()} == set()


#: Modules that Windows does not have, and names that its `os` and `signal` lack.
POSIX_MODULES = {"fcntl", "grp", "pty", "pwd", "resource", "syslog", "termios", "tty"}
POSIX_NAMES = {
    *("os.fork", "os.geteuid", "os.getuid", "os.mkfifo", "os.openpty", "os.setsid", "os.uname"),
    *("signal.SIGHUP", "signal.SIGKILL", "signal.SIGUSR1", "signal.SIGALRM", "signal.pause"),
    *("socket.AF_UNIX", "socket.SO_REUSEPORT"),
}


def test_nothing_needs_what_only_posix_has():
    """Field laptops run Windows. What is looked for by `getattr` or `hasattr` is guarded."""
    found = []
    for name, path in modules().items():
        for node in nodes(path):
            if isinstance(node, ast.Import):
                used = {alias.name.partition(".")[0] for alias in node.names} & POSIX_MODULES
            elif isinstance(node, ast.ImportFrom):
                used = {(node.module or "").partition(".")[0]} & POSIX_MODULES
            elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                used = {f"{node.value.id}.{node.attr}"} & POSIX_NAMES
            else:
                continue
            found += [f"{name}: {what}" for what in used]
    assert found == []
