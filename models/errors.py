"""Define the one family of errors. Each message says what was found, where, and what to do about
it."""

import json
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, distribution
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import url2pathname


class ThrustMarginError(Exception):
    """An error that a user can cause and repair; commands print it as one line."""


class AirframeError(ThrustMarginError):
    """An airframe file is missing, incomplete, in the wrong unit, or does not match the flight."""


class TrackError(ThrustMarginError):
    """The arrays of a flight do not match: shapes disagree or time does not increase."""


class LogError(ThrustMarginError):
    """A log file cannot be read as a flight."""


class ModelError(ThrustMarginError):
    """A rotor speed model file is damaged, of another kind, or made for another airframe."""


class DataError(ThrustMarginError):
    """There is too little data for a task, or none of the required kind."""


class UnlikeFlightError(DataError):
    """Flights cannot be of the model's aircraft; `reasons` has the name of each and the statement
    of why."""

    def __init__(self, reasons: Sequence[tuple[str, object]]) -> None:
        super().__init__("; ".join(f"{name}: {reason}" for name, reason in reasons))
        self.reasons = tuple(reasons)


class PlanError(ThrustMarginError):
    """A mission plan file cannot be read as a mission."""


class LinkError(ThrustMarginError):
    """A port, socket or vehicle link cannot be opened or does not answer."""


class InstallError(ThrustMarginError):
    """An optional part of the installation is missing."""


#: library -> the extra that installs it
EXTRAS = {
    "scipy": "loop",
    "torch": "train",
    "mavsdk": "vehicle",
    **dict.fromkeys(("pyarrow", "duckdb", "fsspec", "filelock", "distributed", "s3fs"), "fleet"),
    "mcap": "streams",
    "prometheus_client": "streams",
    "shapefile": "field",
}


PACKAGE = "thrustmargin"


def install_line(extra: str) -> str:
    """Return the pip command that adds `extra` to this installation, wherever it came from.

    The program is on no package index. pip records the folder, archive or repository that a package
    was installed from (PEP 610, `direct_url.json`). Quotes are double, which Windows needs too.
    Where the source is not known or no longer there, the command is for the folder of the source,
    and says so.
    """
    try:
        recorded = distribution(PACKAGE).read_text("direct_url.json")
    except PackageNotFoundError:
        recorded = None
    source = json.loads(recorded) if recorded else {}
    url = str(source.get("url", ""))
    if "vcs_info" in source:
        control, commit = source["vcs_info"]["vcs"], source["vcs_info"]["commit_id"]
        return f'pip install "{PACKAGE}[{extra}] @ {control}+{url}@{commit}"'
    parts = urlsplit(url)
    if parts.scheme == "file":
        path = Path(url2pathname(parts.path))
        if path.is_dir():
            editable = "-e " if source.get("dir_info", {}).get("editable") else ""
            return f'pip install {editable}"{path}[{extra}]"'
        url = url if path.is_file() else ""
    if url:
        return f'pip install "{PACKAGE}[{extra}] @ {url}"'
    return f'pip install ".[{extra}]" in the folder of its source'


def require(task: str, *libraries: str) -> None:
    """Raise InstallError where one of the optional libraries of a task is not installed."""
    for library in libraries:
        if find_spec(library) is None:
            raise InstallError(
                f"{task} needs {library}, which is not installed; "
                f"run: {install_line(EXTRAS[library])}"
            )
