"""`thrustmargin learn --store`: take many logs into the store of a season, by many processes."""

from __future__ import annotations

import json as json_module
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from thrustmargin.gcs_plugin.commands.shared.inputs import (
    LIMIT,
    Inputs,
    KnownOptions,
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
    given_options,
    logs_at,
    write_text,
)
from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal, transfer_bar
from thrustmargin.models.errors import DataError, require

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.store.ingest_run import IngestOutcome, LogSource
    from thrustmargin.gcs_plugin.store.season_store import SeasonStore


SCHEMA = "thrustmargin.learn/1"
#: Seconds after its last change up to which a file of a live recording may still grow.
STILL_RECORDED_S = 60.0
NO_FILE = "it is no file: a link to nothing, a pipe or a device"
LIVE_LOG = "telemetry.tlog"


@dataclass(frozen=True, slots=True, kw_only=True)
class SeasonOptions:
    """Options of a season's store.

    Example: --store season --workers 4
    """

    store: Annotated[str | None, tyro.conf.arg(metavar="FOLDER|ADDRESS")] = None
    """Take the logs into the store of a season, a folder or an address such as s3://season/store;
    made when missing. Nobody is asked, and no model is made; flights of aircraft that are known in
    that folder are followed."""
    workers: int | None = None
    """Processes to read with; without it one a core, where there are many logs."""
    cluster: Annotated[str | None, tyro.conf.arg(metavar="ADDRESS")] = None
    """Scheduler of a Dask cluster whose workers read, such as tcp://10.0.0.7:8786; logs, store,
    model and airframe must be where all of them reach them."""
    anonymise: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Strip who and where: names, serial numbers, ids, texts, the place on the globe."""
    model: Path | None = None
    """Rotor speed model file of the aircraft; as with `report`."""
    airframe: str | None = None
    """Name of a shipped airframe, or an airframe file (.toml); as with `report`."""
    max_utilisation: Share | None = None
    """Largest share of a rotor's maximum thrust that may be in use; without it 50%."""
    json: Path | None = None
    """Write what was done as JSON to this file (.json); - is standard output."""

    def check(self) -> None:
        """Raise UsageError for values that cannot be, and for options that need a --store."""
        check_range("--workers", self.workers, 1, 1024)
        if self.max_utilisation is not None:
            check_utilisation(self.max_utilisation)
        if self.cluster is not None and self.workers is not None:
            raise UsageError("--cluster reads with its own workers; leave out --workers")
        alone = given_options(replace(self, workers=None))
        if self.store is None and alone:
            raise UsageError(f"{alone[0]} is about the store of a season; add --store FOLDER")


NO_SEASON = SeasonOptions()


def take_logs_in(logs: tuple[str, ...], season: SeasonOptions, inputs: Inputs, again: bool) -> int:
    """Take logs into the store of a season: a flight once, whatever its file is called.

    A log that cannot be read is listed with the reason, and the others go on. What is stored
    already is passed over, unless `again`. Return the exit code: 1 if a log was not taken.
    """
    require("learn --store", "fsspec", "pyarrow", "filelock", "scipy")
    from thrustmargin.gcs_plugin.commands.shared.anonymous import own_key, pseudonym
    from thrustmargin.gcs_plugin.store.hangar import checked_name
    from thrustmargin.gcs_plugin.store.ingest_run import ingest_logs, is_address
    from thrustmargin.gcs_plugin.store.season_store import SeasonStore
    from thrustmargin.gcs_plugin.store.worker_processes import own_cores, process_pool
    from thrustmargin.gcs_plugin.store.writer_lock import writer_lock
    from thrustmargin.gcs_plugin.workshop.learn.season_flight import (
        IngestSettings,
        season_model,
        stage_log,
    )

    store, model, json = str(season.store), season.model, season.json
    check_outputs([OutputFile("--json", json, endings=(".json",))], inputs=[model, season.airframe])
    reading_keywords(inputs.reading)
    name = inputs.known.aircraft
    where = store if is_address(store) else str(Path(store).absolute())
    settings = IngestSettings(
        store=where,
        model=None if model is None else str(model.absolute()),
        airframe=_absolute(season.airframe),
        aircraft=None if name is None else checked_name(name),
        reading=inputs.reading,
        max_utilisation=season.max_utilisation or LIMIT,
        key=own_key() if season.anonymise else None,
    )
    season_model(settings.model, settings.airframe)  # refuses a wrong one before any log
    target = SeasonStore.open(where)
    found, refused = find_logs(logs)
    processes = season.workers or own_cores()
    followed: list[str] = []
    if not is_address(where) and settings == IngestSettings(store=where, reading=inputs.reading):
        known = KnownOptions(hangar=Path(where))
        found, followed = follow_known(
            found, target, replace(inputs, known=known), processes, again=again
        )
    with ExitStack() as stack:
        if season.cluster is None:
            make, at_once = partial(process_pool, processes), 2 * processes
        else:
            make, at_once = _cluster(season.cluster, stack)
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
    outcome.flights += followed
    _print(outcome, store, quiet=json == STDOUT)
    if json is not None:
        write_text(json, json_module.dumps(_as_json(outcome, store), indent=2) + "\n")
    return 1 if outcome.rejected else 0


def follow_known(
    logs: Sequence[LogSource], store: SeasonStore, inputs: Inputs, processes: int, *, again: bool
) -> tuple[list[LogSource], list[str]]:
    """Analyse logs of aircraft that a store knows and update their states, as `learn` does.

    Return the logs to take in otherwise, and the names of the flights that were followed. Logs that
    are stored already are not read, unless `again`. A flight without a verdict or a date is taken
    in otherwise, because it leaves no mark with the aircraft.
    """
    from thrustmargin.gcs_plugin.commands.shared.log_flights import hangar_of, known_flights
    from thrustmargin.gcs_plugin.store.ingest_run import content_of, is_address, known_contents

    if not hangar_of(inputs).names():
        return list(logs), []
    stored = set() if again else known_contents(store)
    fresh = [one.path for one in logs if not is_address(one.path)]
    asked = replace(inputs, logs=tuple(Path(p) for p in fresh if content_of(p) not in stored))
    console = Terminal(stderr=True, soft_wrap=True)
    # Logs that cannot be read are listed when they are read again.
    learnt = known_flights(asked, [], console, must_keep=True, processes=processes)
    kept = [(flight.row, str(log.path)) for flight, log in learnt if flight.row.can_be_kept]
    of_known = {path for _, path in kept}
    return [log for log in logs if log.path not in of_known], [row.flight for row, _ in kept]


def _check_kind(store: SeasonStore, names: str | None) -> None:
    """Raise DataError if the store names flights in another way than this run does.

    Otherwise a log would be stored twice, under two names. `names` is the name of the key of this
    run's pseudonyms; None without pseudonyms. An empty store adopts this run's way.
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
    """Return the absolute path of an airframe file, for processes with other folders; a name
    unchanged."""
    return str(Path(airframe).absolute()) if airframe and Path(airframe).is_file() else airframe


def find_logs(words: Sequence[str]) -> tuple[list[LogSource], list[tuple[str, str]]]:
    """Return the logs that files, folders, patterns and addresses name, each once.

    Also return name and reason of logs that cannot be read, or not yet. Raises DataError if one of
    `words` names no log.
    """
    from thrustmargin.gcs_plugin.store.ingest_run import LogSource, is_address

    if not words:
        raise UsageError("no log given; name logs or folders of recorded flights")
    found: dict[str, LogSource] = {}
    refused: list[tuple[str, str]] = []
    for word in words:
        if is_address(word):
            found |= _at_address(word)
            continue
        for path in (one.absolute() for one in logs_at(Path(word))):
            live = path.name == LIVE_LOG
            name = f"{path.parent.name}/{path.name}" if live else path.name
            if not path.is_file():
                if not (path.exists() or path.is_symlink()):
                    raise DataError(f"no log at {word}; give a log, a folder or a pattern")
                refused.append((name, NO_FILE))
            elif live and time.time() - path.stat().st_mtime < STILL_RECORDED_S:
                refused.append((name, "it is still being recorded; learn it afterwards"))
            else:
                found[str(path)] = LogSource(str(path), name, path.stat().st_size)
    return list(found.values()), refused


def _at_address(word: str) -> dict[str, LogSource]:
    """Return the logs at an fsspec address or pattern, by their addresses.

    Raises DataError if fsspec cannot read it, or finds none.
    """
    from fsspec.core import url_to_fs

    from thrustmargin.gcs_plugin.logs.read import log_endings
    from thrustmargin.gcs_plugin.store.ingest_run import LogSource

    try:
        files, key = url_to_fs(word)
        if any(mark in key for mark in "*?["):
            sizes = {path: files.size(path) for path in files.glob(key)}
        else:
            sizes = {path: info["size"] for path, info in files.find(key, detail=True).items()}
    except (ValueError, ImportError) as error:
        raise DataError(f"{word}: {error}; install 'thrustmargin[fleet]'") from error
    endings = log_endings()
    found = [
        LogSource(files.unstrip_protocol(path), Path(path).name, size)
        for path, size in sorted(sizes.items())
        if Path(path).suffix.lower() in endings or path == key
    ]
    if not found:
        raise DataError(f"no log at {word}; give a log, a folder or a pattern")
    return {log.path: log for log in found}


def _cluster(scheduler: str, stack: ExitStack) -> tuple[Callable[[], Executor], int]:
    """Connect to the Dask cluster of a scheduler until `stack` is closed.

    Return a function that starts its executor, and the number of logs to submit at once. Raises
    InstallError without Dask, DataError if no scheduler answers.
    """
    require("--cluster", "distributed")
    from distributed import Client

    try:
        client: Any = stack.enter_context(Client(scheduler, timeout=10))
    except (OSError, TimeoutError, ValueError) as error:
        raise DataError(f"no Dask scheduler answers at {scheduler}: {error}") from error
    threads = sum(client.nthreads().values())
    return partial(client.get_executor, pure=False, retries=3), 4 * max(threads, 2)


def _print(outcome: IngestOutcome, store: str, *, quiet: bool) -> None:
    """Print how many flights were stored, and each rejected log with its reason."""
    words = [f"flights taken into {store}: {len(outcome.flights)}"]
    words += [f"logs there already: {outcome.already}"] if outcome.already else []
    words += [f"logs not taken: {len(outcome.rejected)}"] if outcome.rejected else []
    Terminal(soft_wrap=True, quiet=quiet).print("; ".join(words))
    console = Terminal(stderr=True, soft_wrap=True)
    for row in outcome.rejected:
        console.print(f"not taken: {row['log_name']}: {row['reason']}")


def _as_json(outcome: IngestOutcome, store: str) -> dict[str, Any]:
    """Return the outcome as JSON values, schema thrustmargin.learn/1."""
    return {
        "schema": SCHEMA,
        "store": store,
        "flights": sorted(outcome.flights),
        "already_stored": outcome.already,
        "rejected": [{"name": r["log_name"], "reason": r["reason"]} for r in outcome.rejected],
        "bytes": outcome.bytes,
        "seconds": outcome.seconds,
    }
