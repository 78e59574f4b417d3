"""Choose the messages that battery, tank and pump are read from.

The flight battery's voltage and current come from its own message, else from SYS_STATUS or the
ESCs. `spraying` comes from the pump's output, else from the falling tank.

Autopilots have no message for a spray tank. In order of trust, `auto` takes
1. NAMED_VALUE_FLOAT `TANK` or `TANK_KG` (kg), `TANK_L` (litres);
2. FUEL_STATUS (ml), which PX4 sends;
3. a battery that is a tank: ArduPilot reports level and flow sensors as a further battery, whose
   mAh are ml, whose % is the level and whose 0.5 to 2.5 V are the level sender's;
4. the pump: its servo output times the airframe's largest flow, summed up from a start level that
   the user states. ArduPilot's sprayer already makes that output proportional to ground speed.
`source` forces one: "NAMED_VALUE_FLOAT NAME" (add ":l" for litres), "FUEL_STATUS [ID]",
"BATTERY_STATUS [ID]", "pump" or "none"; with `auto` the airframe file may name it (`tank_source`).
A source that is named is never replaced by another. Nothing is assumed about how full the tank was.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.signals import (
    Sampling,
    Signals,
    by_index,
    last_before,
    output_pulses,
)
from thrustmargin.models.errors import LogError
from thrustmargin.models.flight import Floats
from thrustmargin.models.physics.airframe import Airframe
from thrustmargin.models.physics.smoothing import known_median
from thrustmargin.models.provenance import NOT_REPORTED, Provenance, SourceKind
from thrustmargin.models.statement import Statement, state
from thrustmargin.models.vehicle_facts import StatedBattery

#: A flight battery reads more than this, the level sender of a tank less, V.
SENDER_VOLTAGE = 2.5

LEFT_OUT = state("tank level left out")
#: % by which the level from ml used may differ from the level in % and still be the same thing.
AGREEMENT = 1.5
WATER = 1.0  # kg/L
LONGEST_STEP = 2.0  # s between pump reports beyond which nothing is summed up
NUMBERED = ("FUEL_STATUS", "BATTERY_STATUS")  # sources that a number distinguishes
#: Batteries as which `monitor --announce-battery` sends margin and tank: no gauge of the vehicle's.
MARGIN_ID, TANK_ID = 90, 91
#: Names that `auto` knows -> True for litres.
NAMES = {"TANK": False, "TANK_KG": False, "TANK_L": True}
#: V by which an ESC's voltage must be off the others': three steps of what most ESCs report.
_ESC_OFFSET = 0.3


def power(
    signals: Signals, sampling: Sampling, notes: list[Statement]
) -> dict[str, Iterable[Signal]]:
    """Return the sources of the flight battery's "voltage" and "current", preferred first.

    They are the battery's own message, SYS_STATUS and the ESCs. With `sampling` "hold" only past
    reports count. Append to `notes` if further batteries have a flight battery's voltage.
    """
    sources: dict[str, Iterable[Signal]] = {}
    flown = flight_battery(signals)
    for channel in ("voltage", "current"):
        battery = by_index(signals, f"battery_{channel}")
        candidates = [*signals.get(channel, ())]
        if flown is not None and flown in battery:
            candidates.insert(0, battery[flown])
        sources[channel] = chain(candidates, _of_escs(channel, signals, sampling))
    others = [
        state("battery number", number=str(number))
        if sampling == "hold"
        else state(
            "battery range",
            number=str(number),
            low=float(np.nanmin(signal.values)),
            high=float(np.nanmax(signal.values)),
        )
        for number, signal in by_index(signals, "battery_voltage").items()
        if number != flown and np.mean(signal.values > 2 * SENDER_VOLTAGE) > 0.5
    ]
    if flown is not None and others:
        notes.append(state("further batteries", others=tuple(others), flown=str(flown)))
    return sources


def stated_battery(signals: Signals) -> StatedBattery:
    """Return cells, nominal voltage, V, and capacity, mAh, that the flight battery last reported
    above 0; 0 where it did not.

    If no voltage shows which battery is the flight battery, it is the one with the lowest number.
    """
    statements = {
        name: by_index(signals, f"battery_{name}") for name in ("cells", "nominal", "capacity")
    }
    if not any(statements.values()):
        return StatedBattery()
    flown = flight_battery(signals)
    if flown is None:  # its voltage comes in a message without a number
        flown = min((int(number) for stated in statements.values() for number in stated), default=0)
    last: dict[str, float] = {}
    sources: list[Provenance] = []
    for name, stated in statements.items():
        if (signal := stated.get(flown)) is not None:
            known = signal.values[np.isfinite(signal.values) & (signal.values > 0.0)]
            if known.size:
                last[name] = float(known[-1])
                sources.append(signal.source)
    return StatedBattery(
        cells=int(last.get("cells", 0)),
        nominal_voltage=last.get("nominal", 0.0),
        capacity_mah=last.get("capacity", 0.0),
        source=sources[0] if sources else NOT_REPORTED,
    )


def _of_escs(channel: str, signals: Signals, sampling: Sampling) -> Iterator[Signal]:
    """Yield the ESCs' mean "voltage" or summed "current" at the first ESC's report times.

    Nothing if no ESC reports a value above 0. With `sampling` "hold" each ESC's last report counts,
    and a current of 0 is unknown; else values are interpolated.
    """
    escs = [s for s in by_index(signals, f"esc_{channel}").values() if np.any(s.values > 0)]
    if not escs:
        return
    time_s = escs[0].time_s

    def at_first(signal: Signal) -> Floats:
        if sampling == "hold":
            return last_before(signal, time_s)
        return np.interp(time_s, signal.time_s, signal.values)

    stack = np.stack([at_first(s) for s in escs], axis=-1)
    if channel == "current":
        total = np.nansum(stack, axis=-1)
        if sampling == "hold":
            # Whether an ESC measures current at all shows only when some flows.
            total = np.where(total > 0, total, np.nan)
        yield Signal(channel, escs[0].source.remarked(state("sum of ESCs")), time_s, total)
        return
    known = np.count_nonzero(stack > 0, axis=-1)
    total = np.sum(stack, axis=-1, where=stack > 0)
    mean = np.where(known > 0, total / np.maximum(known, 1), np.nan)
    yield Signal(channel, escs[0].source.remarked(state("mean of ESCs")), time_s, mean)


def esc_voltage_offsets(signals: Signals, outputs: Sequence[int]) -> tuple[float, ...]:
    """Return the constant offset, V, of each motor's ESC voltage from the others' median, positive
    if it reads high.

    NaN for an ESC without one: the offset must be _ESC_OFFSET V or more and equal at high and low
    load, and all other ESCs must agree. `outputs` are the motors' ESC numbers. All ESCs share one
    battery: the drop along a cable grows with the load, the offset of an instrument does not. All
    are NaN unless all ESCs report, at least three.
    """
    escs = by_index(signals, "esc_voltage")
    of_rotors = [escs.get(output) for output in outputs]
    nothing = (float("nan"),) * len(outputs)
    heard = [s for s in of_rotors if s is not None and np.mean(s.values > SENDER_VOLTAGE) > 0.5]
    if len(heard) < max(3, len(outputs)):
        return nothing
    time_s = heard[0].time_s
    volts = np.stack([np.interp(time_s, s.time_s, s.values) for s in heard], axis=-1)
    volts = volts[np.all(volts > SENDER_VOLTAGE, axis=1)]
    if not len(volts):
        return nothing
    middle = np.median(volts, axis=1)
    low, high = np.quantile(middle, [0.2, 0.8])  # the battery sags under load

    def offset(rotor: int) -> float:
        usual = np.median(np.delete(volts, rotor, axis=1), axis=1)
        own = volts[:, rotor] - usual
        size = np.median(own)
        if not abs(size) >= _ESC_OFFSET:
            return float("nan")
        others = np.delete(np.median(volts - usual[:, None], axis=0), rotor)
        loaded, free = (np.median(own[part]) for part in (middle <= low, middle >= high))
        stays = abs(loaded - free) < 0.5 * abs(size)
        alone = np.ptp(others) < 0.5 * abs(size)
        return float(size) if stays and alone else float("nan")

    return tuple(offset(rotor) for rotor in range(len(outputs)))


@dataclass(frozen=True, slots=True)
class TankLevel:
    """The tank level, kg, as one signal or None, and notes."""

    signal: Signal | None
    notes: tuple[Statement, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class TankContext:
    """The airframe, parameters and pump state needed to compute a tank level."""

    airframe: Airframe | None
    parameters: Mapping[str, float]
    start_kg: float | None = None
    pump_output: int | None = None  # number of the pump's servo output, from 0
    pumped: PumpedSoFar | None = None  # before the signals begin

    @property
    def liquid_density(self) -> float:
        """Return the density, kg/L; water's without an airframe."""
        return self.airframe.liquid_density if self.airframe else WATER


def flight_battery(signals: Signals) -> int | None:
    """Return the id of the flight battery; None if no battery qualifies.

    It is the lowest id whose median voltage is above SENDER_VOLTAGE, that of a level sensor, and
    above half of the highest median: batteries below that feed the autopilot.
    """
    volts = {n: known_median(s.values) for n, s in _heard(signals, "battery_voltage").items()}
    least = max(SENDER_VOLTAGE, 0.5 * max(volts.values(), default=0.0))
    return next((number for number, level in volts.items() if level > least), None)


def first_level(levels: Iterator[TankLevel]) -> TankLevel:
    """Return the first level with a signal, with the notes of all levels tried before it."""
    notes: tuple[Statement, ...] = ()
    for level in levels:
        notes += level.notes
        if level.signal is not None:
            return replace(level, notes=notes)
    return TankLevel(None, notes)


def tank_levels(
    signals: Signals, context: TankContext, source: str = "auto"
) -> Iterator[TankLevel]:
    """Yield each tank level that the signals contain by `source` ("auto": any), preferred first.

    A level without a signal has notes that give the reason. With "auto" the airframe's own source,
    if it names one, is used. Raise LogError if `source` is malformed, or a named source is not
    reported.
    """
    if source.strip().upper() == "AUTO" and context.airframe is not None:
        source = context.airframe.tank_source
    kind, rest = check_source(source)
    number = int(rest) if kind in NUMBERED and rest else None
    match kind:
        case "AUTO":
            yield from _automatic(signals, context)
            return
        case "NONE":
            yield TankLevel(None, (LEFT_OUT,))
            return
        case "NAMED_VALUE_FLOAT":
            levels = _named(signals, context, rest or "TANK")
        case "FUEL_STATUS":
            levels = _fuel(signals, context, number)
        case "BATTERY_STATUS":
            levels = _battery(signals, context, number)
        case _:
            levels = _pump(signals, context)
    if levels is None:
        named = context.airframe is not None and source == context.airframe.tank_source
        choice = (
            f", which airframe {context.airframe.name} names" if named and context.airframe else ""
        )
        raise LogError(f"no tank level from {source!r}{choice} reported; name another with --tank")
    yield levels


def check_source(source: str) -> tuple[str, str]:
    """Split a tank source such as "FUEL_STATUS 1" into its kind, in capitals, and name or number.

    The latter is empty if there is none. Raise LogError if the kind is unknown, or FUEL_STATUS or
    BATTERY_STATUS is followed by anything but a number.
    """
    kind, _, rest = source.strip().partition(" ")
    kind = kind.upper()
    if kind not in ("AUTO", "NONE", "NAMED_VALUE_FLOAT", *NUMBERED, "PUMP"):
        raise LogError(
            f"tank source {source!r} is not known; use auto, none, pump, "
            "'NAMED_VALUE_FLOAT NAME', 'FUEL_STATUS ID' or 'BATTERY_STATUS ID'"
        )
    if kind in NUMBERED:
        rest = rest.strip().removeprefix("id").strip()
        if rest and not rest.isdigit():
            raise LogError(f"tank source {source!r}: {rest!r} is not a number")
    return kind, rest


def _automatic(signals: Signals, context: TankContext) -> Iterator[TankLevel]:
    named = by_index(signals, "named_value")
    for name in (n for n in named if str(n).upper() in NAMES):
        unit = ":l" if NAMES[str(name).upper()] else ""
        levels = _named(signals, context, f"{name}{unit}")
        if levels is not None:
            yield levels
    for levels in (_fuel(signals, context, None), _battery(signals, context, None)):
        if levels is not None:
            yield levels
    unknown = (state("tank level unknown"),)
    no_tank = context.airframe is not None and context.airframe.tank_volume_l == 0.0
    yield _pump(signals, context) or TankLevel(None, () if no_tank else unknown)


def _in_kg(signal: Signal, kilograms: Floats, *remarks: Statement) -> Signal:
    return Signal("tank_kg", signal.source.remarked(*remarks), signal.time_s, kilograms)


def _named(signals: Signals, context: TankContext, name: str) -> TankLevel | None:
    name, _, unit = name.strip().partition(":")
    signal = by_index(signals, "named_value").get(name)
    if signal is None or not np.isfinite(signal.values).any():
        return None
    litres = unit.lower() == "l"
    remarks = (state("litres"),) if litres else ()
    factor = context.liquid_density if litres else 1.0
    notes = _density_notes(context) if litres else ()
    return TankLevel(_in_kg(signal, signal.values * factor, *remarks), notes)


def _density_notes(context: TankContext) -> tuple[Statement, ...]:
    if context.airframe is None:
        return (state("liquid taken as water"),)
    return ()


def _heard(signals: Signals, channel: str) -> dict[int, Signal]:
    """Return the sources of a channel with a numeric index and a finite value, by index,
    ascending.
    """
    numbered = sorted(
        (int(number), signal) for number, signal in by_index(signals, channel).items()
    )
    return {number: signal for number, signal in numbered if np.isfinite(signal.values).any()}


def _fuel(signals: Signals, context: TankContext, chosen: int | None) -> TankLevel | None:
    remaining, percent = (_heard(signals, f"fuel_{what}") for what in ("remaining", "percent"))
    number = min({*remaining, *percent} if chosen is None else {chosen}, default=-1)
    if signal := remaining.get(number):
        kilograms = signal.values * 1e-3 * context.liquid_density
        return TankLevel(_in_kg(signal, kilograms, state("ml")), _density_notes(context))
    if signal := percent.get(number):
        if context.airframe is None:
            return TankLevel(None, (state("only a share", source=signal.source),))
        kilograms = signal.values * 1e-2 * context.airframe.tank_capacity_kg
        return TankLevel(_in_kg(signal, kilograms, state("of airframe's tank")))
    return None


def _battery(signals: Signals, context: TankContext, chosen: int | None) -> TankLevel | None:
    volts, flown = _heard(signals, "battery_voltage"), flight_battery(signals)
    for number, percent in _heard(signals, "battery_percent").items():
        level_v = known_median(volts[number].values) if number in volts else np.nan
        dead = flown is None and not level_v > 0.0  # it may be flown on, its voltmeter dead
        no_tank = number in (MARGIN_ID, TANK_ID, flown) or level_v > SENDER_VOLTAGE or dead
        if number == chosen or (chosen is None and not no_tank):
            used = _heard(signals, "battery_consumed").get(number)
            return _battery_level(percent, used, context, number)
    return None


def _battery_level(
    percent: Signal, used: Signal | None, context: TankContext, number: int
) -> TankLevel:
    """Return the tank level, kg, from the percentage of battery `number`, which is a level sensor.

    Reports in which the ml used (`used`, with as many values) agree with it within AGREEMENT % use
    them. The capacity is parameter BATTn_CAPACITY, else the airframe's; without one, or if it is 0,
    the level has no signal.
    """
    key = f"BATT{number + 1 if number else ''}_CAPACITY"
    if context.parameters.get(key, 0.0) > 0.0:
        capacity_ml = context.parameters[key]
        capacity_l, whose = capacity_ml * 1e-3, state("capacity set", name=key, ml=capacity_ml)
    elif context.airframe is not None:
        capacity_l = context.airframe.tank_volume_l
        whose = state("airframe's capacity", litres=capacity_l)
    else:
        like = state("tank of unknown volume", name=percent.source.name, number=str(number))
        return TankLevel(None, (like,))
    if capacity_l == 0.0:
        return TankLevel(None)  # an airframe without a tank: some other battery
    notes = _density_notes(context)
    capacity_kg = capacity_l * context.liquid_density
    if used is not None and used.values.size == percent.values.size:
        remaining = 1.0 - used.values * 1e-3 / capacity_l
        with np.errstate(invalid="ignore"):
            agrees = np.abs(remaining * 100.0 - percent.values) <= AGREEMENT
        if agrees.any():
            # Report by report: a tank that is refilled leaves the ml used behind.
            share = np.where(agrees, remaining, percent.values * 1e-2)
            of_tank = state("tank by ml used", whose=whose)
            return TankLevel(_in_kg(used, share * capacity_kg, of_tank), notes)
    level_kg = percent.values * 1e-2 * capacity_kg
    return TankLevel(_in_kg(percent, level_kg, state("tank by percent", whose=whose)), notes)


def _pump(signals: Signals, context: TankContext) -> TankLevel | None:
    share = pump_share(signals, context)
    if share is None:
        return None
    if context.start_kg is None or context.airframe is None:
        missing = "start level unknown" if context.airframe else "airframe unknown"
        return TankLevel(None, (state(missing),))
    total = pumped(share, context)
    level = np.maximum(context.start_kg - total.values, 0.0)
    source = Provenance(
        kind=SourceKind.INFERRED,
        name="pump output",
        parts=(share.source,),
        remarks=(
            state("summed", servo=str((context.pump_output or 0) + 1), start=context.start_kg),
            state("full flow", flow=context.airframe.pump_max_flow_l_min),
        ),
    )
    return TankLevel(Signal("tank_kg", source, total.time_s, level))


@dataclass(frozen=True, slots=True)
class PumpedSoFar:
    """The sum of the pump's output at a time, to continue from in the next batch."""

    time_s: float  # of the pump's last report
    share: float  # its output there, 0 off to 1 full
    kg: float


def pumped(share: Signal, context: TankContext) -> Signal:
    """Return the signal of the mass, kg, that the pump has delivered by each report of its output.

    `share` is that output, 0 to 1. It starts at 0, or continues from `context.pumped`, whose time
    is then the first. NaN without an airframe, because the flow is unknown. Pauses of more than
    LONGEST_STEP s are not summed over.
    """
    time_s, output, before = share.time_s, np.nan_to_num(share.values), 0.0
    if context.pumped is not None:
        later = time_s > context.pumped.time_s
        time_s = np.concatenate([[context.pumped.time_s], time_s[later]])
        output = np.concatenate([[context.pumped.share], output[later]])
        before = context.pumped.kg
    flow = np.nan
    if context.airframe is not None:
        flow = context.airframe.pump_max_flow_l_min / 60.0 * context.liquid_density  # kg/s
    step = np.diff(time_s, prepend=time_s[:1])
    # Held from report to report; a pause in the reports longer than this is not summed over.
    volumes = np.concatenate([[0.0], output[:-1]]) * np.minimum(step, LONGEST_STEP)
    kilograms = before + flow * np.cumsum(volumes)
    return Signal("pumped_kg", share.source, time_s, kilograms)


def pump_share(signals: Signals, context: TankContext) -> Signal | None:
    """Return the signal of the pump's output from 0 (off) to 1 (full), NaN without a pulse.

    Full and off are SERVOn_MAX and _MIN, 1900 and 1100 µs if unset. None if `context` names no pump
    output, it has no pulse at all, or its range is invalid.
    """
    if context.pump_output is None or not (sent := output_pulses(signals, context.pump_output)):
        return None
    number = context.pump_output + 1
    low = context.parameters.get(f"SERVO{number}_MIN", 1100.0)
    high = context.parameters.get(f"SERVO{number}_MAX", 1900.0)
    pulse = sent.values
    if high <= low or not np.any(pulse > 0):
        return None
    # No pulse at all is no information about the pump.
    share = np.where(pulse > 0, np.clip((pulse - low) / (high - low), 0.0, 1.0), np.nan)
    source = replace(sent.source, fields=(f"servo {number}",)).remarked(state("pump"))
    return Signal("spraying", source, sent.time_s, share)


#: A tank that loses more than this over the window is being sprayed, kg/s.
_SPRAY_RATE = 0.008
_SPRAY_WINDOW = 4.0  # s


def spraying_sources(
    share: Signal | None, tank: Signal | None, sampling: Sampling, notes: list[Statement]
) -> tuple[Signal, ...]:
    """Return the sources of `spraying`, 1 while the pump runs, else 0, preferred first; empty
    without pump output and tank level.

    They are the pump's output `share` (0 to 1) and the falling level `tank`, kg. An unknown output
    is 0, with `sampling` "hold" NaN. If the level is the only source, append to `notes` that there
    is no pump output.
    """
    sources = []
    if share is not None:
        on = (share.values > 0.0).astype(np.float64)
        if sampling == "hold":
            # That an output without a pulse will have one later, a listener cannot know.
            on[np.isnan(share.values)] = np.nan
        above = share.source.remarked(state("above its minimum"))
        sources.append(Signal("spraying", above, share.time_s, on))
    if tank is not None and tank.time_s.size:
        earlier = np.interp(tank.time_s - _SPRAY_WINDOW, tank.time_s, tank.values)
        falling = (earlier - tank.values) / _SPRAY_WINDOW > _SPRAY_RATE
        if share is None:
            notes.append(state("no pump output"))
        source = Provenance(
            kind=SourceKind.INFERRED,
            parts=(tank.source,),
            remarks=(state("tank level falls", rate=_SPRAY_RATE * 60),),
        )
        sources.append(Signal("spraying", source, tank.time_s, falling.astype(np.float64)))
    return tuple(sources)
