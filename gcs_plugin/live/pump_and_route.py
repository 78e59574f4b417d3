"""What is known at each row of the liquid that the pump delivered and of the route ahead."""

from __future__ import annotations

import math

import numpy as np

from thrustmargin.gcs_plugin.live.outlook import LookAhead
from thrustmargin.gcs_plugin.live.tank_balance import DeliveryMeter
from thrustmargin.gcs_plugin.live.vehicle_state import VehicleState
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.analysis import FlightAnalysis
from thrustmargin.models.model.rotor_model import RotorModel


class PumpAndRoute:
    """Kept up by `rows`, for one vehicle. `ahead` has the last forecast."""

    def __init__(self, model: RotorModel) -> None:
        self.ahead = LookAhead(model)
        self._delivery = DeliveryMeter()

    def rows(
        self,
        analysis: FlightAnalysis,
        first: int,
        *,
        clock_s: Floats,
        pump_share: Floats,
        pumped_kg: Floats,
        mission_item: Floats,
        state: VehicleState,
    ) -> tuple[Floats, Floats]:
        """Take the rows from `first` on, in order, of which the other arrays (n,) are.

        Returns kg delivered since the pump was first heard, by the delivery factor that was known
        at the row, and the least predicted margin on the rest of the route, NaN without a mission.
        `pump_share` is the pump's output from 0 to 1, `pumped_kg` what that sums up to at full
        delivery, `mission_item` flown to (NaN unknown).
        """
        gauge = analysis.track.measured("tank_kg")
        delivered, ahead = np.full((2, clock_s.size), np.nan)
        for k, row in enumerate(range(first, analysis.track.time_s.size)):
            self._delivery.add(float(gauge[row]), float(pumped_kg[k]))
            delivered[k] = pumped_kg[k] * self._delivery.first
            self.ahead.look(
                analysis,
                row,
                clock_s=float(clock_s[k]),
                pump_share=float(pump_share[k]),
                delivery=self._delivery.now,
                mission_item=int(mission_item[k]) if math.isfinite(mission_item[k]) else -1,
                state=state,
            )
            ahead[k] = self.ahead.now.margin_ahead
        return delivered, ahead
