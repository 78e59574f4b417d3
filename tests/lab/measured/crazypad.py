"""Reader and check of crazypad_damaged_rotor: propellers cut shorter on motor 3, by command share.

Source: github.com/AerialRoboticsUUST/CrazyPAD, commit 5448265, MIT; Masalimov, Muslimov, Kozlov,
Munasypov, CrazyPAD, Data 2024, 9, 79. One row a log: medians of a hover. Columns used: cond (the
folder's name, with the length that is left: 47 mm when whole), craft, pwm.m1 to pwm.m4 (to the
motors), motor.m1 to motor.m4 (before the firmware corrects them for the battery's voltage).

No rotor speed was measured. A rotor that makes less thrust at a speed needs a higher speed and so
a higher command: its share of the four commands rises as its blades get shorter.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.lab.measured.findings import Finding, Number
from tests.lab.measured.tables import csv_columns
from thrustmargin.models.errors import DataError
from thrustmargin.models.flight import Floats

FOLDER = "crazypad_damaged_rotor"
FILE = "hover_medians_per_log.csv"
WHOLE_MM = 47.0
CUT = re.compile(r"cut_propeller_M3_.*_(\d+(?:\.\d+)?)mm")
QUOTED = -0.957  # by an independent check


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cuts:
    """Hover logs of one aircraft with the propeller of motor 3 whole or cut."""

    craft: str
    length_mm: Floats  # (L,) of the blades on motor 3
    share: Floats  # (L,) of motor 3 in the four commands to the motors
    asked_share: Floats  # (L,) likewise before the firmware corrects them for the voltage

    @property
    def correlation(self) -> float:
        """Of length with share; -1 is a straight fall."""
        return float(np.corrcoef(self.length_mm, self.share)[0, 1])

    @property
    def asked_correlation(self) -> float:
        return float(np.corrcoef(self.length_mm, self.asked_share)[0, 1])


def read_cuts(folder: Path) -> list[Cuts]:
    """Logs with the length stated, by aircraft, the one with most logs first.

    Raises DataError when the table is missing, of another kind, or holds no cut propeller.
    """
    names = {kind: [f"{kind}.m{k}" for k in (1, 2, 3, 4)] for kind in ("pwm", "motor")}
    table = csv_columns(folder / FILE, (*names["pwm"], *names["motor"]), words=("cond", "craft"))
    share, asked = (
        table[of[2]] / sum(table[name] for name in of) for of in (names["pwm"], names["motor"])
    )
    length = np.array([_length(str(words)) for words in table["cond"]])
    known = np.isfinite(length)
    crafts = table["craft"].astype(str)
    made = []
    for craft in np.unique(crafts[known]):
        mine = known & (crafts == craft)
        made.append(
            Cuts(
                craft=str(craft),
                length_mm=length[mine],
                share=share[mine],
                asked_share=asked[mine],
            )
        )
    made = [c for c in made if np.unique(c.length_mm).size > 2]
    if not made:
        raise DataError(f"{FILE} has no hover with a cut propeller on motor 3")
    return sorted(made, key=lambda c: -c.share.size)


def _length(condition: str) -> float:
    if condition == "normal_flight":
        return WHOLE_MM
    found = CUT.fullmatch(condition)
    return float(found.group(1)) if found else float("nan")


def find(folder: Path) -> Finding:
    """How the command share of a motor goes with the length of its blades."""
    main, *others = read_cuts(folder)
    slope, _ = np.polyfit(main.length_mm, main.share, 1)
    return Finding(
        name=FOLDER,
        title="A cut propeller seen in the share of commands",
        numbers=(
            Number(
                *("correlation", main.correlation, "1", QUOTED, "at most"),
                label=f"blade length with share of commands to the motors, {main.craft}, r",
            ),
            Number(
                *("correlation_before_voltage", main.asked_correlation, "1", QUOTED, "at most"),
                label="the same before the correction for voltage",
            ),
            Number("hovers", main.share.size),
            Number("share_per_mm", float(slope), "1/mm"),
            *(Number(f"correlation_{c.craft}", c.correlation) for c in others),
        ),
        notes=("cuts of other motors, tape and added weights are in the table but not used here",),
    )
