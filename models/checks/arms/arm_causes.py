"""List what can be wrong with an arm, and what each cause does to the arm's figures.

A cause has a size s, a share: of thrust lost, of power needed, of voltage lost at the load of the
flight, of g shaken, of a reading. It moves each figure of its own arm by a ratio of s, with a
standard deviation where parts differ; a figure that is not listed does not move. No cause moves a
figure of another arm.

Sources. A propeller: thrust and power coefficients go with the fourth and fifth power of the
diameter (Leishman, Principles of Helicopter Aerodynamics, 2.3), so a cut one loses 5/4 as much
power; a rough leading edge costs power instead: the ratio of power is open. A motor or ESC: losses
of 5 to 20 % and 2 to 5 % of the power at cruise (efficiencies in makers' tables of large motors),
so a loss more of 1 % of the power is 5 to 20, and 20 to 50, per cent more heat; some of what an
ESC's timing costs heats the motor. A lead: speed at a duty cycle goes with the voltage, so its
square with twice the share; windings lose 2 to 10 % of it, in proportion to the current. An ESC's
loss goes with the current to the power 1 to 2 (switching and conduction), a motor's with 1 to 2
(iron and copper), so what is computed per A² falls where the current rises. A reading that is a
factor off moves what is computed from it by the exponent that it has there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType

from thrustmargin.models.checks.arms.arm_figures import ArmQuantity

Q = ArmQuantity


class Cause(StrEnum):
    """A fault that an arm (propeller, motor, ESC, lead and their sensors) can have."""

    PROPELLER = "propeller"  # worn, cut, or of another size
    MOTOR = "motor"  # bearing, magnets, rubbing
    ESC = "esc"  # timing, desync
    DESYNC = "desync"  # the motor falls out of step with its ESC
    SHORT = "short"  # of winding or ESC, or a rotor that cannot turn: current without speed
    LEAD = "lead"  # lead, lug or connector
    IMBALANCE = "imbalance"  # unbalanced propeller or loose mount
    TELEMETRY = "telemetry"  # signal or telemetry plug of the ESC
    SPEED_READING = "speed_reading"
    CURRENT_READING = "current_reading"
    CURRENT_OFFSET_READING = "current_offset_reading"  # the same A at any current
    VOLTAGE_READING = "voltage_reading"
    ESC_TEMPERATURE_READING = "esc_temperature_reading"
    MOTOR_TEMPERATURE_READING = "motor_temperature_reading"

    @property
    def of_sensor(self) -> bool:
        """Return True if the cause is a wrong reading, not a part that flies."""
        return self.value.endswith("_reading") or self is Cause.TELEMETRY


@dataclass(frozen=True, slots=True)
class Moved:
    """Effect of a cause of size 1 on one figure: its mean and standard deviation over parts.

    `sure` is the probability that the cause changes the figure at all. Where it only may, an
    unchanged figure must not count against the cause.
    """

    ratio: float
    spread: float = 0.0
    sure: float = 1.0


@dataclass(frozen=True, slots=True)
class Pattern:
    """The changes of an arm's measured quantities that one cause of a fault produces."""

    moved: Mapping[ArmQuantity, Moved]
    both_ways: bool = False  # its size may be negative: a larger propeller, a reading that is low

    def of(self, quantity: ArmQuantity, *, own_voltage: bool) -> Moved:
        """Return how the cause changes a quantity of its arm; UNMOVED where it does not.

        `own_voltage`: power is computed with the voltage that the ESC reports, not the battery's.
        With the battery's, power includes the loss in a lead, and a wrong reading of the ESC's
        voltage does not change it.
        """
        if quantity is Q.POWER and not own_voltage:
            if Q.RESISTANCE in self.moved:
                return Moved(1.0, 0.1)
            if Q.OFFSET in self.moved:
                return UNMOVED
        return self.moved.get(quantity, UNMOVED)


UNMOVED = Moved(0.0)
#: Probability of an effect of which makers and mechanics say that it may come.
MAY = 0.5
#: A figure that the cause surely moves, by as much; laws are exact to about a tenth.
_AS_MUCH = Moved(1.0, 0.1)

PATTERNS: Mapping[Cause, Pattern] = MappingProxyType(
    {
        Cause.PROPELLER: Pattern(
            {
                Q.THRUST: _AS_MUCH,
                Q.POWER: Moved(-0.5, 1.0),
                Q.OUTPUT: Moved(0.0, 0.3, MAY),
                Q.VIBRATION: Moved(0.2, 0.4, MAY),
                Q.SHAKING: Moved(0.5, 1.0, MAY),
            },
            both_ways=True,
        ),
        Cause.MOTOR: Pattern(
            {
                Q.POWER: _AS_MUCH,
                Q.OUTPUT: Moved(-0.3, 0.4, MAY),
                Q.ESC_HEAT: Moved(-0.5, 0.5, MAY),
                Q.MOTOR_HEAT: Moved(10.0, 6.0),
                Q.VIBRATION: Moved(0.2, 0.4, MAY),
                Q.SHAKING: Moved(0.5, 1.0, MAY),
            }
        ),
        Cause.ESC: Pattern(
            {
                Q.POWER: _AS_MUCH,
                Q.OUTPUT: Moved(-0.2, 0.5, MAY),
                Q.ESC_HEAT: Moved(20.0, 15.0),
                Q.JUMPS: Moved(0.3, 0.2, MAY),
                Q.DESYNC: Moved(0.5, 0.5, MAY),
                Q.GLITCHES: Moved(0.5, 0.5, MAY),
            }
        ),
        # Its size is a share of time, and its cost in power depends on how long each fall is.
        Cause.DESYNC: Pattern(
            {
                Q.DESYNC: Moved(1.0, 0.3),
                Q.GLITCHES: Moved(0.3, 0.5, MAY),
                Q.LOST: Moved(0.3, 0.5, MAY),
                Q.POWER: Moved(0.1, 0.2, MAY),
                Q.OUTPUT: Moved(0.0, 0.2, MAY),
                Q.THRUST: Moved(0.0, 0.2, MAY),
                Q.ESC_HEAT: Moved(1.0, 2.0, MAY),
                Q.MOTOR_HEAT: Moved(1.0, 2.0, MAY),
                Q.JUMPS: Moved(0.1, 0.1, MAY),
                Q.SHAKING: Moved(1.0, 2.0, MAY),
            }
        ),
        Cause.SHORT: Pattern(
            {
                Q.STANDING: _AS_MUCH,
                Q.POWER: Moved(0.5, 0.5),
                Q.ESC_HEAT: Moved(0.5, 1.0, MAY),
                Q.MOTOR_HEAT: Moved(1.0, 2.0, MAY),
            }
        ),
        Cause.LEAD: Pattern(
            {
                Q.RESISTANCE: _AS_MUCH,
                Q.OUTPUT: Moved(-2.0, 0.5),
            }
        ),
        # An amplitude of one arm adds to what the body has by as much as that is small.
        Cause.IMBALANCE: Pattern(
            {
                Q.VIBRATION: _AS_MUCH,
                Q.SHAKING: Moved(2.0, 3.0, MAY),
                Q.CLIPPING: Moved(0.5, 1.0, MAY),
            }
        ),
        Cause.TELEMETRY: Pattern({Q.LOST: Moved(1.0, 0.1, MAY), Q.GLITCHES: Moved(1.0, 0.5, MAY)}),
        Cause.SPEED_READING: Pattern(
            {
                Q.THRUST: Moved(2.0, 0.1),
                Q.POWER: Moved(-3.0, 0.1),
                Q.OUTPUT: Moved(2.0, 0.1),
                Q.VIBRATION: Moved(0.0, 0.3, MAY),
            },
            both_ways=True,
        ),
        Cause.CURRENT_READING: Pattern(
            {
                Q.POWER: Moved(1.0),
                Q.ESC_HEAT: Moved(-1.5, 0.5),
                Q.MOTOR_HEAT: Moved(-1.5, 0.5),
            },
            both_ways=True,
        ),
        # Above zero the power reads more, and the rise of heat per A² less.
        Cause.CURRENT_OFFSET_READING: Pattern(
            {
                Q.STANDING: _AS_MUCH,
                Q.POWER: _AS_MUCH,
                Q.ESC_HEAT: Moved(-1.5, 0.5),
                Q.MOTOR_HEAT: Moved(-1.5, 0.5),
            },
            both_ways=True,
        ),
        # Earlier flights may have had the same offset: then their power has it as well.
        Cause.VOLTAGE_READING: Pattern(
            {Q.OFFSET: Moved(1.0), Q.POWER: Moved(-0.5, 0.5)}, both_ways=True
        ),
        Cause.ESC_TEMPERATURE_READING: Pattern({Q.ESC_HEAT: Moved(1.0)}, both_ways=True),
        Cause.MOTOR_TEMPERATURE_READING: Pattern({Q.MOTOR_HEAT: Moved(1.0)}, both_ways=True),
    }
)
#: Causes that move the rotor's speed at its thrust for sure.
THRUST_CAUSES = (Cause.PROPELLER, Cause.SPEED_READING)
