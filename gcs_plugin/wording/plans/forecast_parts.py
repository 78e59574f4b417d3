"""What words read of a plan's forecast: its shape, for words know nothing of missions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from thrustmargin.models.flight import FlightTrack, Floats
from thrustmargin.models.model.advice import Advised, FlightLevel


class WeakestPlace(Protocol):
    """The place with the largest utilisation; shares of what it comes from."""

    @property
    def item(self) -> int: ...
    @property
    def kind(self) -> str: ...
    @property
    def utilisation(self) -> float: ...
    @property
    def interval(self) -> tuple[float, float]: ...
    @property
    def tank_kg(self) -> float: ...
    @property
    def manoeuvre(self) -> float: ...
    @property
    def load(self) -> float: ...
    @property
    def wind(self) -> float: ...
    @property
    def battery(self) -> float: ...


class FlownPlan(Protocol):
    """The planned flight."""

    @property
    def track(self) -> FlightTrack: ...
    @property
    def energy_wh(self) -> Floats: ...


class OneFilling(Protocol):
    """A sortie."""

    @property
    def kg(self) -> float: ...
    @property
    def energy_wh(self) -> float: ...
    @property
    def last_item(self) -> int: ...


class Fillings(Protocol):
    """The sorties of a plan."""

    @property
    def sorties(self) -> Sequence[OneFilling]: ...
    @property
    def short_of(self) -> str: ...


class Faulty(Protocol):
    """What is wrong with a plan."""

    @property
    def fault(self) -> str: ...
    @property
    def items(self) -> Sequence[int]: ...


class Unreckoned(Protocol):
    """An item that is not understood."""

    @property
    def item(self) -> int: ...
    @property
    def command(self) -> int: ...
    @property
    def why(self) -> str: ...
    @property
    def touches(self) -> Sequence[str]: ...


class ForecastParts(Protocol):
    """A plan before take-off."""

    @property
    def level(self) -> FlightLevel: ...
    @property
    def too_heavy(self) -> bool: ...
    @property
    def advised(self) -> Advised: ...
    @property
    def flight(self) -> FlownPlan: ...
    @property
    def flight_s(self) -> float: ...
    @property
    def needs(self) -> Fillings: ...
    @property
    def largest_fill_kg(self) -> float: ...
    @property
    def survivable_below_kg(self) -> float: ...
    @property
    def findings(self) -> Sequence[Faulty]: ...
    @property
    def not_understood(self) -> Sequence[Unreckoned]: ...
    @property
    def assumed(self) -> Mapping[str, tuple[str, ...]]: ...
