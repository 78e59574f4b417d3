"""What an alarm's rule is, what it is asked about, and what it answers, in arrays of rows."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from thrustmargin.gcs_plugin.live.alarms.alarm import OF_PARTS, Alarm, AlarmSettings, Key, Missing
from thrustmargin.gcs_plugin.live.rows.tank_balance import TankBalance
from thrustmargin.models.flight import Bools, Floats
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.fault_test import Kind, RotorFault


@dataclass(frozen=True, slots=True, eq=False)
class AlarmChecks:
    """What a rule says at N rows of K alarms, one a rotor or one in all.

    `on` to raise, `off` to clear, neither to leave it; not `known`: it went by nothing.
    """

    on: Bools  # (N, K)
    off: Bools  # (N, K)
    known: Bools  # (N, K)
    severity: Callable[[int, int], int]  # MAV_SEVERITY, by row and alarm
    text: Callable[[int, int], str]
    rotor: int = 0  # the first so many are of rotors, from 1 on
    past: Callable[[int], str] | None = None  # text while no number of it is known or low
    over: Bools | None = None  # (N,) there is nothing of which it could be: no lull is waited for
    rotors: Callable[[int, int], tuple[int, ...]] | None = None  # from 1: those it may be of


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RowsNow:
    """The N rows `rows` of an analysis of T rows and R rotors and what else is known at them."""

    analysis: FlightAnalysis
    rows: slice
    margin_ahead: Floats | None = None  # (T,) least predicted on the rest of the route
    esc_failures: Floats | None = None  # (T, R) ESC_FAILURE_FLAGS, NaN: unknown
    rest_voltage: float = math.nan  # V before take-off, else the first that was heard
    #: (N,) faults by kind that was tested, at the ends of blocks; empty between
    faults: Sequence[dict[Kind, tuple[RotorFault, ...]]] = ()
    balances: Sequence[TankBalance | None] = ()  # (N,) about one a second
    stopped: Bools | None = None  # (N, R) rotors that were found to stand still by that row
    #: (T, R) s for which messages came without a rotor's speed; NaN: none was ever reported
    unheard_s: Floats | None = None
    from_outputs: bool = False  # all rotor speeds are made from motor outputs
    listed: Mapping[Key, Alarm] = field(default_factory=dict)  # what stands before these rows

    @property
    def bad_rotors(self) -> tuple[int, ...]:
        """Rotors, from 1, of the gravest alarm that a rotor or motor is bad; empty for none."""
        parts = [alarm for (name, _), alarm in self.listed.items() if name in OF_PARTS]
        first = min(parts, key=lambda alarm: alarm.order, default=None)
        if first is None:
            return ()
        return first.rotors or tuple(filter(None, (first.rotor,)))


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkNow:
    """What the link gives; silence is checked by when bytes came, not by when they were used."""

    silent: float  # s since anything was heard
    #: when last heard: a vehicle that is switched off after a landing is worth a notice
    flying: bool = True
    shared_id: int = 0  # system id under which two vehicles send; 0: none
    shared_since_s: float = math.nan  # ground's clock
    rows_behind: float = 0.0  # s for which messages were analysed that gave no row
    read_s: float = math.nan  # ground's clock of the last message that was analysed


@dataclass(frozen=True, slots=True)
class AlarmRule:
    """One alarm: how long, s, it must hold to be raised and be gone to be cleared."""

    name: str
    hold: float
    release: float
    checks: Callable[[AlarmSettings, Any], AlarmChecks]
    needs: Missing = Missing.NOTHING  # what is missing where nothing is known
    on_ground: str = "cleared"  # or "kept" as it was, or "checked" there too
    lull: float = 0.0  # s for which it stands after that, to be counted when it comes again
    sampled: bool = False  # found out now and then: nothing is asked between
    of_airframe: bool = False  # nothing is known of it without a verdict


def one_alarm(on: ArrayLike, off: ArrayLike, known: ArrayLike, **more: Any) -> AlarmChecks:
    """Checks of one alarm from (N,) arrays."""
    a, b, c = (np.atleast_1d(np.asarray(x, dtype=np.bool_))[:, None] for x in (on, off, known))
    return AlarmChecks(a, b, c, **more)
