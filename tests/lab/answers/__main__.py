"""What every command answers on all bundled logs, and what changed: `python -m tests.lab.answers`.

    python -m tests.lab.answers --out new                          the tree that it stands in
    python -m tests.lab.answers --out old --revision c6b276a9      another revision of it
    python -m tests.lab.answers --out other --tree ../answers      another working tree
    python -m tests.lab.answers --out new --against old [--short]   compare; exit 1 if they differ
    python -m tests.lab.answers --compare old new [--short]        compare what is there

The source that answers is found by links in a temporary folder, as the Makefile makes them; the
logs and this program are those of the tree that it stands in.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.lab.answers.asking import ask_all
from tests.lab.answers.comparing import MOST, compare
from tests.lab.answers.questions import BUNDLED, BY_THE_CLOCK, COMMANDS, CORE, ROOT, questions

PACKAGES = ("models", "mission", "gcs_plugin", "sitl_logs")
ASKED_TREE = "THRUSTMARGIN_ASKED_TREE"  # set in the process that asks


def main() -> int:
    """Ask, compare, or both; returns 1 where two folders of answers differ."""
    options = _options()
    if options.compare:
        old, new = options.compare
        return _compared(old, new, options)
    tree = os.environ.get(ASKED_TREE)
    if tree is not None:
        _check_imports(Path(tree))
        folders = [*([] if options.without_bundled else [BUNDLED]), *options.logs]
        only = options.only or (CORE if options.core else (*set(COMMANDS) - {*BY_THE_CLOCK},))
        ask_all(list(questions(folders, only)), options.out.resolve())
        return 0
    with tempfile.TemporaryDirectory(prefix="answers_tree_") as folder:
        if options.revision:
            tree = Path(folder) / "tree"
            git = ["git", "-C", str(ROOT), "worktree"]
            added = [*git, "add", "--quiet", "--detach", str(tree), options.revision]
            subprocess.run(added, check=True)
            try:
                _asked_of(tree, Path(folder))
            finally:
                subprocess.run([*git, "remove", "--force", str(tree)], check=True)
        else:
            _asked_of(options.tree.resolve(), Path(folder))
    return _compared(options.against, options.out, options) if options.against else 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.lab.answers", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--out", type=Path, help="folder to write the answers into")
    parser.add_argument("--revision", help="revision to ask, checked out for the time being")
    parser.add_argument("--tree", type=Path, default=ROOT, help="working tree to ask")
    parser.add_argument("--against", type=Path, help="folder of answers to compare --out with")
    parser.add_argument("--compare", type=Path, nargs=2, metavar=("OLD", "NEW"))
    parser.add_argument("--only", type=_commands, help=f"of {','.join(COMMANDS)}")
    parser.add_argument("--core", action="store_true", help=f"only {','.join(CORE)}")
    parser.add_argument("--logs", type=Path, nargs="+", default=[], help="folders of more logs")
    parser.add_argument("--without-bundled", action="store_true", help="only --logs")
    parser.add_argument("--short", action="store_true", help="only first lines and levels")
    parser.add_argument("--most", type=int, default=MOST, help="differences listed of a file")
    options = parser.parse_args()
    if not options.compare and not options.out:
        parser.error("give --out FOLDER, or --compare OLD NEW")
    return options


def _commands(words: str) -> tuple[str, ...]:
    """Return the commands of a list with commas; raises ArgumentTypeError on any other word."""
    chosen = tuple(words.split(","))
    if wrong := set(chosen) - set(COMMANDS):
        raise argparse.ArgumentTypeError(f"{', '.join(wrong)}: there are {', '.join(COMMANDS)}")
    return chosen


def _asked_of(tree: Path, folder: Path) -> None:
    """Start this program anew, with the source of `tree` as `thrustmargin`, and wait for it."""
    links = folder / "links" / "thrustmargin"
    links.mkdir(parents=True)
    (links / "__init__.py").symlink_to(tree / "gcs_plugin" / "api" / "__init__.py")
    for package in PACKAGES:
        (links / package).symlink_to(tree / package)
    found = {"PYTHONPATH": f"{links.parent}{os.pathsep}{ROOT}", ASKED_TREE: str(tree)}
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    same = {"PYTHONHASHSEED": "0", "TZ": "UTC", "XDG_STATE_HOME": str(folder)}  # no known day
    program = [sys.executable, "-m", "tests.lab.answers", *sys.argv[1:]]
    subprocess.run(program, env={**os.environ, **found, **threads, **same}, check=True)


def _check_imports(tree: Path) -> None:
    """Raise SystemExit unless `thrustmargin` is the source of `tree`."""
    import thrustmargin.gcs_plugin.cli as source

    if not Path(source.__file__).resolve().is_relative_to(tree.resolve()):
        raise SystemExit(f"thrustmargin is {source.__file__}, not of {tree}")


def _compared(old: Path, new: Path, options: argparse.Namespace) -> int:
    result = compare(old, new)
    for line in result.lines(short=options.short, most=options.most):
        print(line)
    return int(bool(result.differences))


if __name__ == "__main__":
    sys.exit(main())
