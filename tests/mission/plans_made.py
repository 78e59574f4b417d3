"""Plans made for tests: items in short, and a field of two lines."""

from typing import Any

from thrustmargin.mission.plan_items import MissionPlan, PlanItem

HOME = (48.0, 11.0, 500.0)
FIRST, SECOND = 48.0005, 48.0015  # latitudes of the ends of the lines
NOWHERE = (0.0, 0.0, 0.0)


def item(
    number: int, command: int = 16, *given: float, at: Any = NOWHERE, frame: int = 3
) -> PlanItem:
    """Item `number`; `given` are its first parameters."""
    values = [*given, *[0.0] * (4 - len(given)), *at]
    return PlanItem(number=number, command=command, frame=frame, parameters=tuple(values))  # type: ignore[arg-type]


def plan_of(*rows: tuple[Any, ...], **fields: Any) -> MissionPlan:
    """Rows (command, its first parameters ..., place or nothing), numbered from 1."""
    items = []
    for number, (command, *rest) in enumerate(rows, start=1):
        place = rest.pop() if rest and isinstance(rest[-1], tuple) else NOWHERE
        items.append(item(number, command, *rest, at=place))
    return MissionPlan(items=tuple(items), **({"home": HOME, "firmware": 3} | fields))


def spot(latitude: float, longitude: float, height: float = 3.0) -> tuple[float, float, float]:
    return (latitude, longitude, height)


#: Take-off, speed, two lines of 111 m which are 7.4 m apart, return.
TWO_LINES = (
    (22, spot(*HOME[:2])),
    (178, 1.0, 4.0, -1.0),
    (16, spot(FIRST, 11.0)),
    (216, 1.0),
    (16, spot(SECOND, 11.0)),
    (216, 0.0),
    (16, spot(SECOND, 11.0001)),
    (216, 1.0),
    (16, spot(FIRST, 11.0001)),
    (216, 0.0),
    (20,),
)
