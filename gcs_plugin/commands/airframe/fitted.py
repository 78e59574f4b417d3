"""Quantities of an airframe fitted to a bench table or to the hover of its own flights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from math import log
from pathlib import Path
from typing import TYPE_CHECKING

from thrustmargin.gcs_plugin.commands.shared.inputs import ReadingOptions, reading_keywords
from thrustmargin.gcs_plugin.wording.check_words import in_english
from thrustmargin.gcs_plugin.wording.language import UNKNOWN, known, percent
from thrustmargin.models.errors import DataError

if TYPE_CHECKING:
    from thrustmargin.models.physics.airframe import Airframe, Quantity
    from thrustmargin.models.physics.thrust_fits import HoverFit
    from thrustmargin.models.scores import Estimate


NO_INTERVAL = "interval not known"
#: Two figures of full thrust that are further apart are no rounding and no battery's voltage.
SAME_THRUST = 0.1
SIGMAS_95 = 1.96  # standard errors on either side of a 95 % interval


@dataclass(frozen=True, slots=True, kw_only=True)
class Fitted:
    """Quantities with their sources, and sentences on further results of the data."""

    quantities: dict[str, Quantity] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def bench_quantities(path: Path) -> Fitted:
    """Fit thrust coefficient, largest rotor speed and thrust, and ceiling voltage to a bench table.

    Notes name rows that were left out, and assumptions. Raises DataError if the table is unfit.
    """
    from thrustmargin.gcs_plugin.logs.bench_table import read_bench
    from thrustmargin.models.physics.airframe import Quantity

    table = read_bench(path)
    fit = table.fit
    where = f"fitted: {fit.points} rows of {path.name}"
    made = {
        "thrust_coefficient": Quantity(
            float(f"{fit.coefficient.value:.5g}"),
            "N/rpm^2",
            f"{where}, {interval(fit.coefficient)}",
        )
    }
    ends = "at full throttle" if fit.full_throttle else "in its fastest row"
    made["max_rotor_speed_rpm"] = Quantity(
        round(fit.max_rotor_speed_rpm, 1), "rpm", f"{path.name}: {ends}", not fit.full_throttle
    )
    made["nameplate_max_thrust"] = Quantity(
        round(fit.max_thrust, 3), "N", f"{path.name}: largest thrust", not fit.full_throttle
    )
    if fit.ceiling_voltage > 0.0:
        volts = f"{path.name}: voltage {ends}"
        made["ceiling_voltage"] = Quantity(round(fit.ceiling_voltage, 2), "V", volts)
    power = fit.voltage_exponent
    if power.value >= 0.0:
        made["ceiling_voltage_exponent"] = Quantity(
            round(power.value, 3), "1", f"{where} at full throttle, {interval(power)}"
        )
    notes = [
        f"{path.name}: thrust goes with speed to the power {interval(fit.exponent)}; "
        + (
            "the file's T = a N² holds"
            if fit.exponent.low <= 2.0 <= fit.exponent.high
            else "the file's T = a N² is an approximation, best near the largest thrusts"
        )
        + f" (R² {fit.r2:.4f})"
    ]
    if not fit.full_throttle:
        notes.append(
            f"{path.name} does not say which row is at full throttle; its fastest is taken"
        )
    if table.lines_left_out:
        shown = ", ".join(map(str, table.lines_left_out[:8]))
        more = len(table.lines_left_out) - 8
        notes.append(
            f"{path.name}: left out for being off the curve of the others: line {shown}"
            + (f" and {more} more" if more > 0 else "")
        )
    if "electrical" in table.columns["rotor_speed_rpm"].lower():
        notes.append(
            f"{path.name}: column {table.columns['rotor_speed_rpm']!r} is taken as the rotor's own "
            "speed; if it counts magnetic poles, divide it by half the number of poles"
        )
    return Fitted(quantities=made, notes=tuple(notes))


def hover_quantities(logs: Sequence[Path], craft: Airframe, reading: ReadingOptions) -> Fitted:
    """Fit the thrust coefficient to steady hover in `logs`, for the mass of `craft` and its load.

    If the largest rotor speed of `craft` is a guess, it is replaced by that of a climb at full
    output, else by the one extrapolated from outputs and rotor speeds. Flights without rotor speeds
    give only this one. Raises DataError or LogError if the flights give neither.
    """
    from thrustmargin.gcs_plugin.logs import read_sorties
    from thrustmargin.models.model.inferred.output_speed import (
        full_output_speed,
        reached_full_output,
    )
    from thrustmargin.models.physics.airframe import Quantity
    from thrustmargin.models.physics.atmosphere import SEA_LEVEL_DENSITY
    from thrustmargin.models.physics.thrust_fits import fit_hover

    keywords = reading_keywords(reading)
    read = [log for path in logs for log in read_sorties(path, airframe=craft, **keywords)]
    names = ", ".join(log.name for log in read)
    mass = f"{craft.empty_mass:g} kg" + (" and its liquid" if craft.tank_volume_l else "")
    made: dict[str, Quantity] = {}
    measured = any(log.track.reports("rotor_speed_rpm") for log in read)
    fit = fit_hover([log.track for log in read], craft) if measured else None
    if fit is not None:
        made["thrust_coefficient"] = Quantity(
            float(f"{fit.coefficient.value:.5g}"),
            "N/rpm^2",
            f"fitted: hover of {', '.join(fit.flights)} at {mass}, {interval(fit.coefficient)}",
        )
        made["reference_density"] = Quantity(
            float(f"{fit.reference_density:.5g}"),
            "kg/m^3",
            f"air of that hover, +- {fit.density_error:.2g}: {in_english(fit.air)}",
        )
        notes = hover_sentences(fit)
    else:
        # Kept as it is, or it would be made anew of the ceiling, which is found by it.
        made["thrust_coefficient"] = craft.quantities["thrust_coefficient"]
        notes = (
            f"no rotor speed in {names}: the thrust coefficient stays as it is, and the ceiling "
            "follows from motor outputs against the weight",
        )
    ceiling = craft.quantities["max_rotor_speed_rpm"]
    flights = [(log.track, log.parameters) for log in read]
    words = f"battery in flight, {names}"
    if ceiling.guessed and (reached := reached_full_output(flights, craft)) is not None:
        top, volts = reached
        made["max_rotor_speed_rpm"] = Quantity(
            round(top.value, 0), "rpm", f"measured: climb at full output, {names}, {interval(top)}"
        )
        made["ceiling_voltage"] = Quantity(round(volts, 2), "V", words)
    elif ceiling.guessed or not measured:
        try:
            top, volts = full_output_speed(flights, craft)
        except DataError as error:
            if fit is None:
                raise DataError(f"{names}: {error}") from error
            # The maker's thrust is one of standard air, the coefficient one of the hover's.
            standard = fit.coefficient.value * SEA_LEVEL_DENSITY / fit.reference_density
            made["max_rotor_speed_rpm"] = replace(
                ceiling, value=round((craft.nameplate_max_thrust / standard) ** 0.5, 0)
            )
        else:
            against = "rotor speeds" if measured else "the weight"
            source = f"extrapolated to full output from motor outputs and {against} of {names}, "
            source += interval(top)
            if fit is not None and not craft.quantities["nameplate_max_thrust"].guessed:
                standard = fit.coefficient.value * SEA_LEVEL_DENSITY / fit.reference_density
                sheet = (craft.nameplate_max_thrust / standard) ** 0.5
                top = with_data_sheet(top, sheet)
                source += f"; with {sheet:.0f} by the maker's thrust {interval(top)}"
            made["max_rotor_speed_rpm"] = Quantity(
                round(top.value, 0), "rpm", source, True, round(_thrust_error(top), 3)
            )
            made["ceiling_voltage"] = Quantity(round(volts, 2), "V", words)
            if fit is not None:
                notes += (_use_words(craft, fit, top),)
    return Fitted(quantities=made, notes=notes)


def with_data_sheet(top: Estimate, sheet_rpm: float) -> Estimate:
    """Combine two estimates of the largest rotor speed, rpm: extrapolated, and by the maker's
    thrust.

    `top` is extrapolated from flights, `sheet_rpm` the speed at the maker's largest thrust. Weights
    are inverse variances of ln thrust. The maker's thrust has the error GUESS, in quadrature with
    twice VOLTAGE_ERROR, since data sheets seldom state their voltage. If both differ by more than
    their combined error, the interval is widened by that ratio.
    """
    import numpy as np

    from thrustmargin.models.model.inferred.utilisation_error import GUESS, VOLTAGE_ERROR
    from thrustmargin.models.scores import Estimate

    errors = np.array([_thrust_error(top), np.hypot(GUESS, 2.0 * VOLTAGE_ERROR)])
    logs = 2.0 * np.log([top.value, sheet_rpm])
    weights = errors**-2.0 / np.sum(errors**-2.0)
    apart = abs(float(logs[1] - logs[0])) / float(np.hypot(*errors))
    error = float(np.sum(errors**-2.0)) ** -0.5 * max(apart, 1.0)
    middle = float(weights @ logs)
    low, value, high = (
        float(np.exp(0.5 * (middle + k * SIGMAS_95 * error))) for k in (-1.0, 0.0, 1.0)
    )
    return Estimate(value=value, low=low, high=high)


def _thrust_error(top: Estimate) -> float:
    """Return the standard error of ln thrust of a rotor speed from its 95 % interval."""
    return log(top.high / top.low) / SIGMAS_95


def _use_words(craft: Airframe, fit: HoverFit, top: Estimate) -> str:
    """Return the sentence on how uncertain an extrapolated largest thrust is, and how to measure
    it.

    `top` is the largest rotor speed, rpm; the uncertainty is given as the utilisation in hover at
    full mass.
    """
    from thrustmargin.models.physics.atmosphere import G0

    mass = craft.empty_mass + craft.tank_capacity_kg
    thrust = fit.coefficient.value * float(craft.rotor_effectiveness.sum())
    uses = [percent(mass * G0 / (thrust * speed**2)) for speed in (top.high, top.low)]
    return (
        f"full thrust is extrapolated, so a hover at {mass:.3g} kg uses {uses[0]} to {uses[1]} of "
        "it. A climb at full throttle for 3 s settles that: without liquid, full battery, calm "
        "air, nobody near and space above. Give its log to --hover too"
    )


def ceiling_notes(craft: Airframe) -> tuple[str, ...]:
    """Return a note if the largest thrust by the file's thrust curve differs from the maker's.

    It says which one is used. Empty if the relative difference is at most SAME_THRUST.
    """
    used = craft.thrust_coefficient * craft.max_rotor_speed_rpm**2
    if abs(used / craft.nameplate_max_thrust - 1.0) <= SAME_THRUST:
        return ()
    return (
        f"full thrust of a rotor: {craft.nameplate_max_thrust:.1f} N by its maker, {used:.1f} N by "
        "thrust curve and largest rotor speed of this file; margins use the latter, and a bench "
        "table (--bench) or a climb at full throttle would settle it",
    )


def hover_sentences(fit: HoverFit) -> tuple[str, ...]:
    """Return sentences on the hover: thrust of each rotor over its share, and the weight's offset,
    mm.

    A sentence is added if clockwise and counter-clockwise rotors differ, and one if there is only
    one flight.
    """
    trims = ", ".join(f"{n + 1}: {100 * t.value:.0f} %" for n, t in enumerate(fit.trim))
    place = ", ".join(
        f"{abs(e.value) * 1000:.0f} mm {forward if e.value >= 0 else back} "
        + (f"({abs(e.high - e.low) * 500:.0f} either way)" if e.bounded else f"({NO_INTERVAL})")
        for e, forward, back in zip(
            fit.load_place, ("forward", "right"), ("back", "left"), strict=True
        )
    )
    split = fit.yaw_split
    stands = split.low > 0.0 or split.high < 0.0
    sentences = [
        f"thrust of each rotor over its share, in hover: {trims}; by that the weight is {place}"
    ]
    if stands:
        more = "counter-clockwise" if split.value > 0 else "clockwise"
        sentences.append(
            f"the {more} rotors carry {interval_percent(split)} more of the weight than the "
            "others: a constant yaw moment, as of motors that are not level (`identify`: yaw trim)"
        )
    if len(fit.flights) == 1:
        sentences.append(
            "one flight only: another wind or temperature may move the coefficient by some percent "
            "more than its interval says"
        )
    return tuple(sentences)


def figure(x: float) -> str:
    """Return a number with four significant digits, and all before the point; "unknown" for NaN."""
    if not known(x):
        return UNKNOWN
    return f"{x:.0f}" if x >= 1e3 else f"{x:.4g}"


def interval(e: Estimate) -> str:
    """Return text such as `2.58e-06 (2.53e-06 to 2.63e-06)`.

    A remark replaces the interval where flights are too short for one.
    """
    value, low, high = map(figure, (e.value, e.low, e.high))
    return f"{value} ({low} to {high})" if e.bounded else f"{value} ({NO_INTERVAL})"


def interval_percent(e: Estimate) -> str:
    """Return text such as `12 % (9 to 15)` for a share, without its sign."""
    low, high = sorted((abs(e.low), abs(e.high)))
    return f"{100 * abs(e.value):.0f} % ({100 * low:.0f} to {100 * high:.0f})"
