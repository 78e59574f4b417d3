"""Ask once where the pump is on in a plan that does not switch it, and remember the answer.

The answer is kept in the airframe file as `pump_on`. A script is never asked: there the answer of
the forecast names the option.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from thrustmargin.gcs_plugin.commands.shared.terminal import Terminal
from thrustmargin.models.errors import DataError
from thrustmargin.models.whole_file import whole_file

if TYPE_CHECKING:
    from thrustmargin.mission.plan_items import MissionPlan
    from thrustmargin.mission.pump_rule import PumpRule
    from thrustmargin.mission.steps import PumpOutput
    from thrustmargin.models.physics.airframe import Airframe

QUESTION = (
    "The plan never switches the pump. Where is it on: always (from the first place to the last), "
    "lines (along the parallel lines), or off? "
)


def never_switched(
    plan: MissionPlan,
    output: PumpOutput | None,
    parameters: Mapping[str, float],
    craft: Airframe,
) -> bool:
    """Return True if the user must be asked when the pump runs, because nothing states it.

    False if the plan switches the pump, the airframe file has a rule for it, or there is no tank.
    False too if the plan has an order that may be the pump's: the report then says how to declare
    it. `output` is the pump's output; None: that in the autopilot's `parameters`.
    """
    from thrustmargin.mission.pump_rule import airframe_rule, orders_pump
    from thrustmargin.mission.steps import plan_steps, pump_output

    if not craft.tank_volume_l or airframe_rule(craft) is not None:
        return False
    steps = plan_steps(plan, output or pump_output(parameters))
    open_ones = any(n.why == "an output that may be the pump" for n in steps.not_understood)
    return orders_pump(steps) is None and not open_ones


def asked_pump_rule(airframe: str | None) -> PumpRule | None:
    """Ask in the terminal when the pump runs in a plan: "always", on its "lines", or "off".

    Store the answer in `airframe` if that is the path of a .toml file. Return None for "off",
    without a terminal, and at the end of the input.
    """
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        return None
    console = Terminal(soft_wrap=True)
    answers: dict[str, PumpRule | None] = {"always": "always", "lines": "lines", "off": None}
    while True:
        try:
            answer = input(QUESTION).strip().lower()
        except EOFError:
            return None
        if answer in answers:
            break
        console.print(f"{answer!r:.40} is none of {', '.join(answers)}; try again")
    rule = answers[answer]
    if rule is not None and airframe is not None and airframe.endswith(".toml"):
        remember_pump_rule(Path(airframe), rule)
        console.print(f'remembered in {airframe}: pump_on = "{rule}"')
    elif rule is not None:
        console.print(f"not remembered, for no airframe file was given; next time: --pump {rule}")
    return rule


def remember_pump_rule(path: Path, rule: PumpRule) -> None:
    """Set the key `pump_on` in the airframe file at `path`; keep all other text, also comments.

    Raise DataError if the file cannot be read or written.
    """
    try:
        text = path.read_text(encoding="utf-8")
        line = f'pump_on = "{rule}"'
        if "pump_on" in tomllib.loads(text):
            text = re.sub(r"^\s*pump_on\s*=[^\n]*$", line, text, count=1, flags=re.MULTILINE)
        else:
            # Keys of the top come before any table, so at the first line that is no comment.
            lines = text.splitlines(keepends=True)
            bare = (k for k, one in enumerate(lines) if one.strip() and not one.startswith("#"))
            first = next(bare, len(lines))
            text = "".join([*lines[:first], f"{line}\n", *lines[first:]])
        assert tomllib.loads(text)["pump_on"] == rule
        with whole_file(path) as draft:
            draft.write_text(text, encoding="utf-8")
    except OSError as error:
        raise DataError(f"cannot write {path}: {error.strerror or error}") from error
