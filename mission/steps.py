"""Convert a plan into the steps that a vehicle flies: jumps followed, speed and pump orders
applied.

A step is one place flown to, one wait, or one landing. An item whose effect is unknown is listed
with the reason and the results it affects, and makes no step. Meanings are those of ArduPilot's
Copter ("Mission Commands") and of MAVLink's common messages.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from thrustmargin.mission.plan_items import (
    CHANGE_SPEED,
    DELAY,
    DO_JUMP,
    DO_SPRAYER,
    FIRMWARE_ARDUPILOT,
    FIRMWARE_PX4,
    FRAME_MISSION,
    LAND,
    LOITER_TIME,
    LOITER_TURNS,
    LOITER_UNLIMITED,
    RETURN_TO_LAUNCH,
    SPLINE_WAYPOINT,
    TAKEOFF,
    WAYPOINT,
    MissionPlan,
    NotUnderstood,
    PlanItem,
    Touched,
    Why,
)

LOITER_TO_ALTITUDE, VTOL_TAKEOFF, VTOL_LAND, PAYLOAD_PLACE = 31, 84, 85, 94
CONDITION_YAW, SET_RELAY, REPEAT_RELAY, SET_SERVO, REPEAT_SERVO = 115, 181, 182, 183, 184
JUMP_TAG, DO_JUMP_TAG = 600, 601
#: Commands of cameras, gimbals, fences and the like, which move nothing that is reckoned.
WITHOUT_PART = frozenset(
    {189, 196, 197, 200, 202, 203, 204, 205, 206, 207, 212, 214, 215, 217, 218, 222, 1000, 1001}
    | {530, 531, 532, 533, 534, 2000, 2001, 2500, 2501, JUMP_TAG}
)
SERVO_OUTPUT_SPRAYER = 22  # SERVOn_FUNCTION of ArduPilot's sprayer pump

#: Items flown again by jumps, beyond which a jump counts as one without an end.
MOST_AGAIN = 20_000

StepKind = Literal["take-off", "fly", "spline", "turns", "wait", "climb", "land", "return"]
ALL: tuple[Touched, ...] = ("distance", "time", "load")
#: Commands whose part is known, but not its amount.
_NAMED: Mapping[int, tuple[Why, tuple[Touched, ...]]] = {
    112: ("delays what follows", ("load", "heading")),
    114: ("delays what follows", ("load", "heading")),
    179: ("changes the return", ALL),
    193: ("waits for the ground station", ("time", "load")),
    195: ("points the nose", ("heading",)),
    201: ("points the nose", ("heading",)),
    211: ("drops a load", ("load",)),
}
#: Kind of step of each command that flies or waits.
_KINDS: Mapping[int, StepKind] = {
    WAYPOINT: "fly",
    LOITER_UNLIMITED: "fly",
    LOITER_TURNS: "turns",
    LOITER_TIME: "fly",
    RETURN_TO_LAUNCH: "return",
    LAND: "land",
    TAKEOFF: "take-off",
    LOITER_TO_ALTITUDE: "climb",
    SPLINE_WAYPOINT: "spline",
    VTOL_TAKEOFF: "take-off",
    VTOL_LAND: "land",
    DELAY: "wait",
    PAYLOAD_PLACE: "fly",
}
TAKE_OFFS = frozenset({TAKEOFF, VTOL_TAKEOFF})
#: Those whose first parameter is s to wait there.
_WAITS = frozenset({WAYPOINT, SPLINE_WAYPOINT, LOITER_TIME, DELAY})


@dataclass(frozen=True, slots=True, kw_only=True)
class PumpOutput:
    """The servo or relay that switches a vehicle's pump, besides DO_SPRAYER; both None: unknown."""

    servo: int | None = None  # number of the output, from 1
    off_us: float = 1100.0  # pulse at which the pump stops
    on_us: float = 1900.0
    relay: int | None = None  # number of the relay, from 0
    known: bool = False  # the vehicle's outputs are known, so that others are not the pump


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """A step of the vehicle, with the orders in force during it."""

    item: int  # number of the mission item
    index: int  # place of the item in the plan's order of execution, from 0
    kind: StepKind
    #: Latitude, longitude in degrees and altitude in m of `frame`; None: where it is then.
    place: tuple[float, float, float] | None
    frame: int
    speed: float | None  # m/s over ground; None: the vehicle's own setting
    climb_speed: float | None  # m/s
    descent_speed: float | None  # m/s
    pump: bool | None  # None: the plan has not switched it yet, so as it was before
    heading_deg: float | None  # that the plan orders; None: the vehicle's own rule
    wait_s: float = 0.0  # waited there once arrived
    height: float = math.nan  # m of `frame` to go to; NaN: the height it is at then
    turns: float = 0.0  # circles flown there
    radius: float = 0.0  # m of these


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanSteps:
    """The steps in order, and the items of the plan that they do not include."""

    steps: tuple[Step, ...]
    executed: tuple[PlanItem, ...]  # items in order of execution, jumps followed
    not_understood: tuple[NotUnderstood, ...]
    pump_at_end: bool | None = None  # None: no order was given
    pump_by_rule: bool = False  # the plan does not switch it: mission.pump_rule


def pump_output(parameters: Mapping[str, float]) -> PumpOutput:
    """Return the servo output that switches the pump, found by the SERVOn_FUNCTION parameters.

    With it come the pulses, µs, for off and on. `servo` of the result is None if no output has the
    sprayer's function, and `known` is False if there are no such parameters at all.
    """
    switch = PumpOutput(known=any(n.endswith("_FUNCTION") for n in parameters))
    for output in range(1, 33):
        name = f"SERVO{output}_"
        if parameters.get(f"{name}FUNCTION") == SERVO_OUTPUT_SPRAYER:
            ends = (parameters.get(f"{name}MIN", 1100.0), parameters.get(f"{name}MAX", 1900.0))
            off, on = ends[::-1] if parameters.get(f"{name}REVERSED") == 1.0 else ends
            return replace(switch, servo=output, off_us=off, on_us=on)
    return switch


def pump_switch(pump: PumpOutput, *, on: bool) -> PlanItem:
    """Return the mission item, not yet numbered, that switches the pump at the output `pump` on
    or off."""
    command, values = DO_SPRAYER, (float(on), 0.0)
    if pump.servo is not None:
        command, values = SET_SERVO, (float(pump.servo), pump.on_us if on else pump.off_us)
    elif pump.relay is not None:
        command, values = SET_RELAY, (float(pump.relay), float(on))
    return PlanItem(
        number=0,
        command=command,
        frame=FRAME_MISSION,
        parameters=(*values, 0.0, 0.0, 0.0, 0.0, 0.0),
    )


def plan_steps(plan: MissionPlan, pump: PumpOutput | None = None) -> PlanSteps:
    """Return the steps that a vehicle executes for `plan`; `pump` is its pump's output (None:
    unknown).

    Items after a return to launch, or after loitering without end, are left out.
    """
    walk = _Walk(plan.firmware, pump or PumpOutput(), list(plan.not_understood))
    executed = _executed(plan, walk)
    for index, item in enumerate(executed):
        walk.take(index, item)
        if item.command in (RETURN_TO_LAUNCH, LOITER_UNLIMITED):
            break  # nothing that follows is ever flown
    seen = dict.fromkeys(walk.open)
    return PlanSteps(
        steps=tuple(walk.steps),
        executed=tuple(executed),
        not_understood=tuple(seen),
        pump_at_end=walk.pump,
    )


@dataclass(slots=True)
class _Walk:
    """The state while a plan's items are read in order: orders in force, and the steps so far."""

    firmware: int
    output: PumpOutput
    open: list[NotUnderstood]
    steps: list[Step] = field(default_factory=list)
    speed: float | None = None
    climb_speed: float | None = None
    descent_speed: float | None = None
    pump: bool | None = None
    heading_deg: float | None = None

    def name(self, item: PlanItem, why: Why, *touches: Touched) -> None:
        self.open.append(
            NotUnderstood(item=item.number, command=item.command, why=why, touches=touches)
        )

    def take(self, index: int, item: PlanItem) -> None:
        kind = _KINDS.get(item.command)
        if kind is None:
            self._order(item)
            return
        one, _, three, four, *_ = item.parameters
        amount = max(one, 0.0) if math.isfinite(one) else 0.0
        circled = kind == "turns" and math.isfinite(three) and three != 0.0
        if kind == "turns" and not circled:
            kind = "fly"
            self.name(item, "loiter without a radius", *ALL)
        if item.command == LOITER_UNLIMITED:
            self.name(item, "waits without end", *ALL)
        if item.command == PAYLOAD_PLACE:
            self.name(item, "drops a load", "time", "load")
        if item.command == DELAY and not one >= 0.0:
            self.name(item, "waits for a time of day", "time", "load")
        # Only PX4 turns to a waypoint's fourth parameter.
        turned = self.firmware == FIRMWARE_PX4 and kind == "fly" and math.isfinite(four)
        self.steps.append(
            Step(
                item=item.number,
                index=index,
                kind=kind,
                place=item.place,
                height=item.height,
                frame=item.frame,
                speed=self.speed,
                climb_speed=self.climb_speed,
                descent_speed=self.descent_speed,
                pump=self.pump,
                heading_deg=four % 360.0 if turned else self.heading_deg,
                wait_s=amount if item.command in _WAITS else 0.0,
                turns=amount if circled else 0.0,
                radius=abs(three) if circled else 0.0,
            )
        )
        self.heading_deg = None  # an ordered yaw ends at the next place

    def _order(self, item: PlanItem) -> None:
        """Apply a command that does not move the vehicle (speed, pump, heading) to the state.

        Commands whose influence is not modelled are listed as not understood.
        """
        one, two, _, four, *_ = item.parameters
        if item.command == CHANGE_SPEED:
            self._speeds(item, one, two)
        elif item.command == DO_SPRAYER:
            self.pump = one > 0.5
        elif item.command in (SET_SERVO, REPEAT_SERVO, SET_RELAY, REPEAT_RELAY):
            self._outputs(item, one, two)
        elif item.command == CONDITION_YAW and four == 0.0 and math.isfinite(one):
            self.heading_deg = one % 360.0
        elif item.command == CONDITION_YAW:
            self.name(item, "points the nose", "heading")
        elif item.command in _NAMED:
            why, touches = _NAMED[item.command]
            self.name(item, why, *touches)
        elif item.command not in WITHOUT_PART:
            self.name(item, "unknown command", *ALL)

    def _speeds(self, item: PlanItem, which: float, speed: float) -> None:
        """Apply a change of speed to the state; `speed` in m/s, -1 no change, -2 the vehicle's own
        speed, stored as None.

        `which` is the command's type: 2 climb, 3 descent; 0 airspeed and 1 ground speed are
        equivalent to a Copter. Any other type or speed is listed as not understood; the invalid
        speed of a known type is then replaced by the vehicle's own.
        """
        if which not in (0.0, 1.0, 2.0, 3.0) or not (speed > 0.0 or speed in (-1.0, -2.0)):
            self.name(item, "unknown command", "time", "load")
        if speed == -1.0:
            return
        ordered = speed if speed > 0.0 else None
        if which in (0.0, 1.0):
            self.speed = ordered
        elif which == 2.0:
            self.climb_speed = ordered
        elif which == 3.0:
            self.descent_speed = ordered

    def _outputs(self, item: PlanItem, number: float, value: float) -> None:
        servo = item.command in (SET_SERVO, REPEAT_SERVO)
        own = self.output.servo if servo else self.output.relay
        if own is None or number != own:
            other = own is not None or (self.output.known and servo)
            if not other:
                self.name(item, "an output that may be the pump", "load")
            return
        if item.command in (REPEAT_SERVO, REPEAT_RELAY):
            self.name(item, "an output that may be the pump", "load")
        elif servo:
            share = (value - self.output.off_us) / (self.output.on_us - self.output.off_us)
            self.pump = share > 0.1
        else:
            self.pump = value > 0.5


def speeds_of_nothing(steps: PlanSteps) -> list[tuple[int, float]]:
    """List the items that order a speed over ground of 0 or below: their number, and m/s.

    -1 is no change, and -2 the vehicle's own speed.
    """
    return [
        (item.number, item.parameters[1])
        for item in steps.executed
        if item.command == CHANGE_SPEED
        and item.parameters[0] in (0.0, 1.0)
        and item.parameters[1] <= 0.0
        and item.parameters[1] not in (-1.0, -2.0)
    ]


def _jump_targets(items: Sequence[PlanItem]) -> dict[int, int]:
    """Map the index of each jump in `items` to the index of its target, both from 0.

    A jump is left out if its target's number or tag is missing, or its number is not unique.
    """
    numbers = Counter(item.number for item in items)
    at_number: dict[float, int] = {
        item.number: k for k, item in enumerate(items) if numbers[item.number] == 1
    }
    at_tag: dict[float, int] = {
        item.parameters[0]: k for k, item in enumerate(items) if item.command == JUMP_TAG
    }
    goals = {
        k: (at_number if item.command == DO_JUMP else at_tag).get(item.parameters[0])
        for k, item in enumerate(items)
        if item.command in (DO_JUMP, DO_JUMP_TAG)
    }
    return {k: goal for k, goal in goals.items() if goal is not None}


def jumps_back(plan: MissionPlan) -> list[int]:
    """Return the item numbers of the jumps that repeat items.

    A jump forward repeats none. A jump without a target counts.
    """
    targets = _jump_targets(plan.items)
    return [
        item.number
        for k, item in enumerate(plan.items)
        if item.command in (DO_JUMP, DO_JUMP_TAG) and targets.get(k, k) <= k
    ]


def _executed(plan: MissionPlan, walk: _Walk) -> list[PlanItem]:
    """Return the items in order of execution, without the jumps; jumps are followed.

    A jump to nothing or to itself, or one without end, ends the list: at the jump, or for too many
    repeats where the first jump that is followed back began. `walk` then lists the jump as not
    understood.
    """
    items = plan.items
    targets = _jump_targets(items)
    jumps_left: dict[int, float] = {}
    done: list[PlanItem] = []
    index = jumps = 0
    before_jumps = len(items)  # executed before the first that is followed
    while index < len(items):
        item = items[index]
        if item.command not in (DO_JUMP, DO_JUMP_TAG):
            done.append(item)
            index += 1
            continue
        repeats, goal = item.parameters[1], targets.get(index)
        # A jump forward comes back only by another one: it has no end of its own to reach.
        back = goal is None or goal <= index
        jumps += 1
        why: Why | None = None
        if goal is None or not math.isfinite(repeats):
            why = "jump to nothing"
        elif goal == index:
            why = "jump to itself"
        elif back and repeats < 0.0:
            why = "jump without end"
        elif back and len(done) + jumps > len(items) + MOST_AGAIN:
            why, done = "jump without end", done[:before_jumps]
        if goal is None or why is not None:
            walk.name(item, why or "jump to nothing", *ALL)
            return done
        if jumps_left.setdefault(index, math.inf if repeats < 0.0 else repeats) >= 1.0:
            before_jumps = min(before_jumps, len(done)) if back else before_jumps
            jumps_left[index] -= 1.0
            index = goal
            continue
        if plan.firmware != FIRMWARE_ARDUPILOT:
            del jumps_left[index]  # the others count anew when they come by again
        index += 1
    return done
