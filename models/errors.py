"""Define the one family of errors. Each message says what was found, where, and what to do about
it."""

from importlib.util import find_spec


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
    """Raise InstallError where one of the optional libraries of a task is not installed."""
    for library in libraries:
        if find_spec(library) is None:
            raise InstallError(
                f"{task} needs {library}, which is not installed; "
                f"run: pip install 'thrustmargin[{EXTRAS[library]}]'"
            )
