"""Write what is wrong with an arm: the part, how much, how sure, what else, and what settles it."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from thrustmargin.gcs_plugin.wording.actions import Action, at_desk, hands_on
from thrustmargin.gcs_plugin.wording.language import percent, percent_within, say
from thrustmargin.models.checks.arms.arm_causes import Cause
from thrustmargin.models.checks.arms.arm_posterior import (
    ArmAnswer,
    ArmFinding,
    PossibleCause,
    Shaken,
)
from thrustmargin.models.checks.arms.arm_trend import PowerTrend

#: The part, as one of several that it may be.
PARTS: Mapping[Cause, str] = {
    Cause.PROPELLER: "its propeller",
    Cause.MOTOR: "its motor",
    Cause.ESC: "its ESC",
    Cause.DESYNC: "a desync of its ESC",
    Cause.SHORT: "a short in its motor or ESC",
    Cause.LEAD: "its lead or a lug",
    Cause.IMBALANCE: "its balance or mount",
    Cause.TELEMETRY: "the telemetry of its ESC",
    Cause.SPEED_READING: "the reading of its speed",
    Cause.CURRENT_READING: "the reading of its current",
    Cause.CURRENT_OFFSET_READING: "the zero of its current",
    Cause.VOLTAGE_READING: "the reading of its voltage",
    Cause.ESC_TEMPERATURE_READING: "the reading of its ESC's temperature",
    Cause.MOTOR_TEMPERATURE_READING: "the reading of its motor's temperature",
}
#: What the part does, by an amount; of a cause whose size may have both signs the second is of a
#: negative one.
AMOUNTS: Mapping[Cause, tuple[str, str]] = {
    Cause.PROPELLER: (
        "its propeller gives {amount} less thrust at its speed",
        "its propeller gives {amount} more thrust at its speed",
    ),
    Cause.MOTOR: ("its motor takes {amount} more power at its speed", ""),
    Cause.ESC: ("its ESC takes {amount} more power at its speed", ""),
    Cause.DESYNC: (
        "its motor falls out of step with its ESC in {amount} of all stretches of 5 s",
        "",
    ),
    Cause.SHORT: ("it draws {amount} of its current in flight while its rotor stands", ""),
    Cause.LEAD: ("its lead or a lug takes {amount} more of the voltage under load", ""),
    Cause.IMBALANCE: ("it shakes the frame by {amount} of g more, once per revolution", ""),
    Cause.TELEMETRY: ("its ESC loses {amount} of its telemetry", ""),
    Cause.SPEED_READING: (
        "its speed reads {amount} too high",
        "its speed reads {amount} too low",
    ),
    Cause.CURRENT_READING: (
        "its current reads {amount} too high",
        "its current reads {amount} too low",
    ),
    Cause.CURRENT_OFFSET_READING: (
        "its current reads {amount} of that in flight too high at rest",
        "its current reads {amount} of that in flight too low at rest",
    ),
    # The offset is of the battery's voltage over the ESC's: above zero, the ESC reads low.
    Cause.VOLTAGE_READING: (
        "its ESC reads {amount} too little voltage",
        "its ESC reads {amount} too much voltage",
    ),
    Cause.ESC_TEMPERATURE_READING: (
        "its ESC's temperature reads {amount} too high a rise",
        "its ESC's temperature reads {amount} too small a rise",
    ),
    Cause.MOTOR_TEMPERATURE_READING: (
        "its motor's temperature reads {amount} too high a rise",
        "its motor's temperature reads {amount} too small a rise",
    ),
}
#: The one look that settles it.
LOOKS: Mapping[Cause, Action] = {
    Cause.PROPELLER: hands_on(
        "propeller", "compare the edges and the length of its blades with the others'"
    ),
    Cause.MOTOR: hands_on("motor", "turn its motor by hand: it must run as freely as the others"),
    Cause.ESC: hands_on("ESC", "right after landing, compare the heat of its ESC with the others'"),
    Cause.DESYNC: hands_on("ESC", "look at the three motor wires and the signal plug of its ESC"),
    Cause.SHORT: hands_on(
        "motor", "compare the resistance between its three motor wires with the others'"
    ),
    Cause.LEAD: hands_on("lead", "right after landing, feel its lugs and connectors for heat"),
    Cause.IMBALANCE: hands_on("propeller", "balance its propeller and tighten the motor's screws"),
    Cause.TELEMETRY: hands_on("ESC", "look at the signal and telemetry plug of its ESC"),
    Cause.SPEED_READING: at_desk("ESC", "check the pole count and telemetry of its ESC"),
    Cause.CURRENT_READING: hands_on(
        "ESC", "put another ESC on that arm for one flight: a wrong reading goes with the ESC"
    ),
    Cause.CURRENT_OFFSET_READING: at_desk(
        "ESC", "see whether its current is the same while disarmed; nothing flies worse by it"
    ),
    Cause.VOLTAGE_READING: at_desk(
        "ESC", "compare its voltage at rest with that of the battery; nothing flies worse by it"
    ),
    Cause.ESC_TEMPERATURE_READING: hands_on(
        "ESC", "right after landing, compare the heat of its ESC with the others'"
    ),
    Cause.MOTOR_TEMPERATURE_READING: hands_on(
        "motor", "right after landing, compare the heat of its motor with the others'"
    ),
}


LOOK_SHAKEN = hands_on(
    "propeller", "balance the propellers and feel whether the autopilot's mount is tight"
)


def shaken_sentence(shaken: Shaken) -> str:
    """Return by how much more than usual the whole aircraft is shaken, and the look at it."""
    ends = shaken.lower - 1.0, shaken.upper - 1.0
    what = say(
        "it shakes {amount} more than on earlier flights at its rotor speed",
        amount=percent_within(shaken.ratio - 1.0, max(ends[0], 0.0), ends[1]),
    )
    return say("the aircraft: {what}", what=what) + say("; {look}", look=LOOK_SHAKEN.text)


def arm_sentence(finding: ArmFinding) -> str:
    """Return what is wrong with an arm: interval, probability, other causes, and the look that
    settles it."""
    first, *others = finding.causes
    words = say("arm {arm}: {what}", arm=finding.arm + 1, what=amount_words(first))
    sure = percent(min(finding.probability * first.probability, 0.99))
    words += say(", {sure} sure", sure=sure)
    if others:
        listed = say(" or ").join(
            say("{part} ({sure})", part=say(PARTS[one.cause]), sure=percent(one.probability))
            for one in others
        )
        words += say("; else {parts}", parts=listed)
    return words + say("; {look}", look=LOOKS[first.cause].text)


def amount_words(one: PossibleCause) -> str:
    """Return what a possible cause changes, in words, with amount, %, and 95 % interval.

    The sign is in the words (more or less); the amount has none. An interval that includes zero
    begins at 0.
    """
    more, less = AMOUNTS[one.cause]
    least, most = sorted((abs(one.lower), abs(one.upper)))
    ends = (0.0 if one.lower < 0.0 < one.upper else least, most)
    size = abs(one.size)
    amount = percent_within(size, *ends)
    return say(more if one.size >= 0.0 or not less else less, amount=amount)


def trend_sentence(trend: PowerTrend) -> str:
    """Return the sentence on an arm that needs more power than some flights ago: how much, and what
    to do.
    """
    return say(
        "arm {arm} needs {amount} more power at its speed than {flights} flights ago; {look}",
        arm=trend.arm + 1,
        amount=percent_within(trend.change, trend.lower, trend.upper),
        flights=trend.flights - 1,
        look=LOOKS[Cause.MOTOR].text,
    )


def arm_sentences(answer: ArmAnswer | None, weak: Collection[int] = ()) -> tuple[str, ...]:
    """Return one sentence for each arm with something wrong, and one if the aircraft is shaken.

    An arm in `weak`, from 0, whose thrust another sentence reports, has no sentence on its
    propeller. A wrong voltage reading has none here either, as it is checked in every log. Empty
    for None.
    """
    if answer is None:
        return ()
    shaken = () if answer.shaken is None else (shaken_sentence(answer.shaken),)
    of_arms = (
        arm_sentence(one)
        for one in answer.findings
        if one.cause is not Cause.VOLTAGE_READING
        and not (one.arm in weak and one.cause is Cause.PROPELLER)
    )
    return (*of_arms, *shaken)
