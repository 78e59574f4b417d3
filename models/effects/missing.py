"""Rows that lack a channel: effects do nothing there, by the neutral values that they own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from thrustmargin.models.effects.base import Effect, Placed, Values
from thrustmargin.models.effects.channels import LAGS, NEAR_LAG, Channels
from thrustmargin.models.flight import Bools


def tolerant(item: Placed) -> Placed:
    """The effect for numpy channels with gaps, in which it does nothing."""
    effect = item.effect
    if not effect.neutral:
        return item

    def apply(p, x, *given):
        return effect.apply(p, filled(effect, p, x), *given)

    def torque(p, x):
        assert effect.torque is not None
        return effect.torque(p, filled(effect, p, x))

    whole = replace(effect, apply=apply, torque=torque if effect.torque else None)
    return replace(item, effect=whole)


def filled(effect: Effect, p: Values, x: Channels) -> Channels:
    """The channels with the effect's neutral values in place of missing ones.

    A row that lacks one plain channel has the neutral values of all; of a table of delays only the
    missing delays are filled.
    """
    gap = np.zeros(x.time_s.shape, dtype=np.bool_)
    for name in effect.neutral:
        value = x.read(name)
        if isinstance(value, np.ndarray) and value.ndim == 1:
            gap |= ~np.isfinite(value)
    changed: dict[str, Any] = {}
    for name, neutral in effect.neutral.items():
        nothing = neutral(p, x) if callable(neutral) else neutral
        value = x.read(name)
        if isinstance(value, tuple):
            changed[name] = tuple(np.where(np.isfinite(v), v, nothing) for v in value)
        else:
            bad = gap if value.ndim == 1 else ~np.isfinite(value)
            changed[name] = np.where(bad, nothing, value)
    own = {name: changed.pop(name, value) for name, value in x.own.items()}
    return replace(x, own=own, **changed)


def lacking(placed: Sequence[Placed], x: Channels) -> Bools:
    """(T,) rows that lack a channel of an effect, near the row or, of late reports, anywhere."""
    late = any(item.effect.delays for item in placed)
    looked_at = np.ones(len(LAGS), np.bool_) if late else np.abs(LAGS) <= NEAR_LAG
    rows = np.zeros(x.time_s.shape, dtype=np.bool_)
    for name in {name for item in placed for name in item.effect.neutral}:
        value = x.read(name)
        for part in value if isinstance(value, tuple) else (value,):
            bad = ~np.isfinite(part)
            if name.endswith("_shifts"):
                bad = bad[:, looked_at]
            rows |= bad.any(axis=tuple(range(1, bad.ndim)))
    return rows
