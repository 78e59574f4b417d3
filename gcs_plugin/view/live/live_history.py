"""The last minutes of one aircraft's rotor speeds, for charts that can be looked back over."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.live.watch.update import Update
from thrustmargin.gcs_plugin.view.figures.charts import Speeds

KEPT_S = 600.0


class LiveHistory:
    """Rows as they came: `add` is for the compute thread, `speeds` for the drawing thread."""

    def __init__(self) -> None:
        self._parts: deque[Speeds] = deque()
        self._boot = 0

    def add(self, update: Update) -> None:
        """The new rows; a vehicle that restarted, or has other rotors, begins anew."""
        rows = Speeds.of(update.analysis).rows(slice(update.first, None), update.clock_s)
        copies: Any = map(np.copy, rows)  # a view would keep its whole window alive
        now = Speeds(*copies)
        if not now.time_s.size:
            return
        last = self._parts[-1] if self._parts else now
        if update.boot != self._boot or last.measured.shape[1] != now.measured.shape[1]:
            self._parts.clear()
        self._boot = update.boot
        self._parts.append(now)
        while self._parts[0].time_s[-1] < now.time_s[-1] - KEPT_S:
            self._parts.popleft()

    @property
    def speeds(self) -> Speeds | None:
        """All that is kept; None of nothing."""
        parts = list(self._parts)
        if not parts:
            return None
        rotors = parts[-1].measured.shape[1]
        parts = [part for part in parts if part.measured.shape[1] == rotors]
        return Speeds(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))
