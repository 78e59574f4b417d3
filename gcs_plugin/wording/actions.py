"""Define every action that people are asked for, with the conditions in which it is safe.

Sentences use `Action.text`, so that nobody is asked to touch a rotor that could turn. Propellers
fit one direction of rotation: on a motor of the other one they give no thrust or reverse thrust. So
they are never swapped between directions; a new one of the same kind is fitted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum, StrEnum
from functools import partial

from thrustmargin.gcs_plugin.wording.language import say
from thrustmargin.models.model.advice import FlightLevel
from thrustmargin.models.model.fault_test import LEAST
from thrustmargin.models.model.inferred.load_inference import THEN_CHECK
from thrustmargin.models.model.model_misfit import Caveat


class When(Enum):
    """The condition in which an action is safe."""

    BATTERY_OFF = "on the ground, disarmed, battery off: hands come near a rotor"
    DISARMED = "on the ground, disarmed: an instrument needs its power, no rotor is touched"
    IN_FLIGHT = "in flight"
    NEXT_FLIGHT = "when the next flight is planned"
    DESK = "at any time: in settings, files and orders"


#: Condition in front of an action, so that it is done only when safe.
LEADS: Mapping[When, str] = {
    When.BATTERY_OFF: "with the battery off, ",
    When.DISARMED: "disarmed on the ground, ",
}


@dataclass(frozen=True, slots=True)
class Action:
    """An action for a person, in words without a full stop, and the phase in which it is safe."""

    part: str
    words: str
    when: When

    @property
    def text(self) -> str:
        """Return the action in the selected language, preceded by the condition that makes it
        safe."""
        return say(LEADS.get(self.when, "")) + say(self.words)


#: Actions by when they are safe.
hands_on, disarmed, at_desk, next_flight = (
    partial(Action, when=when)
    for when in (When.BATTERY_OFF, When.DISARMED, When.DESK, When.NEXT_FLIGHT)
)
LAND = Action("vehicle", "land", When.IN_FLIGHT)
FLY_BY_SIGHT = Action("vehicle", "fly by sight", When.IN_FLIGHT)
LOOK_FIRST = hands_on("rotor", "look there first")
INSPECT = hands_on("propeller", "inspect its propeller or fit a new one of the same kind")
SAME_KIND = hands_on(
    "propeller",
    "compare the size and pitch of its propeller with the others', and fit one of the same kind",
)
#: Both follow INSPECT, which states the condition.
THEN_MOTOR = at_desk(
    "motor", "then look at its motor and ESC, which outputs cannot distinguish from it"
)
UNSTEADY = at_desk("rotor", "look for what bends, slips or gets warm")
LOOK_AT_MOTOR = hands_on("motor", "look at its motor, ESC and wiring")
WHICH_MOTOR = hands_on(
    "motor", "take the propellers off; then find by a motor test which motor has which number"
)
SWAP_ALIKE = hands_on(
    "propeller",
    "swap the propellers of two rotors of one direction of rotation and fly again: what goes with "
    "a propeller is the propeller's",
)
FEEL_HEAT = hands_on(
    "motor", "right after landing, compare the heat of its motor and ESC with the others'"
)
LEVEL_MOTORS = hands_on(
    "motor",
    "level the motors and look for a twisted arm; if the moment stays, fit new propellers, each "
    "of the kind of its own motor",
)
CLEAN_BLADES = hands_on("propeller", "clean the blades, once gauge and ESC readings are checked")
LOOK_FOR_MOUNTED = hands_on("airframe", "look for what was mounted or left open")
LOOK_BELOW = hands_on("load", "look at what hangs below")
LOOK_FOR_ICE = hands_on("airframe", "look at ice, dirt and a load that moves")
AFTER_A_JOLT = hands_on("airframe", "look at frame, arms and propellers before it flies again")
ARMS_CARRY = hands_on(
    "airframe", "look at what arms and booms carry; keep it in the model with --out-model"
)
BALANCE = hands_on("load", "move battery or load back to the middle, or look for what was mounted")
WEIGH = disarmed("airframe", "weigh it ready to fly, without liquid")
CHECK_LOAD = disarmed("load", THEN_CHECK)
SET_GAUGE = disarmed("tank gauge", "weigh what is filled in and set the gauge by it")
ZERO_GAUGE = disarmed("tank gauge", "set it to zero with an empty tank")
CHECK_TANK_GAUGE = disarmed("tank gauge", "check the tank gauge against what was filled in")
CHECK_GAUGE = disarmed("tank gauge", "check it against what was filled in")
ZERO_AIRSPEED = disarmed("airspeed sensor", "set its zero before take-off")
CHECK_VOLTMETER = disarmed(
    "voltmeter", "measure the battery with another meter, and set the scale of its voltmeter by it"
)
CHECK_BAROMETER = disarmed(
    "barometer", "compare its pressure with a weather station, and keep sun and wind off it"
)
CHECK_AIRSPEED = disarmed("airspeed sensor", "check its tube and its calibration")
CHECK_WIND = disarmed("airspeed sensor", "check the airspeed sensor")
TEST_BATTERY = hands_on("battery", "take the battery out and test it, or retire it")
CONNECT_GAUGE = hands_on(
    "tank gauge",
    "connect a tank gauge; or take the logs in with learn --store --again --load KG",
)
KEEP = at_desk("model", "nothing to repair; keep it in the model with --out-model")
REPAIRED = at_desk("model", "nothing to do")
KEEP_AS_SEEN = at_desk("model", "keep it in the model with --out-model")
LEAVE_OUT = at_desk("model", "flights not used are predicted worse with it, so keep no model of it")
AIRSPEED_RATE = at_desk("settings", "check its filter and message rate")
ESC_RATE = at_desk("settings", "raise the rate of ESC telemetry")
ESC_SPEEDS = at_desk("settings", "no measured speed does, so check whether the ESCs estimate it")
ESC_TELEMETRY = at_desk("settings", "switch on ESC telemetry, or have the motor outputs logged")
ONE_KIND = at_desk("logs", "run thrustmargin identify on flights of one day and one load")
COMPARE_SOUND = at_desk("logs", "compare with a flight of this aircraft when it was sound")
COMPARE_WIND = at_desk("logs", "compare with a flight in such wind")
IDENTIFY = at_desk("logs", "run thrustmargin identify on the flights since then")
INSPECT_LOG = at_desk("logs", "run thrustmargin inspect on one of its logs")
GROUND_WRECK = next_flight(
    "vehicle", "do not fly it before it is known why, and all of it was looked at"
)
#: The same in the letters of a STATUSTEXT.
GROUND_BRIEFLY = "Do not fly before it is known why: look at all"
GROUND_ROTOR = next_flight(
    "rotor",
    "do not fly it before its propellers, motors and ESCs were looked at, battery off",
)
GROUND_IT = next_flight(
    "vehicle", "do not fly it before its battery and propellers were looked at; then fill less"
)
GROUND_BATTERY = next_flight(
    "battery",
    "do not fly it before its battery was tested or retired, for its resistance grew; then fill "
    "less",
)
FILL_LESS = next_flight("load", "fill less: thrustmargin fill says how much")
INSPECT_ALL = hands_on("propeller", "inspect every propeller: a weak one would not have shown")
CHECK_ESCS = at_desk("ESC", "check the telemetry of the ESCs: its speeds were left out")
CHECK_MODEL = at_desk("logs", "check load, gauge and ESC telemetry, then run thrustmargin identify")
SEE_END = next_flight("log", "see how the flight ended")
RECORD_WHOLE = next_flight("log", "record the whole flight next time")
NOTE_REPAIR = at_desk(
    "aircraft", "make sure that what was bad in the flight before is repaired, for nobody noted it"
)
PROVE_CONTROL = next_flight(
    "vehicle", "hover it low and without liquid first, and report that flight"
)
PROVE_BATTERY = next_flight(
    "battery", "report its next flight: no cell may fall below 3.0 V under load"
)
PROVE_FILL = next_flight("load", "report the next flight: it must stay below the limit")
PROVE_ORDER = next_flight("motor", "report the next flight: its motor order must be right")
PROVE_LOAD = next_flight("load", "report the next flight: gauge, pump and thrust must agree")
PROVE_VOLTAGE = next_flight(
    "voltmeter", "report the next flight: the voltage must fall as the current rises"
)
PROVE_SPEEDS = next_flight(
    "settings", "report the next flight with ESC telemetry: rotors are looked at by their speed"
)
PROVE_LEARNT = next_flight(
    "logs", "learn its sound rotors: thrustmargin learn LOGS, three sound flights or more"
)
PROVE_AIR = next_flight("barometer", "report the next flight: nothing of its air is left out")
PROVE_MODEL = next_flight("logs", "report the next flight: speeds and model must agree")
CHECK_LINK = hands_on("link", "look at radio, cable and power of the telemetry")
PROVE_LINK = next_flight("link", "watch the next flight: its telemetry must not stop")
PROVE_LOG = next_flight("log", "report the whole log of a flight")
PROVE_REPAIR = next_flight(
    "rotor",
    "fly one tank gently and report that flight: the loss must be gone",
)
FLY_GENTLY = next_flight("vehicle", "fly turns and climbs more gently")
SAME_PLACE = hands_on(
    "load", "put load and battery in the same place each flight, or leave out odd flights"
)
LEVEL_OR_LEAVE_OUT = hands_on(
    "motor", "level the motors, and leave out flights with other propellers"
)
STATE_LOAD = disarmed(
    "load", "weigh the load (--load), state the --air-temperature, check the tank gauge"
)


class Phase(StrEnum):
    """The time at which a finding is read."""

    IN_FLIGHT = "in flight"
    LANDED = "landed"  # the aircraft on the link is on the ground
    RECORDED = "recorded"  # a log, a replay, a season: some time after the flight


class Urgency(StrEnum):
    """Urgency of a finding; each has one colour on every page."""

    STOP = "stop"  # red: nobody flies before
    BEFORE_NEXT = "before the next day of work"  # amber
    NOTHING = "nothing"  # green


class Trouble(StrEnum):
    """The kinds of findings that request an action, from any command, alarm or page."""

    ROTOR = "bad rotor or motor"
    CONTROL = "lost control"
    BATTERY = "collapsed battery"
    RESISTANCE = "battery resistance"
    NO_THRUST = "no thrust left"
    TOO_HEAVY = "too heavy to lose a rotor"
    OVER_LIMIT = "above the limit, or near it"
    ORDER = "motor order"
    LOAD = "load not reported"
    LOAD_UNKNOWN = "load not known"
    GAUGE = "tank gauge"
    VOLTAGE = "battery voltage"
    SPEEDS = "rotor speeds"
    BAROMETER = "barometer"
    MODEL = "model"
    ROTORS_UNSEEN = "weak rotors not looked for"
    ROTORS_UNLEARNT = "sound rotors not learnt"
    LOG = "part of the flight not in the log"
    REPAIR = "repair that nobody noted"
    WIND = "wind"
    GAUGE_SCALE = "scale of the tank gauge"
    MASS = "mass not reported in all flights"
    TELEMETRY = "lost telemetry"


@dataclass(frozen=True, slots=True)
class TroubleAnswer:
    """Response to a finding in one phase: the action, its urgency, and the proof of the repair."""

    urgency: Urgency
    action: Action
    proof: Action


@dataclass(frozen=True, slots=True)
class _Row:
    """A line of the table: the response to a finding once the flight is over, and in flight.

    In flight a person can end the flight or fly on; inspections come later.
    """

    after: Urgency
    action: Action
    proof: Action
    in_flight: Urgency = Urgency.NOTHING
    pilot: Action = LAND  # in flight, where the urgency is STOP


_STOP, _SOON = Urgency.STOP, Urgency.BEFORE_NEXT
#: Finding -> urgency, action and proof after the flight, and its urgency in flight. A bad rotor's
#: urgency depends on its loss: `bad_rotor`.
_TABLE: Mapping[Trouble, _Row] = {
    Trouble.ROTOR: _Row(_STOP, GROUND_ROTOR, PROVE_REPAIR, _STOP),
    Trouble.CONTROL: _Row(_STOP, GROUND_WRECK, PROVE_CONTROL, _STOP),
    Trouble.BATTERY: _Row(_STOP, TEST_BATTERY, PROVE_BATTERY, _STOP),
    Trouble.RESISTANCE: _Row(_SOON, TEST_BATTERY, PROVE_BATTERY),
    Trouble.NO_THRUST: _Row(_STOP, GROUND_IT, PROVE_FILL, _STOP),
    Trouble.TOO_HEAVY: _Row(_STOP, FILL_LESS, PROVE_FILL, _SOON),
    Trouble.OVER_LIMIT: _Row(_SOON, FILL_LESS, PROVE_FILL, _SOON),
    Trouble.ORDER: _Row(_SOON, WHICH_MOTOR, PROVE_ORDER, _SOON),
    Trouble.LOAD: _Row(_SOON, CHECK_LOAD, PROVE_LOAD, _SOON),
    Trouble.LOAD_UNKNOWN: _Row(_SOON, CONNECT_GAUGE, PROVE_LOAD),
    Trouble.GAUGE: _Row(_SOON, CHECK_TANK_GAUGE, PROVE_LOAD, _SOON),
    Trouble.VOLTAGE: _Row(_SOON, CHECK_VOLTMETER, PROVE_VOLTAGE, _SOON),
    Trouble.SPEEDS: _Row(_SOON, CHECK_ESCS, PROVE_SPEEDS, _SOON),
    Trouble.BAROMETER: _Row(_SOON, CHECK_BAROMETER, PROVE_AIR),
    Trouble.MODEL: _Row(_SOON, CHECK_MODEL, PROVE_MODEL, _SOON),
    Trouble.ROTORS_UNSEEN: _Row(_SOON, INSPECT_ALL, PROVE_SPEEDS),
    Trouble.ROTORS_UNLEARNT: _Row(_SOON, INSPECT_ALL, PROVE_LEARNT),
    Trouble.LOG: _Row(_SOON, SEE_END, PROVE_LOG),
    Trouble.REPAIR: _Row(_SOON, NOTE_REPAIR, PROVE_REPAIR),
    Trouble.WIND: _Row(_SOON, CHECK_WIND, PROVE_AIR),
    Trouble.GAUGE_SCALE: _Row(_SOON, SET_GAUGE, PROVE_LOAD),
    Trouble.MASS: _Row(_SOON, WEIGH, PROVE_LOAD),
    Trouble.TELEMETRY: _Row(Urgency.NOTHING, CHECK_LINK, PROVE_LINK, _STOP, FLY_BY_SIGHT),
}
#: Level of a flight -> the finding behind it.
OF_LEVEL: Mapping[FlightLevel, Trouble] = {
    FlightLevel.DAMAGED: Trouble.ROTOR,
    FlightLevel.LOST: Trouble.CONTROL,
    FlightLevel.BATTERY: Trouble.BATTERY,
    FlightLevel.NO_THRUST: Trouble.NO_THRUST,
    FlightLevel.CRITICAL: Trouble.TOO_HEAVY,
    FlightLevel.OVER: Trouble.OVER_LIMIT,
    FlightLevel.ORDER: Trouble.ORDER,
    FlightLevel.NEAR: Trouble.OVER_LIMIT,
}
#: What a flight leaves open -> the finding behind it.
OF_CAVEAT: Mapping[Caveat, Trouble] = {
    Caveat.GAUGE: Trouble.GAUGE,
    Caveat.LOAD: Trouble.LOAD,
    Caveat.VOLTAGE: Trouble.VOLTAGE,
    Caveat.ROTOR_SPEEDS: Trouble.SPEEDS,
    Caveat.BAROMETER: Trouble.BAROMETER,
    Caveat.MODEL: Trouble.MODEL,
    Caveat.ROTORS_NOT_SOUGHT: Trouble.ROTORS_UNSEEN,
    Caveat.ROTORS_BY_OUTPUTS: Trouble.ROTORS_UNSEEN,
    Caveat.ROTORS_UNLEARNT: Trouble.ROTORS_UNLEARNT,
    Caveat.UNSEEN: Trouble.LOG,
    Caveat.BAD_BEFORE: Trouble.REPAIR,
}


def answer_to(trouble: Trouble, phase: Phase = Phase.RECORDED) -> TroubleAnswer:
    """Return urgency, action and proof of a repair for a finding, in a phase of the flight.

    A finding has two urgencies: one in flight, and one for any other phase. In flight the urgency
    is the first: STOP asks to land or to fly by sight, and its action is the pilot's. In all other
    cases the action is that for after the flight.
    """
    row = _TABLE[trouble]
    if phase is not Phase.IN_FLIGHT:
        return TroubleAnswer(row.after, row.action, row.proof)
    action = row.pilot if row.in_flight is Urgency.STOP else row.action
    return TroubleAnswer(row.in_flight, action, row.proof)


def shown_level(level: FlightLevel, *, left_open: object) -> FlightLevel:
    """Return the level whose colour an answer has: NEAR in place of UNDER if `left_open` is true.

    An open caveat is a condition, and so no clearance.
    """
    return FlightLevel.NEAR if level is FlightLevel.UNDER and left_open else level


def urgency_of(level: FlightLevel, *, left_open: bool = False) -> Urgency | None:
    """Return how urgent the action after a flight of this level is; None for an unknown level.

    `left_open`, an open caveat, raises "nothing" to "before the next flight".
    """
    if level is FlightLevel.UNKNOWN:
        return None
    found = answer_to(OF_LEVEL[level]).urgency if level in OF_LEVEL else Urgency.NOTHING
    return Urgency.BEFORE_NEXT if found is Urgency.NOTHING and left_open else found


def bad_rotor(rotors: Sequence[int], loss_low: float, phase: Phase) -> TroubleAnswer:
    """Return action, urgency and proof of a repair for rotors, from 1, that lose thrust or speed.

    `loss_low` is the low end of the loss's interval, a share of thrust. From LEAST on, the least
    loss that an alarm reports, the aircraft must not fly; below, an inspection before the next
    flight is asked for. In flight the action is to land, whatever the loss.
    """
    answer = answer_to(Trouble.ROTOR, phase)
    if phase is Phase.IN_FLIGHT:
        return answer
    if loss_low >= LEAST:
        return replace(answer, action=not_before_looked_at(rotors))
    return replace(answer, urgency=Urgency.BEFORE_NEXT, action=INSPECT)


def change_propeller(rotor: int) -> Action:
    """Return the action to change the propeller of `rotor`, from 1, which is worn by a season's
    flights.
    """
    return hands_on(
        "propeller",
        say(
            "change propeller {rotor} for a new one of the same kind; if the loss stays, look at "
            "motor and ESC {rotor}",
            rotor=rotor,
        ),
    )


def inspect_rotors(rotors: Sequence[int]) -> Action:
    """Return the action for `rotors` (1-based) that may be bad, before a flight that would show
    it."""
    return hands_on(
        "rotor", say("inspect propeller and motor of {rotors}", rotors=rotors_words(rotors))
    )


def not_before_looked_at(rotors: Sequence[int]) -> Action:
    """Return the action that forbids to fly until the `rotors`, from 1, are inspected."""
    return next_flight(
        "rotor",
        say(
            "do not fly it before propeller, motor and ESC of {rotors} were looked at, battery off",
            rotors=rotors_words(rotors),
        ),
    )


def check_esc(rotor: int) -> Action:
    """Return the action for the ESC of `rotor` (1-based) that reports a wrong speed."""
    return at_desk(
        "ESC", say("check pole count and telemetry of the ESC of rotor {rotor}", rotor=rotor)
    )


def rotors_words(rotors: Sequence[int]) -> str:
    """Return rotor numbers as `rotor 3` or `rotors 1 and 3`."""
    *others, last = map(str, rotors)
    numbers = f"{', '.join(others)} {say('and')} {last}" if others else last
    return say("rotors {numbers}" if len(rotors) > 1 else "rotor {numbers}", numbers=numbers)
