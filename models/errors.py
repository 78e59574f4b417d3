"""The one error family. Each message says what was found, where, and what to do about it."""

from importlib.util import find_spec


class ThrustMarginError(Exception):
    """Base of every error that a user can cause and can repair; commands print it as one line."""


class AirframeError(ThrustMarginError):
    """An airframe file is missing, incomplete, in the wrong unit, or does not fit the flight."""


class TrackError(ThrustMarginError):
    """Arrays given as a flight do not make one: shapes disagree or time does not increase."""


class LogError(ThrustMarginError):
    """A log file cannot be read as a flight."""


class ModelError(ThrustMarginError):
    """A rotor speed model file is damaged, of another kind, or made for another airframe."""


class DataError(ThrustMarginError):
    """There is too little data, or none of the kind needed, for what was asked."""


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


def require(task: str, *libraries: str) -> None:
    """Raise InstallError where one of the libraries, that only some tasks need, is missing."""
    for library in libraries:
        if find_spec(library) is None:
            raise InstallError(
                f"{task} needs {library}, which is not installed; "
                f"run: pip install 'thrustmargin[{EXTRAS[library]}]'"
            )
