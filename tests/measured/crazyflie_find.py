"""What the project finds on imrc_crazyflie_rpm: a plain check, then the loop, blind."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tests.measured.crazyflie import (
    CABLE_FLIGHTS,
    FOLDER,
    FREE_FLIGHTS,
    read_flights,
)
from tests.measured.crazyflie_errors import joined_errors
from tests.measured.crazyflie_loop import (
    Loop,
    close_loop,
    hover_airframe,
    joined,
    judged_on,
    usable,
)
from tests.measured.crazyflie_numbers import Flown, numbers_of
from tests.measured.findings import Finding, Progress
from tests.measured.swing_check import check_swing
from tests.measured.thrust_check import (
    THIRDS,
    command_check,
    hover_lift,
    plain_check,
)
from thrustmargin.models.checks.motor_order import check_motor_order
from thrustmargin.models.model.rotor_model import physics_model
from thrustmargin.models.physics.airframe import load_airframe

AIRFRAME = "crazyflie-rpm"
#: s; rows of the plain check, as the independent check seems to have had them
PLAIN_MEAN = 0.1


def find(
    folder: Path,
    *,
    surrogates: int = 99,
    quick: bool = False,
    progress: Progress | None = None,
) -> Finding:
    """Read, check, close the loop. Raises DataError when a file is missing or of another kind."""
    flown = fly(folder, surrogates=surrogates, quick=quick, progress=progress)
    return Finding(
        name=FOLDER,
        title="The loop on real flights with measured rotor speeds",
        numbers=numbers_of(flown),
        notes=(
            "the aircraft has no tank: its level is 0 kg throughout, and effects of a tank are "
            "not looked for",
            f"named without payload: {'; '.join(', '.join(loop.names) for loop in flown.loops)}",
            f"named with a load on a cable: {', '.join(flown.on_cable.names)}",
            *flown.put_aside,
        ),
        details=_details(flown),
    )


def fly(folder: Path, *, surrogates: int, quick: bool, progress: Progress | None = None) -> Flown:
    """All the work on one folder; `quick` leaves out only the first third without payload."""
    told = progress or (lambda what, share: None)  # noqa: ARG005
    told("reading the flights", 0.0)
    airframe = load_airframe(AIRFRAME)
    all_free = read_flights(folder, FREE_FLIGHTS)
    all_cable = read_flights(folder, CABLE_FLIGHTS)
    all_finer = read_flights(folder, FREE_FLIGHTS, mean_over=PLAIN_MEAN)
    free, free_aside = usable(all_free, airframe)
    cable, cable_aside = usable(all_cable, airframe)
    kept = {f.track.name for f in free}
    finer = [f for f in all_finer if f.track.name in kept]
    loops = []
    for third in range(1 if quick else THIRDS):
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
    length = on_cable.parameter("slung_load", "cable")[0]
    judged = [judged_on(loop, finer) for loop in loops]
    return Flown(
        put_aside=(*free_aside, *cable_aside),
        order=check_motor_order(joined(free), airframe),
        plain=plain_check(finer, only=0 if quick else None),
        plain_of_all=plain_check(all_finer, only=0 if quick else None),
        command=command_check(finer),
        mass_ratio=cable[0].mass / free[0].mass,
        lift_ratio=hover_lift(cable) / hover_lift(free),
        loops=tuple(loops),
        curve=joined_errors([j[0] for j in judged]),
        after=joined_errors([j[1] for j in judged]),
        after_felt=joined_errors([j[2] for j in judged]),
        on_cable=on_cable,
        swing=check_swing(
            cable,
            length if np.isfinite(length) else 1.0,
            loops[0].model.airframe.thrust_coefficient,
        ),
    )


def _details(flown: Flown) -> dict[str, Any]:
    def told(loop: Loop) -> dict[str, Any]:
        return {
            "held_out": list(loop.held_out),
            "thrust_after_ci95": list(loop.after.interval()),
            "thrust_curve_ci95": list(loop.curve.interval()),
            "identify": loop.found.to_json(model_in=AIRFRAME),
        }

    return {
        "motor_order": flown.order.verdict,
        "loops": [told(loop) for loop in flown.loops],
        "cable_loop": told(flown.on_cable),
    }
