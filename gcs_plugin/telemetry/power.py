"""Find the voltage and current of the flight battery, and when the pump runs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain

import numpy as np

from thrustmargin.gcs_plugin.mavlink.rules import Signal
from thrustmargin.gcs_plugin.telemetry.resample import Sampling, last_before
from thrustmargin.gcs_plugin.telemetry.signals import SENDER_VOLTAGE, Signals, by_index
from thrustmargin.gcs_plugin.telemetry.tank_source import flight_battery
from thrustmargin.models.flight import Floats
from thrustmargin.models.provenance import NOT_REPORTED, Provenance, SourceKind
from thrustmargin.models.statement import Statement, state
from thrustmargin.models.vehicle_facts import StatedBattery

#: A tank that loses more than this over the window is being sprayed, kg/s.
_SPRAY_RATE = 0.008
_SPRAY_WINDOW = 4.0  # s
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
    """Return cells, nominal voltage and capacity that the flight battery last reported; 0 where it
    did not."""
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
    """Return the constant offset, V, of each motor's ESC voltage from the others'; NaN without one.

    `outputs` are the motors' ESC numbers. All ESCs share one battery: the drop along a cable grows
    with the load, the offset of an instrument does not. All ESCs must report, at least three, and
    all but one must agree.
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


def spraying_sources(
    share: Signal | None, tank: Signal | None, sampling: Sampling, notes: list[Statement]
) -> tuple[Signal, ...]:
    """Return the sources of `spraying`, 1 while the pump runs, else 0, preferred first.

    They are the pump's output `share` (0 to 1) and the falling level `tank`, kg. An unknown output
    is 0, with `sampling` "hold" NaN. Append to `notes` if there is no pump output.
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
