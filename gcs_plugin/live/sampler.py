"""From the state of a vehicle to the rows of a FlightTrack, as they happen.

One row a rotor-speed report, thinned to at most 10 Hz; where there is none, one an ATTITUDE; else
one every 0.1 s. Each channel is the last report of its preferred source, NaN when that is older
than the channel's age limit: the rows that `read_log(..., sampling="hold")` makes of a file.
Two things cannot be known before the flight has ended and differ there: the last moments before a
landing still count as flying, and a home set in flight does not move the origin.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from thrustmargin.gcs_plugin.live.live_rows import COLUMNS, FIXED, Sample
from thrustmargin.gcs_plugin.live.tank import TankWatch
from thrustmargin.gcs_plugin.live.vehicle_state import Key, Reading, VehicleState, orders
from thrustmargin.gcs_plugin.logs.tlog import ROTORS_OF_TYPE
from thrustmargin.gcs_plugin.telemetry.airborne import CLEAR, IN_AIR, LANDING, TAKING_OFF
from thrustmargin.gcs_plugin.telemetry.motors import MotorMap, motor_map
from thrustmargin.gcs_plugin.telemetry.recording import LogQuality, Recording
from thrustmargin.gcs_plugin.telemetry.resample import GRID, ROW_SPACING
from thrustmargin.gcs_plugin.telemetry.tank_source import SENDER_VOLTAGE
from thrustmargin.models.errors import AirframeError
from thrustmargin.models.flight import TRACK_CHANNELS, Floats, Origin
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.atmosphere import G0

NAN = float("nan")
FAILURES_AGE = 5.0  # s for which an ESC's report on itself holds; PX4 sends one a second
DIRECT = tuple(name for name, column in TRACK_CHANNELS.items() if column.direct)
SILENT = 2.0  # s after which rotor speed reports no longer set the rhythm


class Sampler:
    """Makes the rows of one vehicle. `problem` says why there can be none; empty when all is well.

    Call `after` with the state after every message.
    """

    def __init__(
        self,
        name: str,
        airframe: Airframe | None,
        *,
        tank: str = "auto",
        tank_start_kg: float | None = None,
    ) -> None:
        self.name = name
        self.problem = ""
        self.origin: Origin | None = None
        self.notes: tuple[str, ...] = ()
        self._airframe = airframe
        self._tank = tank
        self._tank_start = tank_start_kg
        self._motors: MotorMap | None = None
        self._known: tuple[int, int, int] = (-1, -1, -1)
        self._restart(0)

    def _restart(self, boot: int) -> None:
        self._boot = boot
        self._beat: Reading | None = None
        self._beat_key: Key | None = None
        self._since = NAN  # the vehicle's clock when it was first heard
        self._clocked = False
        self._row_clock = NAN
        self._ground: float | None = None
        self._clear = False
        self._landed = False  # it has been heard on the ground
        self._placed_by = 3
        self._watch = TankWatch(self._airframe, self._tank, self._tank_start)

    @property
    def motors(self) -> MotorMap | None:
        """Which output is which motor; None before the first row."""
        return self._motors

    def after(self, state: VehicleState) -> Sample | None:
        """A new row if the last message gave one."""
        if state.boot != self._boot:
            self._restart(state.boot)
        motors = self._layout(state)
        if motors is None:
            return None
        beat = self._rhythm(state, motors)
        if beat is None or beat is self._beat:
            return None
        self._beat = beat
        # Thinned as a file is: from the first row on, never closer than the spacing.
        if not (np.isnan(self._row_clock) or beat.clock_s - self._row_clock >= ROW_SPACING):
            return None
        self._row_clock = beat.clock_s
        return self._row(state, motors, beat)

    def _layout(self, state: VehicleState) -> MotorMap | None:
        escs = sum(1 for key in state.readings if key[0] == "esc_rpm")
        known = (len(state.parameters), state.kind, escs)
        if known == self._known:
            return self._motors
        self._known = known
        recording = Recording(
            path=Path(self.name),
            format="live",
            streams={},
            parameters=state.parameters,
            waypoints=(),
            messages=(),
            unix_minus_clock=None,
            quality=LogQuality(bytes=0, frames=0),
            vehicle=state.system,
            vehicles=(state.system,),
            autopilot="unknown",
            rotor_count_hint=ROTORS_OF_TYPE.get(state.kind),
        )
        try:
            self._motors = motor_map(recording, state.signals("esc_rpm"), self._airframe)
        except AirframeError as error:
            self._motors, self.problem = None, str(error)
            return None
        self.problem, self.notes = "", (*self._motors.notes, *_assumed(self._motors))
        return self._motors

    def _rhythm(self, state: VehicleState, motors: MotorMap) -> Reading | None:
        """The report that makes a row now; the last one again while there is no new one."""
        now = state.now(state.stamp_us)
        clocked = not np.isnan(state.clock_s)
        if np.isnan(self._since) or clocked != self._clocked:
            self._since, self._clocked = now, clocked
        key = self._beat_key
        if key is not None and state.readings.get(key) is self._beat and self._young(now):
            return self._beat
        rpm = [
            (key, reading)
            for output in motors.outputs
            for key, reading in state.readings.items()
            if key[0] == "esc_rpm" and key[1] == output
        ]
        for key, reading in rpm:
            if now - reading.clock_s <= SILENT:
                self._beat_key = key
                return reading
        # Rotor speeds have been silent, or have had no time yet to be heard; a vehicle that has
        # sent no clock yet is waited for longer.
        if now - self._since < (SILENT if clocked else 10 * SILENT):
            return None
        for order in orders("attitude"):
            key = ("attitude", None, order)
            reading = state.readings.get(key)
            if reading is not None and now - reading.clock_s <= SILENT:
                self._beat_key = key
                return reading
        self._beat_key = None
        if self._beat is not None and now - self._beat.clock_s < GRID:
            return self._beat
        flown = any(key[0] in DIRECT or key[0] == "geodetic" for key in state.readings)
        return Reading(NAN, now, state.stamp_us, "", True) if flown else None

    def _young(self, now: float) -> bool:
        return self._beat is not None and now - self._beat.clock_s <= SILENT

    def _row(self, state: VehicleState, motors: MotorMap, beat: Reading) -> Sample:
        clock, count = beat.clock_s, motors.rotor_count
        values = np.full(FIXED + 2 * count, np.nan)
        sources: dict[str, str] = {}

        def hold(channel: str, reading: Reading | None, limit: str | None = None) -> bool:
            if (
                reading is None
                or clock - reading.clock_s > TRACK_CHANNELS[limit or channel].max_age
            ):
                return False
            values[COLUMNS[channel]] = reading.value
            sources[channel] = reading.source
            return True

        for channel in DIRECT:
            hold(channel, state.best(channel))
        for channel in ("voltage", "current"):
            hold(channel, self._power(state, channel))
        if not hold("geodetic", state.best("geodetic"), "position_ned"):
            hold("position_ned", state.best("position_ned"))

        escs = state.by_index("esc_rpm")
        for rotor, output in enumerate(motors.outputs):
            values[FIXED + rotor] = _fresh(escs.get(output), clock, "rotor_speed_rpm")
        if escs:
            sources["rotor_speed_rpm"] = next(iter(escs.values())).source
        servos = state.best("servo_us")
        if servos is not None and clock - servos.clock_s <= TRACK_CHANNELS["throttle"].max_age:
            throttle = motors.throttle(state.signals("servo_us"), state.parameters)
            for rotor, signal in enumerate(throttle):
                if signal is not None:
                    values[FIXED + count + rotor] = signal.values[-1]
            sources["throttle"] = servos.source.split()[0]
        tank = self._watch.read(state, motors)
        if clock - tank.clock_s <= TRACK_CHANNELS["tank_kg"].max_age:
            values[COLUMNS["tank_kg"]] = tank.level_kg
            sources["tank_kg"] = tank.source
        fresh = clock - tank.pump_clock_s <= TRACK_CHANNELS["spraying"].max_age
        if fresh and motors.pump_output is not None:
            values[COLUMNS["spraying"]] = float(tank.pump_share > 0.0)
            sources["spraying"] = f"pump on servo {motors.pump_output + 1}"
        rotors = values[FIXED : FIXED + count]
        flying = self._airborne(state, float(values[COLUMNS["height_agl"]]), rotors)
        self._place(state, values[COLUMNS["geodetic"]])
        return Sample(
            clock_s=clock,
            stamp_us=beat.stamp_us,
            boot=state.boot,
            values=values,
            flying=flying,
            rotors_heard=bool(np.any(np.isfinite(rotors))),
            tank=tank,
            esc_failures=_failures(state.by_index("esc_failure"), motors, clock),
            sources=sources,
        )

    def _power(self, state: VehicleState, channel: str) -> Reading | None:
        """Flight pack's battery message, else SYS_STATUS, else the ESCs, as for a log."""
        volts = state.by_index("battery_voltage")
        packs = sorted(
            n for n, r in volts.items() if isinstance(n, int) and r.value > SENDER_VOLTAGE
        )
        if packs:
            found = state.by_index(f"battery_{channel}").get(packs[0])
            if found is not None:
                return found
        found = state.best(channel)
        if found is not None:
            return found
        escs = [r for r in state.by_index(f"esc_{channel}").values() if r.value > 0]
        if not escs:
            return None
        total = sum(r.value for r in escs)
        value = total / len(escs) if channel == "voltage" else total
        words = f"{escs[0].source} ({'mean' if channel == 'voltage' else 'sum'} of ESCs)"
        return Reading(value, escs[0].clock_s, escs[0].stamp_us, words, True)

    def _airborne(self, state: VehicleState, height: float, rotors: Floats) -> bool:
        """Off the ground, by what a log is judged by too, as far as it can be known in time."""
        landed = state.best("landed")
        if landed is not None:
            if int(landed.value) not in (IN_AIR, TAKING_OFF, LANDING):
                self._ground, self._clear, self._landed = None, False, True
                return False
            # Heard for the first time in the air: where the ground is cannot be told.
            if np.isnan(height) or not self._landed:
                return True
            ground = height if self._ground is None else self._ground
            self._ground = ground
            self._clear = self._clear or height > ground + CLEAR
            return self._clear
        if self._airframe is not None and np.any(np.isfinite(rotors)):
            thrust = self._airframe.thrust_coefficient * np.nansum(rotors**2)
            return bool(thrust > 0.5 * self._airframe.empty_mass * G0)
        return state.armed

    def _place(self, state: VehicleState, fix: Floats) -> None:
        """The origin: home as it was at take-off, the EKF's origin, else the first fix."""
        for rank, channel in enumerate(("home", "ekf_origin")):
            reading = state.best(channel)
            if reading is None or not np.any(reading.value):
                continue
            if rank < self._placed_by or (rank == self._placed_by and not self._clear):
                self._placed_by = rank
                self.origin = _origin(reading.value)
            return
        if self.origin is None and np.all(np.isfinite(fix)) and np.any(fix[:2]):
            self.origin, self._placed_by = _origin(fix), 2


def _origin(geodetic: Any) -> Origin:
    latitude, longitude, altitude = (float(v) for v in geodetic)
    return Origin(latitude_deg=latitude, longitude_deg=longitude, altitude=altitude)


def _assumed(motors: MotorMap) -> tuple[str, ...]:
    """What is taken for granted until the vehicle says which output drives which motor."""
    return (f"{motors.order_words}; --request-rates asks",) if motors.assumed else ()


def _failures(
    reported: dict[int | str, Reading], motors: MotorMap, clock: float
) -> tuple[int, ...]:
    found = [reported.get(output) for output in motors.outputs]
    fresh = [r is not None and clock - r.clock_s <= FAILURES_AGE for r in found]
    if not any(fresh):
        return ()
    return tuple(int(r.value) if ok and r else 0 for r, ok in zip(found, fresh, strict=True))


def _fresh(reading: Reading | None, clock: float, channel: str) -> float:
    if reading is None or clock - reading.clock_s > TRACK_CHANNELS[channel].max_age:
        return NAN
    return reading.value
