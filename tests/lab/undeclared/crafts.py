"""Aircraft from 1 to 60 kg, in five layouts, and the airframe file that an owner would write.

Motor order, angle from the nose and spin are ArduPilot's (AP_MotorsMatrix.cpp), written a second
time. Thrust coefficient and torque ratio of the file are those of the plant's rotor in hover.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from tests.lab.undeclared.rotor_aero import Array, Blade, forces_of, hover

GRAVITY, SEA_LEVEL_DENSITY = 9.80665, 1.225
RPM = 30.0 / np.pi  # rpm for each rad/s
PROPELLER = Blade()
WASH = 1.0  # share of an upper rotor's induced speed that reaches the lower one's disc

#: Degrees from the nose and spin (+ counter-clockwise from above) in motor order.
LAYOUTS: Mapping[str, str] = MappingProxyType(
    {
        "quad-x": "45+ -135+ -45- 135-",
        "quad-plus": "90+ -90+ 0- 180-",
        "hexa-x": "90- -90+ -30- 150+ 30+ -150-",
        "octo-x": "22.5- -157.5- 67.5+ 157.5+ -22.5+ -112.5+ -67.5- 112.5-",
        "octo-coaxial-x8": "45+ -45- -135+ 135- -45+ 45- 135+ -135-",
    }
)


@dataclass(frozen=True, kw_only=True)
class Craft:
    """A sound aircraft."""

    name: str
    layout: str
    empty_mass: float  # kg
    tank_litres: float
    arm: float  # m
    radius: float  # m of a propeller
    body_area: float = 0.0  # m² of drag, 0 for one that goes with the discs
    flown: Literal["missions", "by hand", "hard"] = "missions"
    good_flights: int = 12  # from which its model is trained
    telemetry: tuple[tuple[str, float], ...] = ()  # how its ESCs report, fields of a Condition
    blade: Blade = PROPELLER

    @cached_property
    def _motors(self) -> Array:
        pairs = [(float(m[:-1]), 1.0 if m[-1] == "+" else -1.0) for m in self._words]
        return np.array(pairs)

    @property
    def _words(self) -> list[str]:
        return LAYOUTS[self.layout].split()

    @property
    def rotors(self) -> int:
        return len(self._words)

    @cached_property
    def position(self) -> Array:
        """(R, 2) m forward and right of the designed centre of gravity."""
        angle = np.deg2rad(self._motors[:, 0])
        return self.arm * np.stack([np.cos(angle), np.sin(angle)], axis=1).round(9)

    @cached_property
    def spin(self) -> Array:
        """(R,) +1 counter-clockwise from above; its drag turns the airframe clockwise."""
        return self._motors[:, 1]

    @property
    def upper(self) -> list[int] | None:
        """For each lower rotor of a coaxial layout (motors 5 to 8) the one above it."""
        if "coaxial" not in self.layout:
            return None
        return [1, 0, 3, 2]

    @cached_property
    def mixer(self) -> Array:
        """(R, 4) share of collective, roll, pitch, yaw control in each motor's output."""
        x, y = (self.position / self.arm).T
        return np.stack([np.ones_like(x), -y, x, self.spin], axis=1)

    @property
    def full_mass(self) -> float:
        return self.empty_mass + self.tank_litres

    @property
    def typical_mass(self) -> float:
        return self.empty_mass + 0.6 * self.tank_litres

    @property
    def disc(self) -> float:
        """m² of one rotor."""
        return float(np.pi * self.radius**2)

    @cached_property
    def drag_area(self) -> float:
        return self.body_area or 0.05 * self.disc * self.rotors

    @cached_property
    def inertia(self) -> Array:
        """(3,) kg m² at its typical mass."""
        return np.array([0.07, 0.07, 0.135]) * self.typical_mass * self.arm**2

    @cached_property
    def hover_coefficients(self) -> tuple[Array, Array]:
        """(R,) CT and CQ of each rotor in hover, the lower ones in the wash of the upper."""
        thrust, torque = (np.full(self.rotors, c) for c in hover(self.blade))
        if self.upper is not None:
            forces, zero = forces_of(self.blade), np.zeros(1)
            wash = WASH * forces.at(forces.inflow, zero, zero)
            thrust[4:] = forces.at(forces.thrust, zero, wash)
            torque[4:] = forces.at(forces.torque, zero, wash)
        return thrust, torque

    @property
    def thrust_coefficient(self) -> float:
        """N/rpm² of a rotor in clean air at sea level."""
        return float(
            SEA_LEVEL_DENSITY
            * self.disc
            * (self.radius / RPM) ** 2
            * self.hover_coefficients[0].max()
        )

    @property
    def hover_rpm(self) -> float:
        """rpm in hover at the typical mass at sea level."""
        shares = self.hover_coefficients[0] / self.hover_coefficients[0].max()
        weight = self.typical_mass * GRAVITY
        return float(np.sqrt(weight / self.thrust_coefficient / shares.sum()))

    @property
    def max_rpm(self) -> float:
        """rpm at full output: half of the thrust carries the full aircraft."""
        return self.hover_rpm * float(np.sqrt(2.0 * self.full_mass / self.typical_mass))

    @property
    def cells(self) -> int:
        return 4 if self.empty_mass < 2 else 6 if self.empty_mass < 10 else 14

    def airframe_toml(self) -> str:
        """The airframe file in the format of docs/your-aircraft.md."""
        thrust, torque = self.hover_coefficients
        nominal = 3.7 * self.cells
        ceiling = self.thrust_coefficient * self.max_rpm**2
        numbers = {
            "empty_mass": (self.empty_mass, "kg"),
            "tank_volume_l": (self.tank_litres, "L"),
            "liquid_density": (1.0, "kg/L"),
            "pump_max_flow_l_min": (0.5 * self.tank_litres, "L/min"),
            "propeller_diameter": (2.0 * self.radius, "m"),
            "propeller_pitch": (2.0 * self.radius * self.blade.pitch_over_diameter, "m"),
            "propeller_blades": (2.0, "1"),
            "thrust_coefficient": (self.thrust_coefficient, "N/rpm^2"),
            "reference_density": (SEA_LEVEL_DENSITY, "kg/m^3"),
            "max_rotor_speed_rpm": (self.max_rpm, "rpm"),
            "nameplate_max_thrust": (ceiling, "N"),
            "ceiling_voltage": (4.2 * self.cells, "V"),
            "ceiling_voltage_exponent": (1.0, "1"),
            "nominal_voltage": (nominal, "V"),
            "torque_ratio": (self.radius * float(torque[0] / thrust[0]), "m"),
            "motor_poles": (28, "1"),
        }
        lines = [f'name = "{self.name}"', f'title = "{self.name}"', f'layout = "{self.layout}"']
        lines += ["", "[quantities]"]
        lines += [
            f'{key} = {{ value = {value!r}, unit = "{unit}", source = "bench" }}'
            for key, (value, unit) in numbers.items()
        ]
        for i, ((x, y), spin) in enumerate(zip(self.position, self.spin, strict=True)):
            lower = self.upper is not None and i >= 4
            z = 0.2 * self.radius * (0 if self.upper is None else 1 if lower else -1)
            lines += ["", "[[rotors]]", f'name = "{i + 1}"']
            lines += [f"position_frd = [{float(x)!r}, {float(y)!r}, {z!r}]"]
            lines += [f'spin = "{"ccw" if spin > 0 else "cw"}"']
            if lower:
                lines += [f"effectiveness = {float(thrust[i] / thrust[0])!r}"]
        return "\n".join(lines) + "\n"


def _craft(
    layout: str, empty: float, litres: float, arm: float, radius: float, **how: Any
) -> Craft:
    return Craft(
        name=f"{layout}-{round(empty)}kg",
        layout=layout,
        empty_mass=empty,
        tank_litres=litres,
        arm=arm,
        radius=radius,
        **how,
    )


CRAFTS: tuple[Craft, ...] = (
    _craft("quad-x", 21.1, 16.0, 0.96, 0.457),
    _craft("quad-x", 1.0, 0.4, 0.23, 0.127),
    _craft("quad-plus", 5.0, 3.0, 0.42, 0.216),
    _craft("hexa-x", 12.0, 10.0, 0.75, 0.305),
    _craft("octo-x", 30.0, 20.0, 1.15, 0.38),
    _craft("octo-coaxial-x8", 36.0, 24.0, 0.95, 0.457),
)
#: Those of the second plan: flown otherwise, with the telemetry of common ESCs.
OTHER_CRAFTS: tuple[Craft, ...] = (
    _craft("hexa-x", 24.0, 16.0, 0.9, 0.4, telemetry=(("period", 0.3),)),
    _craft(
        "octo-coaxial-x8", 8.0, 4.0, 0.5, 0.23, flown="by hand", telemetry=(("quantum", 0.004),)
    ),
    _craft("quad-plus", 15.0, 10.0, 0.7, 0.38, flown="hard", telemetry=(("repeats", 0.3),)),
)
#: That of the third plan.
HEXACOPTER = _craft("hexa-x", 20.0, 16.0, 1.0, 0.42, good_flights=8)
