"""How far the margin from motor outputs holds: flights that report rotor speeds, without them.

    python -m tests.lab.bench.bench_outputs [--hexa FOLDER AIRFRAME] [--quiver FOLDER AIRFRAME]

Each flight is read as it is, again without its ESC messages, and without those of its tank besides
(without those of the tank alone, thrust in use is the same: it rests on the speeds). Printed is,
for each group: rows of rotors in the air, half of the median 90 % interval of thrust in use, the
share of rows in which the full answer lies within it, and how many flights have the same verdict,
cannot tell, or another. The constants of `models.model.inferred.output_speed` were set on the
campaign flights and on Quiver 77 and 80; all others are scored only.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from tests.stripped_logs import is_tank, without
from thrustmargin.gcs_plugin.logs import FlightLog, read_log
from thrustmargin.gcs_plugin.reports.margin.summary import report_flight
from thrustmargin.models.model.analysis import FlightAnalysis, analyse
from thrustmargin.models.model.inferred.load_inference import fill_channels
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import Airframe, load_airframe

INTERVAL = 1.645  # standard errors of a 90 % interval

LOGS = Path(__file__).resolve().parents[3] / "sitl_logs"
ESCS = ("ESC_TELEMETRY_1_TO_4", "ESC_TELEMETRY_5_TO_8", "ESC")
MISSING = ("rotor speeds", "rotor speeds and tank level")


def groups(arguments: Sequence[str]) -> Iterator[tuple[str, str, list[Path], Airframe]]:
    """Name, role, logs and airframe of each group."""
    f16 = load_airframe("topxgun-f16-sitl")
    yield "campaign", "set on", sorted((LOGS / "campaign").glob("*.tlog")), f16
    for group in ("cg_forward", "climb", "extra_mass", "high_altitude", "windy", "worn_prop"):
        yield group, "scored", sorted((LOGS / "dev").glob(f"{group}_*.tlog")), f16
    yield "sag", "scored", [LOGS / "voltage" / "sag_real_rpm.tlog"], f16
    for option, folder, airframe in zip(*(arguments[k::3] for k in range(3)), strict=True):
        craft = load_airframe(airframe)
        logs = sorted(p for p in Path(folder).iterdir() if p.suffix.lower() in (".tlog", ".bin"))
        set_on = [p for p in logs if p.stem in ("77", "80")]
        if set_on:
            yield option.removeprefix("--"), "set on", set_on, craft
        yield option.removeprefix("--"), "scored", [p for p in logs if p not in set_on], craft


def analysed(log: Path, airframe: Airframe) -> tuple[FlightAnalysis, FlightLog]:
    read = read_log(log, airframe=airframe)
    track = fill_channels(read.track, airframe, read.parameters)
    return analyse(track, physics_model(airframe)), read


def level(flight: FlightAnalysis, log: FlightLog) -> str:
    return report_flight(flight, log, max_utilisation=0.5).json["verdict"]["level"]


def compared(log: Path, airframe: Airframe, missing: str, folder: Path) -> tuple[np.ndarray, str]:
    """(n, 3) true use, inferred use and its error of each rotor's rows; and of the verdict."""
    drop = is_tank if missing != "rotor speeds" else None
    whole = analysed(log, airframe)
    part = analysed(without(log, folder / log.name, *ESCS, drop=drop), airframe)
    (full, _), (inferred, _) = whole, part
    clock_s, here_s = (flight.track.time_s + read.clock_start_s for flight, read in (whole, part))
    rows = np.searchsorted(clock_s, here_s - 0.05).clip(0, clock_s.size - 1)
    same = np.abs(clock_s[rows] - here_s) < 0.051
    true = np.where(full.track.flying[:, None], full.utilisation, np.nan)[rows]
    columns = true, inferred.known_utilisation, inferred.utilisation_error
    found = np.stack(columns, axis=-1)[same & inferred.track.flying].reshape(-1, 3)
    said, right = level(*part), level(*whole)
    verdict = "same" if said == right else "cannot tell" if said in ("near", "unknown") else "other"
    return found[np.all(np.isfinite(found), axis=1)], verdict


def main(arguments: Sequence[str]) -> None:
    print("| group | flights | | missing | rows | ± points | within | same | cannot tell | other |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as temporary:
        for name, role, logs, airframe in groups(arguments):
            for missing in MISSING:
                if missing != "rotor speeds" and airframe.tank_volume_l == 0.0:
                    continue
                parts = [compared(log, airframe, missing, Path(temporary)) for log in logs]
                use = np.concatenate([rows for rows, _ in parts])
                half = INTERVAL * use[:, 2]
                within = np.mean(np.abs(use[:, 1] - use[:, 0]) <= half + 1e-12)
                verdicts = [verdict for _, verdict in parts]
                counts = " | ".join(
                    str(verdicts.count(v)) for v in ("same", "cannot tell", "other")
                )
                print(
                    f"| {name} | {len(logs)} | {role} | {missing} | {len(use)} | "
                    f"{100 * np.median(half):.1f} | {within:.1%} | {counts} |",
                    flush=True,
                )


if __name__ == "__main__":
    main(sys.argv[1:])
