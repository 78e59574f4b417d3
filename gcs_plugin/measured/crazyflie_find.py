"""What the project finds on imrc_crazyflie_rpm: a plain check, then the loop, blind."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from gcs_plugin.measured.crazyflie import (
    CABLE_FLIGHTS,
    FOLDER,
    FREE_FLIGHTS,
    read_flights,
)
from gcs_plugin.measured.crazyflie_figures import figures_of
from gcs_plugin.measured.crazyflie_loop import (
    Loop,
    close_loop,
    hover_airframe,
    joined,
    judged_on,
)
from gcs_plugin.measured.crazyflie_words import Flown, answer_of, numbers_of
from gcs_plugin.measured.findings import Finding, Progress
from gcs_plugin.measured.swing_check import check_swing
from gcs_plugin.measured.thrust_check import (
    THIRDS,
    command_check,
    hover_lift,
    plain_check,
)
from models.airframe import load_airframe
from models.motor_order import check_motor_order
from models.rotor_model import physics_model

SOURCE = (
    "github.com/IMRCLab/crazyflie-data-collection, IMRC Lab, TU Berlin (no licence stated); "
    "flights of a Crazyflie 2.1 Brushless with measured rotor speeds"
)
AIRFRAME = "crazyflie-rpm"
#: s; rows of the plain check, as the independent check seems to have had them
PLAIN_MEAN = 0.1


def find(
    folder: Path,
    *,
    surrogates: int = 99,
    all_thirds: bool = False,
    progress: Progress | None = None,
) -> Finding:
    """Read, check, close the loop. Raises DataError when a file is missing or of another kind."""
    flown = fly(folder, surrogates=surrogates, all_thirds=all_thirds, progress=progress)
    return Finding(
        name=FOLDER,
        title="The loop on real flights with measured rotor speeds",
        source=SOURCE,
        answer=answer_of(flown),
        numbers=numbers_of(flown),
        notes=(
            "the aircraft has no tank: its level is 0 kg throughout, and effects of a tank are "
            "not looked for",
            *flown.on_cable.put_aside,
            *flown.loops[0].put_aside,
        ),
        figures=figures_of(flown.loops[0], flown.on_cable, flown.cable),
        details=_details(flown),
    )


def fly(
    folder: Path, *, surrogates: int, all_thirds: bool, progress: Progress | None = None
) -> Flown:
    """All the work on one folder."""
    told = progress or (lambda what, share: None)  # noqa: ARG005
    told("reading the flights", 0.0)
    free = read_flights(folder, FREE_FLIGHTS)
    cable = read_flights(folder, CABLE_FLIGHTS)
    finer = read_flights(folder, FREE_FLIGHTS, mean_over=PLAIN_MEAN)
    airframe = load_airframe(AIRFRAME)
    loops = []
    for third in range(THIRDS if all_thirds else 1):
        model = physics_model(hover_airframe(airframe, free, third=third))
        label = f"without payload, third {third + 1} left out: "
        loops.append(
            close_loop(
                model,
                free,
                surrogates=surrogates,
                third=third,
                progress=lambda what, share, label=label: told(label + what, share),
            )
        )
    on_cable = close_loop(
        loops[0].model,
        cable,
        surrogates=surrogates,
        progress=lambda what, share: told(f"with a load on a cable: {what}", share),
    )
    told("the load's swing", 0.0)
    good = [f for f in cable if not f.wrong_sensors]
    length = on_cable.parameter("slung_load", "cable")[0]
    return Flown(
        free=free,
        cable=cable,
        order=check_motor_order(joined(free), airframe),
        plain=plain_check(finer),
        plain_third=plain_check(finer, only=0),
        command=command_check(finer),
        mass_ratio=good[0].mass / free[0].mass,
        lift_ratio=hover_lift(good) / hover_lift(free),
        loops=tuple(loops),
        finer=judged_on(loops[0], finer),
        on_cable=on_cable,
        swing=check_swing(good, length if np.isfinite(length) else 1.0),
    )


def _details(flown: Flown) -> dict[str, Any]:
    def told(loop: Loop) -> dict[str, Any]:
        return {
            "held_out": list(loop.held_out),
            "put_aside": list(loop.put_aside),
            "thrust_after_ci95": list(loop.after.interval()),
            "thrust_curve_ci95": list(loop.curve.interval()),
            "identify": loop.found.to_json(model_in=AIRFRAME),
        }

    return {
        "motor_order": flown.order.verdict,
        "loops": [told(loop) for loop in flown.loops],
        "cable_loop": told(flown.on_cable),
    }
