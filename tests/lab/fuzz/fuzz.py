"""Damaged files of every kind for so many seconds; what is no refusal in words is a fault.

    python -m tests.lab.fuzz.fuzz --seconds 600 [--only plan] [--seed 1] [--out out/fuzz]

A reader may read a damaged file or refuse it with a ThrustMarginError. Any other exception, over
10 s of processor time or 3 GB of memory is a fault: the file is kept in `--out`, its place printed.
"""

from __future__ import annotations

import argparse
import resource
import signal
import sys
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path
from random import Random

from tests.lab.fuzz.damage import damaged
from tests.lab.fuzz.inputs import Kind, kinds
from thrustmargin.models.errors import ThrustMarginError

LONGEST_S, MOST_BYTES = 10.0, 3 << 30


class TooLongError(BaseException):
    """A reader took longer than any file may."""


def _too_long(*_: object) -> None:
    raise TooLongError


def outcome(kind: Kind, data: bytes, path: Path) -> str:
    """`read`, `refused`, or in one line what went wrong and where."""
    path.write_bytes(data)
    signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
    try:
        kind.read(path)
    except ThrustMarginError as error:
        return "refused" if str(error).strip() else "refused without a word"
    except (Exception, TooLongError) as error:
        places = traceback.extract_tb(error.__traceback__)
        ours = [p for p in places if "thrustmargin" in p.filename] or places
        place = ours[-1].filename.rpartition("thrustmargin/")[2]
        return f"{type(error).__name__} at {place}:{ours[-1].lineno}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    return "read"


def main() -> int:
    given = argparse.ArgumentParser(description=__doc__)
    given.add_argument("--seconds", type=float, default=60.0)
    given.add_argument("--only", nargs="*", default=[])
    given.add_argument("--seed", type=int, default=0)
    given.add_argument("--out", type=Path, default=Path("out/fuzz"))
    asked = given.parse_args()
    resource.setrlimit(resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
    signal.signal(signal.SIGPROF, _too_long)
    warnings.simplefilter("ignore")
    asked.out.mkdir(parents=True, exist_ok=True)
    chosen = {n: k for n, k in kinds() if not asked.only or n in asked.only}
    counts: dict[str, Counter[str]] = {name: Counter() for name in chosen}
    faults: Counter[str] = Counter()
    end, seed = time.monotonic() + asked.seconds, asked.seed
    while time.monotonic() < end:
        for name, kind in chosen.items():
            if seed % kind.every:
                continue
            data = damaged(kind.whole, Random(f"{name} {seed}"), text=kind.text)
            found = outcome(kind, data, asked.out / f"now_{name}{kind.ending}")
            counts[name][found if found in ("read", "refused") else "fault"] += 1
            if found not in ("read", "refused"):
                faults[f"{name}: {found}"] += 1
                if faults[f"{name}: {found}"] == 1:
                    (asked.out / f"{name}_{seed}{kind.ending}").write_bytes(data)
                    print(f"{name}_{seed}{kind.ending}: {found}", flush=True)
        seed += 1
    for name, count in counts.items():
        print(f"{name:11}", *(f"{what} {count[what]:7}" for what in ("read", "refused", "fault")))
    print(f"{sum(c.total() for c in counts.values())} inputs, {len(faults)} faults")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
