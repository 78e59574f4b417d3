"""What is asked of every command: one `Question` is one command line and the files that it writes.

A question is data, so that the same one can be put to any revision. Paths in it are real; the
answers are stored without them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[3]
BUNDLED = ROOT / "sitl_logs"
LOG_ENDINGS = {".tlog", ".bin", ".ulg", ".csv", ".log"}
PLAN_ENDINGS = {".plan", ".waypoints", ".mission"}
#: Shipped airframes, by hand: one that is taken away is a difference, too.
AIRFRAMES = ("agras-t20", "agras-t40", "crazyflie-rpm", "topxgun-f16", "topxgun-f16-sitl")
DAYS = {
    "usual": (),
    "hot_high_windy": ("--air-temperature", "35", "--altitude", "400", "--wind", "4"),
    "any_rotor": ("--no-rotor-lost", "--max-utilisation", "60%"),
}
IDENTIFIED = {
    **{
        group: tuple(f"dev/{group}_{k}.tlog" for k in (1, 2, 3))
        for group in ("cg_forward", "climb", "extra_mass", "high_altitude", "windy", "worn_prop")
    },
    "onset": ("onset/worn_prop_onset.tlog",),
    "sound": ("campaign/v4_m10_q2.5.tlog", "campaign/v4_m16_q2.5.tlog", "campaign/v6_m4_q3.5.tlog"),
}
#: What `fleet --sql` is asked of a season's store: few columns, which a console has to hold.
SELECTS = {
    "verdicts": "select log_name, verdict, verdict_reason, action from flights order by all",
    "numbers": "select log_name, worst_margin, worst_rotor, redundancy_min, fill_kg, fill_low_kg, "
    "prediction_rmse_rpm from flights order by all",
    "alarms": "select log_name, alarms, unmeasured, silences from flights order by all",
    "rows": "select flight, count(*), sum(margin_1), sum(margin_predicted_1), "
    "sum(redundancy_yaw_free) from rows group by flight order by all",
    "rejected": "select log_name, reason from rejected order by all",
}
#: Placeholder in a command line for the folder into which it writes, and for the season's store.
OUT, STORE = "{out}", "{store}"

CORE = ("cover", "export", "fill", "forecast", "inspect", "match", "record", "report")
LONGER = ("fleet", "identify", "learn", "replay", "train")
#: Takes the answers of threads that race with each other: not the same twice.
BY_THE_CLOCK = ("monitor",)
COMMANDS = (*CORE, *LONGER, *BY_THE_CLOCK)


@dataclass(frozen=True, slots=True)
class Question:
    """One command line, `argv`, and a `label` that is the folder of its answer.

    `kept` are patterns of the files that it writes and that belong to its answer.
    """

    label: str
    argv: tuple[str, ...]
    kept: tuple[str, ...] = ("*.json",)

    @property
    def command(self) -> str:
        return self.argv[0]


@dataclass(frozen=True, slots=True)
class Source:
    """A log or a plan, the name that it is stored by, and the airframe files that lie beside it."""

    path: Path
    name: str
    airframes: tuple[Path, ...] = ()

    @property
    def is_plan(self) -> bool:
        return self.path.suffix.lower() in PLAN_ENDINGS

    @property
    def variants(self) -> Iterator[tuple[str, tuple[str, ...]]]:
        """The name of the answer and the options: without an airframe, and with each beside it."""
        yield self.name, ()
        for path in self.airframes:
            yield f"{self.name}@{path.stem}", ("--airframe", str(path))


def sources(folders: Sequence[Path]) -> list[Source]:
    """Return all logs and plans below `folders`, in the order of their names.

    Bundled ones are named `sitl_logs/...`, others by their whole path, so that two folders of the
    same name stay apart.
    """
    found = []
    for folder in folders:
        whole = folder.resolve()
        home = ROOT if whole.is_relative_to(ROOT) else Path(whole.anchor)
        for path in sorted(p for p in whole.rglob("*") if p.is_file()):
            if path.suffix.lower() in LOG_ENDINGS | PLAN_ENDINGS:
                beside = tuple(sorted(p for p in path.parent.glob("*.toml") if is_airframe(p)))
                found.append(Source(path, path.relative_to(home).as_posix(), beside))
    return found


def is_airframe(path: Path) -> bool:
    """Return whether a .toml file describes an airframe."""
    return "[quantities]" in path.read_text(encoding="utf-8")


def questions(folders: Sequence[Path], only: Sequence[str]) -> Iterator[Question]:
    """Yield what is asked of the commands `only`, on the logs and plans below `folders`."""
    for source in sources(folders):
        for question in _of_a_plan(source) if source.is_plan else _of_a_log(source):
            if question.command in only:
                yield question
    for question in (*_without_logs(), *_loop()):
        if question.command in only:
            yield question
    if {"learn", "fleet"} & {*only}:  # one needs the store of the other
        yield from _season()


def _of_a_log(source: Source) -> Iterator[Question]:
    path = str(source.path)
    for name, airframe in source.variants:
        load = ("--load", "0") if airframe else ()
        yield Question(name, ("inspect", path, *airframe, "--json", f"{OUT}/inspect.json"))
        yield Question(
            name,
            ("report", path, *airframe, *load, "--out", f"{OUT}/report.html"),
            ("*.json", "*.csv"),
        )
        about = (*airframe, "--fill", "8", "--flow", "2.5")
        yield Question(name, ("forecast", path, *about, "--json", f"{OUT}/forecast.json"))
    job = ("--product", "Water", "--rate", "20 L/ha", "--zone", "UTC")
    written = ("*.json", "*.csv", "*.geojson")
    yield Question(source.name, ("record", path, *job, "--out", OUT), written)
    yield Question(source.name, ("export", path, "--mcap", f"{OUT}/flight.mcap"), ("*.mcap",))
    yield Question(source.name, ("replay", path, "--no-browser", "--port", "0"))
    if source.path.suffix.lower() == ".tlog":
        where = ("--no-view", "--silent", "--record", OUT)
        yield Question(source.name, ("monitor", path, *where), ("*/events.jsonl",))


def _of_a_plan(source: Source) -> Iterator[Question]:
    about = ("--airframe", "topxgun-f16", "--fill", "10", "--flow", "2.5")
    path = str(source.path)
    yield Question(source.name, ("forecast", path, *about, "--json", f"{OUT}/forecast.json"))


def _without_logs() -> Iterator[Question]:
    for airframe in AIRFRAMES:
        model = ("--airframe", airframe)
        for day, options in DAYS.items():
            label = f"{airframe}/{day}"
            yield Question(label, ("fill", *model, *options, "--json", f"{OUT}/fill.json"))
        yield Question(airframe, ("match", *model), ())
        about = (*model, "--fill", "8", "--flow", "2.5", "--json", f"{OUT}/forecast.json")
        yield Question(f"demo@{airframe}", ("forecast", "demo", *about))
    for label, options in {
        "demo": (),
        "demo_north_with_headland": ("--heading", "0", "--headland", "4", "--px4", "--pump"),
    }.items():
        pump = ("servo:9:1000:2000",) if options else ()
        written = ("--out", f"{OUT}/field.plan", "--out", f"{OUT}/field.waypoints")
        about = ("--swath", "5", *options, *pump, *written)
        yield Question(label, ("cover", "demo", *about), ("*.plan", "*.waypoints"))


def _loop() -> Iterator[Question]:
    for label, names in IDENTIFIED.items():
        logs = [str(BUNDLED / name) for name in names]
        yield Question(label, ("identify", *logs, "--json", f"{OUT}/identify.json"))
    logs = [str(path) for path in sorted(BUNDLED.glob("campaign/v4_*.tlog"))]
    small = ("--members", "3", "--max-epochs", "20", "--split", "samples")
    yield Question("small", ("train", *logs, *small, "--out-model", f"{OUT}/small.safetensors"), ())


def _season() -> Iterator[Question]:
    logs = [str(BUNDLED / group) for group in ("campaign", "dev", "onset")]
    taken = ("--store", STORE, "--workers", "1", "--json", f"{OUT}/learn.json")
    yield Question("season", ("learn", *logs, *taken))
    shown = ("--json", f"{OUT}/fleet.json", "--csv", f"{OUT}/fleet.csv")
    yield Question("season", ("fleet", STORE, *shown), ("*.json", "*.csv"))
    for name, asked in SELECTS.items():
        yield Question(f"sql_{name}", ("fleet", STORE, "--sql", asked), ())
