"""What people are asked to do: every action once, with when it is safe.

Sentences take an action's `text`, so that none asks for hands on an aircraft that could turn a
rotor. A propeller fits one direction of rotation: put on a motor of the other it pushes nothing, or
the wrong way. So none is ever moved across; a new one of the same kind takes its place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

from thrustmargin.gcs_plugin.wording.language import say
from thrustmargin.models.model.inferred.load_inference import THEN_CHECK


class When(Enum):
    """When an action is safe."""

    BATTERY_OFF = "on the ground, disarmed, battery off: hands come near a rotor"
    DISARMED = "on the ground, disarmed: an instrument needs its power, no rotor is touched"
    IN_FLIGHT = "in flight"
    NEXT_FLIGHT = "when the next flight is planned"
    DESK = "at any time: in settings, files and orders"


#: What comes before an action, so that it is not done at another time.
LEADS: Mapping[When, str] = {
    When.BATTERY_OFF: "with the battery off, ",
    When.DISARMED: "disarmed on the ground, ",
}


@dataclass(frozen=True, slots=True)
class Action:
    """One thing that a person is asked to do, without a full stop."""

    part: str
    words: str
    when: When

    @property
    def text(self) -> str:
        """The words, after when they are safe where that is not any time."""
        return say(LEADS.get(self.when, "")) + say(self.words)


LAND = Action("vehicle", "land", When.IN_FLIGHT)
LOOK_FIRST = Action("rotor", "look there first", When.BATTERY_OFF)
INSPECT = Action(
    "propeller", "inspect its propeller or fit a new one of the same kind", When.BATTERY_OFF
)
SAME_KIND = Action(
    "propeller",
    "compare the size and pitch of its propeller with the others', and fit one of the same kind",
    When.BATTERY_OFF,
)
THEN_MOTOR = Action(
    "motor",
    "then look at its motor and ESC, which outputs cannot distinguish from it",
    When.DESK,  # goes on after INSPECT, which states when
)
UNSTEADY = Action("rotor", "look for what bends, slips or gets warm", When.DESK)  # after INSPECT
LOOK_AT_MOTOR = Action("motor", "look at its motor, ESC and wiring", When.BATTERY_OFF)
FEEL_HEAT = Action(
    "motor",
    "right after landing, compare the heat of its motor and ESC with the others'",
    When.BATTERY_OFF,
)
LEVEL_MOTORS = Action(
    "motor",
    "level the motors and look for a twisted arm; if the moment stays, fit new propellers, each "
    "of the kind of its own motor",
    When.BATTERY_OFF,
)
CLEAN_BLADES = Action(
    "propeller", "clean the blades, once gauge and ESC readings are checked", When.BATTERY_OFF
)
LOOK_FOR_MOUNTED = Action("airframe", "look for what was mounted or left open", When.BATTERY_OFF)
LOOK_BELOW = Action("load", "look at what hangs below", When.BATTERY_OFF)
LOOK_FOR_ICE = Action("airframe", "look at ice, dirt and a load that moves", When.BATTERY_OFF)
AFTER_A_JOLT = Action(
    "airframe", "look at frame, arms and propellers before it flies again", When.BATTERY_OFF
)
ARMS_CARRY = Action(
    "airframe",
    "look at what arms and booms carry; keep it in the model with --out-model",
    When.BATTERY_OFF,
)
BALANCE = Action(
    "load",
    "move battery or load back to the middle, or look for what was mounted",
    When.BATTERY_OFF,
)
WEIGH = Action("airframe", "weigh it ready to fly, without liquid", When.DISARMED)
CHECK_LOAD = Action("load", THEN_CHECK, When.DISARMED)
SET_GAUGE = Action("tank gauge", "weigh what is filled in and set the gauge by it", When.DISARMED)
ZERO_GAUGE = Action("tank gauge", "set it to zero with an empty tank", When.DISARMED)
CHECK_GAUGE = Action("tank gauge", "check it against what was filled in", When.DISARMED)
ZERO_AIRSPEED = Action("airspeed sensor", "set its zero before take-off", When.DISARMED)
CHECK_AIRSPEED = Action("airspeed sensor", "check its tube and its calibration", When.DISARMED)
CHECK_WIND = Action("airspeed sensor", "check the airspeed sensor", When.DISARMED)
TEST_BATTERY = Action("battery", "take the battery out and test it, or retire it", When.BATTERY_OFF)
CONNECT_GAUGE = Action(
    "tank gauge",
    "connect a tank gauge; or take the logs in with ingest --again --load KG",
    When.BATTERY_OFF,
)
KEEP = Action("model", "nothing to repair; keep it in the model with --out-model", When.DESK)
REPAIRED = Action("model", "nothing to do", When.DESK)
KEEP_AS_SEEN = Action("model", "keep it in the model with --out-model", When.DESK)
AIRSPEED_RATE = Action("settings", "check its filter and message rate", When.DESK)
ESC_RATE = Action("settings", "raise the rate of ESC telemetry", When.DESK)
ESC_SPEEDS = Action(
    "settings", "no measured speed does, so check whether the ESCs estimate it", When.DESK
)
ESC_TELEMETRY = Action(
    "settings", "switch on ESC telemetry, or have the motor outputs logged", When.DESK
)
COMPARE_SOUND = Action(
    "logs", "compare with a flight of this aircraft when it was sound", When.DESK
)
COMPARE_WIND = Action("logs", "compare with a flight in such wind", When.DESK)
IDENTIFY = Action("logs", "run thrustmargin identify on the flights since then", When.DESK)
INSPECT_LOG = Action("logs", "run thrustmargin inspect on one of its logs", When.DESK)
GROUND_WRECK = Action(
    "vehicle", "do not fly it before it is known why, and all of it was looked at", When.NEXT_FLIGHT
)
#: The same in the letters of a STATUSTEXT.
GROUND_BRIEFLY = "Do not fly before it is known why: look at all"
GROUND_IT = Action(
    "vehicle",
    "do not fly it before its battery and propellers were looked at; then fill less",
    When.NEXT_FLIGHT,
)
GROUND_BATTERY = Action(
    "battery",
    "do not fly it before its battery was tested or retired, for its resistance grew; then fill "
    "less",
    When.NEXT_FLIGHT,
)
FILL_LESS = Action("load", "fill less: thrustmargin fill says how much", When.NEXT_FLIGHT)
FLY_GENTLY = Action("vehicle", "fly turns and climbs more gently", When.NEXT_FLIGHT)
SAME_PLACE = Action(
    "load",
    "put load and battery in the same place each flight, or leave out odd flights",
    When.BATTERY_OFF,
)
LEVEL_OR_LEAVE_OUT = Action(
    "motor", "level the motors, and leave out flights with other propellers", When.BATTERY_OFF
)
STATE_LOAD = Action(
    "load",
    "weigh the load (--load), state the --air-temperature, check the tank gauge",
    When.DISARMED,
)


def change_propeller(rotor: int) -> Action:
    """Of a rotor, from 1, that a season shows as worn."""
    return Action(
        "propeller",
        say(
            "change propeller {rotor} for a new one of the same kind; if the loss stays, look at "
            "motor and ESC {rotor}",
            rotor=rotor,
        ),
        When.BATTERY_OFF,
    )


def inspect_rotors(rotors: Sequence[int]) -> Action:
    """Of rotors, from 1, that may be bad: before anybody flies to find out."""
    return Action(
        "rotor", f"inspect propeller and motor of {rotors_words(rotors)}", When.BATTERY_OFF
    )


def not_before_looked_at(rotors: Sequence[int]) -> Action:
    """Of rotors, from 1, for which an alarm was raised in the flight."""
    return Action(
        "rotor",
        say(
            "do not fly it before propeller, motor and ESC of {rotors} were looked at, battery off",
            rotors=rotors_words(rotors),
        ),
        When.NEXT_FLIGHT,
    )


def rotors_words(rotors: Sequence[int]) -> str:
    """`rotor 3`, `rotors 1 and 3`."""
    *others, last = map(str, rotors)
    numbers = f"{', '.join(others)} {say('and')} {last}" if others else last
    return say("rotors {numbers}" if len(rotors) > 1 else "rotor {numbers}", numbers=numbers)
