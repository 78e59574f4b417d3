"""How vehicles are watched: as the user says, after how long one is old, rowless or gone, and when
what takes long is worked out."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field
from functools import cache
from typing import Any, TypeVar

from thrustmargin.gcs_plugin.live.alarms.alarm import AlarmSettings
from thrustmargin.gcs_plugin.telemetry.statements import Options

#: s for which two vehicles with one id stay suspended after they were last seen to take turns.
SHARED_HOLD = 10.0
ROWLESS = 5.0  # s after which a vehicle without any row says so
#: s after which a field is shown as no longer reported, seldom where a link loses half.
LASTING = 5.0
GONE = 60.0  # s of silence after which a vehicle has left


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchSettings(Options):
    """How vehicles are watched: how they are read, and when an alarm is raised."""

    vehicle: int | None = None  # system id of the only one; None: all that are heard
    alarms: AlarmSettings = field(default_factory=AlarmSettings)
    airframe_given: bool = True  # by the user; else a vehicle must be recognised as one of it
    asked: frozenset[str] = frozenset()  # options by which vehicles are asked for more
    link: str = "LOG"  # where vehicles are heard, for the command that makes an airframe

    @property
    def as_of_a_file(self) -> dict[str, Any]:
        """What is stated of the flight, as `read_sorties` takes it."""
        stated = ("tank", "tank_start_kg", "load", "load_end", "air_temperature")
        return {name: getattr(self, name) for name in stated}


Found = TypeVar("Found")
#: Gives what a work has found; None as long as it is not done, or where nothing can be found.
Later = Callable[[Callable[[], Found]], Callable[[], Found | None]]


def when_asked(work: Callable[[], Found | None]) -> Callable[[], Found | None]:
    """Done by whoever asks first: of a recording, which waits."""
    return cache(work)


def in_background(pool: Executor, failed: Callable[[BaseException], None]) -> Later[Any]:
    """Done beside what comes in: of a link, which does not wait.

    What cannot be found for an error of its own is not found; `failed` hears of it.
    """

    def heard(future: Future[Any]) -> None:
        # Of what the end of listening cut off there is nothing to be had.
        if not future.cancelled() and (error := future.exception()) is not None:
            failed(error)

    def later(work: Callable[[], Any]) -> Callable[[], Any]:
        future = pool.submit(work)
        future.add_done_callback(heard)

        def found() -> Any:
            known = future.done() and not future.cancelled() and future.exception() is None
            return future.result() if known else None

        return found

    return later
