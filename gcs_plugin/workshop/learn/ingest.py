"""`thrustmargin ingest`: read the logs of a season into its store, on all cores or a cluster."""

from __future__ import annotations

import json as json_module
import sys
import time
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from tyro.conf import Positional

from thrustmargin.gcs_plugin.commands.shared.inputs import (
    AS_HEARD,
    Inputs,
    KnownOptions,
    Reading,
    Share,
    reading_keywords,
)
from thrustmargin.gcs_plugin.commands.shared.options import (
    STDOUT,
    OutputFile,
    UsageError,
    check_outputs,
    check_range,
    check_utilisation,
)
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal, transfer_bar
from thrustmargin.models.errors import DataError, ThrustMarginError, require

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.store.ingest_run import IngestOutcome, LogSource
    from thrustmargin.gcs_plugin.store.season_store import SeasonStore


SCHEMA = "thrustmargin.ingest/1"
#: Seconds after its last change up to which a file of a live recording may still grow.
STILL_RECORDED_S = 60.0
NO_FILE = "it is no file: a link to nothing, a pipe or a device"
LIVE_LOG = "telemetry.tlog"


def ingest(
    logs: Positional[
        Annotated[tuple[str, ...], tyro.conf.arg(metavar="LOGS...", help_behavior_hint="")]
    ],
    *,
    store: str | None = None,
    aircraft: str | None = None,
    model: Path | None = None,
    airframe: str | None = None,
    reading: Reading = AS_HEARD,
    max_utilisation: Share = 0.5,
    workers: int | None = None,
    cluster: str | None = None,
    anonymise: bool = False,
    again: bool = False,
    json: Path | None = None,
) -> int:
    """Take logs into the store of a season: a flight once, whatever its file is called.

    The store is a folder of Parquet files that duckdb, polars and pandas read as it is. What is
    there already is passed over, so the same command again goes on where it was stopped. A log
    that cannot be read is listed with the reason, and the others go on.

    Example: thrustmargin ingest demo --store season

    Args:
        logs: Logs, folders with logs and recordings of `monitor`, patterns such as 'logs/**/*.BIN',
            or addresses such as s3://season/logs.
        store: Folder of the store, or an address such as s3://season/store; made when missing.
            Without it the folder of the known aircraft, whose flights are followed as by `learn`.
        aircraft: Name of the aircraft that flew; without it the serial number, board number or
            system id that the log holds.
        model: Rotor speed model file of the aircraft; as with `report`.
        airframe: Name of a shipped airframe, or an airframe file (.toml); as with `report`.
        reading: How the logs are read.
        max_utilisation: Largest share of a rotor's maximum thrust that may be in use.
        workers: Processes to read with; without it one a core.
        cluster: Scheduler of a Dask cluster whose workers read, such as tcp://10.0.0.7:8786; logs,
            store, model and airframe must be where all of them reach them.
        anonymise: Strip who and where: names, serial numbers, ids, texts, the place on the globe.
        again: Read logs that are in the store too, and put what they say now in the place of what
            is stored: for another model, airframe or aircraft's name.
        json: Write what was done as JSON to this file (.json); - is standard output.
    """
    require("ingest", "fsspec", "pyarrow", "filelock", "scipy")
    from thrustmargin.gcs_plugin.commands.shared.anonymous import own_key, pseudonym
    from thrustmargin.gcs_plugin.store.hangar import open_hangar
    from thrustmargin.gcs_plugin.store.ingest_run import (
        ingest_logs,
        is_address,
        local_processes,
        own_cores,
    )
    from thrustmargin.gcs_plugin.store.season_store import SeasonStore, checked_aircraft
    from thrustmargin.gcs_plugin.store.writer_lock import writer_lock
    from thrustmargin.gcs_plugin.workshop.learn.season_flight import (
        IngestSettings,
        season_model,
        stage_log,
    )

    if not logs:
        raise UsageError("no log given; name logs or folders of recorded flights")
    check_utilisation(max_utilisation)
    check_outputs([OutputFile("--json", json, endings=(".json",))], inputs=[model, airframe])
    check_range("--workers", workers, 1, 1024)
    reading_keywords(reading)
    hangar = open_hangar()
    store = str(hangar.folder) if store is None else store
    where = store if is_address(store) else str(Path(store).absolute())
    settings = IngestSettings(
        store=where,
        model=None if model is None else str(model.absolute()),
        airframe=_absolute(airframe),
        aircraft=None if aircraft is None else checked_aircraft(aircraft),
        reading=reading,
        max_utilisation=max_utilisation,
        key=own_key() if anonymise else None,
    )
    season_model(settings.model, settings.airframe)  # refuses a wrong one before any log
    target = SeasonStore.open(where)
    found, refused = find_logs(logs)
    if not is_address(where) and settings == IngestSettings(store=where, reading=reading):
        found = follow_known(found, Inputs(reading=reading, known=KnownOptions(hangar=Path(where))))
    with ExitStack() as stack:
        if cluster is None:
            make, at_once = local_processes(workers or own_cores())
        else:
            client = stack.enter_context(_client(cluster))
            make, at_once = partial(client.get_executor, pure=False, retries=3), 4 * _cores(client)
        check_lock = stack.enter_context(writer_lock(target))
        _check_kind(target, None if settings.key is None else pseudonym(settings.key, "store"))
        announce, show = stack.enter_context(transfer_bar())

        def progress(what: str, done: int, total: int) -> None:
            announce(what)
            show(done, total)

        outcome = ingest_logs(
            target,
            found,
            partial(stage_log, settings=settings),
            executor=make,
            at_once=at_once,
            check_lock=check_lock,
            show=progress,
            refused=refused,
            again=again,
            hide=None if settings.key is None else partial(pseudonym, settings.key),
        )
    _print(outcome, store, quiet=json == STDOUT)
    if json is not None:
        text = json_module.dumps(_as_json(outcome, store), indent=2) + "\n"
        if json == STDOUT:
            sys.stdout.write(text)
        else:
            from thrustmargin.models.whole_file import whole_file

            with whole_file(json) as draft:
                draft.write_text(text, "utf-8")
    return 1 if outcome.rejected else 0


def follow_known(logs: list[LogSource], inputs: Inputs) -> list[LogSource]:
    """Analyse the logs of aircraft known to the hangar and store their flights, as command `learn`
    does.

    Return the other logs: those of unknown aircraft and those that cannot be read. Print the number
    of flights of each aircraft on stderr. Raise DataError if a flight cannot be stored.
    """
    from thrustmargin.gcs_plugin.commands.shared.log_flights import (
        hangar_of,
        learn_logs,
        recognised,
    )

    hangar = hangar_of(inputs)
    if not hangar.names():
        return logs
    of_aircraft: dict[str, list[Path]] = {}
    others = []
    for log in logs:
        try:
            name = recognised(Path(log.path), inputs, hangar).name
        except (ThrustMarginError, OSError):
            name = None  # it is read again, and rejected with its reason
        if name is None:
            others.append(log)
        else:
            of_aircraft.setdefault(name, []).append(Path(log.path))
    console = Terminal(stderr=True, soft_wrap=True)
    for name, paths in of_aircraft.items():
        known = hangar.load(name)
        learnt, _ = learn_logs(known, paths, inputs, hangar, [], console, must_keep=True)
        console.print(f"{name}: {len(learnt)} flights followed")
    return others


def _check_kind(store: SeasonStore, names: str | None) -> None:
    """Raise DataError if the store names its flights in another way than this run would.

    Flights have either their own names or pseudonyms made with a key. `names` is the name of this
    run's key; None for own names. With two ways a log would be stored twice. An empty store is
    marked with this run's way.
    """
    from thrustmargin.gcs_plugin.store.season_store import NAMES

    held = store.naming_key()
    if held is None and not store.keys("flights") and not store.files.exists(store.path(NAMES)):
        names_text = json_module.dumps({"names": names})
        store.put(NAMES, lambda draft: draft.write_text(names_text, "utf-8"))
    elif held != names:
        kind = "as they are" if held is None else "under the pseudonyms of a key"
        other = "of another key" if held and names else "the other way"
        raise DataError(
            f"{store.url} holds flights {kind}, and a flight {other} would be counted twice; "
            "give another --store"
        )


def _absolute(airframe: str | None) -> str | None:
    """Return the absolute path of an airframe file, since other processes have other folders.

    The name of a shipped airframe, and None, are returned unchanged.
    """
    return str(Path(airframe).absolute()) if airframe and Path(airframe).is_file() else airframe


def find_logs(words: tuple[str, ...]) -> tuple[list[LogSource], list[tuple[str, str]]]:
    """Return the logs that `words` name, each once and sorted by path, and the refused ones.

    A word is a file, a folder (searched recursively), a glob pattern or an fsspec address. A
    refused log is a pair of file name and reason: it is no regular file, or is still being
    recorded. Raises DataError if a word names no log.
    """
    import glob

    from thrustmargin.gcs_plugin.logs.read import log_endings
    from thrustmargin.gcs_plugin.store.ingest_run import LogSource, is_address

    endings = log_endings()
    found: dict[str, LogSource] = {}
    refused: list[tuple[str, str]] = []
    for word in words:
        if is_address(word):
            sizes = _at_address(word, endings)
        else:
            path = Path(word)
            names = [path] if path.exists() else [Path(p) for p in glob.glob(word, recursive=True)]
            sizes = {}
            for name in names:
                inside = [name] if not name.is_dir() else sorted(name.rglob("*"))
                for file in inside:
                    if file.is_file() and (file == name or file.suffix.lower() in endings):
                        sizes[str(file.absolute())] = file.stat().st_size
                    elif file.suffix.lower() in endings and not file.is_dir():
                        refused.append((file.name, NO_FILE))
        if not sizes and not refused:
            raise DataError(f"no log at {word}; give a log, a folder with logs or a pattern")
        for path, size in sizes.items():
            whole = Path(path)
            live = whole.name == LIVE_LOG
            name = f"{whole.parent.name}/{whole.name}" if live else whole.name
            if (
                live
                and not is_address(path)
                and time.time() - whole.stat().st_mtime < STILL_RECORDED_S
            ):
                refused.append((name, "it is still being recorded; run ingest again afterwards"))
            else:
                found[path] = LogSource(path, name, size)
    return [found[path] for path in sorted(found)], refused


def _at_address(word: str, endings: set[str]) -> dict[str, int]:
    """Return a dict of address -> size in bytes, of the logs at `word`, an fsspec address or
    pattern.

    Only files with one of `endings` (lower case, with the dot) count, or the file that `word`
    itself names. Raises DataError if fsspec does not know the address's protocol.
    """
    from fsspec.core import url_to_fs

    try:
        files, key = url_to_fs(word)
        if any(mark in key for mark in "*?["):
            sizes = {path: files.size(path) for path in files.glob(key)}
        else:
            sizes = {path: info["size"] for path, info in files.find(key, detail=True).items()}
        return {
            files.unstrip_protocol(path): size
            for path, size in sizes.items()
            if Path(path).suffix.lower() in endings or path == key
        }
    except (ValueError, ImportError) as error:
        raise DataError(f"{word}: {error}; install 'thrustmargin[fleet]'") from error


def _client(scheduler: str) -> Any:
    """Return a Dask client of the cluster with the address `scheduler`; the caller must close it.

    Raises InstallError if Dask is not installed, DataError if no scheduler answers within 10 s.
    """
    require("--cluster", "distributed")
    from distributed import Client

    try:
        return Client(scheduler, timeout=10)
    except (OSError, TimeoutError, ValueError) as error:
        raise DataError(f"no Dask scheduler answers at {scheduler}: {error}") from error


def _cores(client: Any) -> int:
    """Return the number of threads of all workers of a cluster, at least 2."""
    return max(sum(client.nthreads().values()), 2)


def _print(outcome: IngestOutcome, store: str, *, quiet: bool) -> None:
    """Print the number of flights stored in `store`, and each rejected log with its reason on
    stderr.

    `quiet`: the number is not printed.
    """
    words = [f"flights taken into {store}: {len(outcome.flights)}"]
    words += [f"logs there already: {outcome.already}"] if outcome.already else []
    words += [f"logs not taken: {len(outcome.rejected)}"] if outcome.rejected else []
    Terminal(soft_wrap=True, quiet=quiet).print("; ".join(words))
    console = Terminal(stderr=True, soft_wrap=True)
    for row in outcome.rejected:
        console.print(f"not taken: {row['log_name']}: {row['reason']}")


def _as_json(outcome: IngestOutcome, store: str) -> dict[str, Any]:
    """Return the outcome as a dict for JSON, schema thrustmargin.ingest/1.

    Its lists are the names of the stored flights and the rejected logs with their reasons.
    """
    return {
        "schema": SCHEMA,
        "store": store,
        "flights": sorted(outcome.flights),
        "already_stored": outcome.already,
        "rejected": [{"name": r["log_name"], "reason": r["reason"]} for r in outcome.rejected],
        "bytes": outcome.bytes,
        "seconds": outcome.seconds,
    }
