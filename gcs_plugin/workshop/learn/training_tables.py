"""Write what `train` prints about a trained model, for its maintainer.

It states first whether the model is fit for use on flights it has not seen, then the paper's table
with this model's values, and where the error is.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.special import stdtrit

from thrustmargin.gcs_plugin.reports.shared.page_shell import grid
from thrustmargin.gcs_plugin.wording import actions
from thrustmargin.gcs_plugin.wording.effect_sentences import unnamed_place
from thrustmargin.models.effects.unnamed import NAME
from thrustmargin.models.identification.rows.modes import modes
from thrustmargin.models.model.rotor_model import RotorModel
from thrustmargin.models.model.training import PAPER_BEST_EPOCH, PAPER_LOWEST_LOSS, PAPER_R2
from thrustmargin.models.network import records
from thrustmargin.models.network.validity import FEWEST_FLIGHTS, Interval, flights_needed

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table


SPLIT_WORDS = {"samples": "samples, as the paper", "flights": "flights"}


def training_tables(model: RotorModel) -> list[RenderableType]:
    """Return tables and sentences about a trained model, in the order to print them.

    A model without an interval or training domain has only its description.
    """
    record, interval, domain = model.training, model.interval, model.training_domain
    if interval is None or domain is None:
        return [model.description]
    shown = model.good_flights
    parts: list[RenderableType] = [] if shown is None else [fitness_sentence(shown, model)]
    parts += [
        f"{model.description}; "
        f"airspeed {domain.airspeed[0]:.1f} to {domain.airspeed[1]:.1f} m/s, "
        f"tank {domain.tank_kg[0]:.1f} to {domain.tank_kg[1]:.1f} kg",
        *effect_lines(model),
        *thermometer_lines(model),
        interval_sentence(interval),
    ]
    if shown is not None:
        parts += outlier_sentences(shown)
        parts.append(_held_out_table(shown.errors, "The model on flights left out in turn"))
    if record is not None:
        title = "The network alone on flights left out in turn; it learns nothing of yaw turns"
        parts.append(_held_out_table(record.left_out, title))
        parts += [_split_table(record)] if record.splits else []
    return parts


def effect_lines(model: RotorModel) -> list[str]:
    """Return a line for each effect of the model: its main parameters with 95 % intervals.

    A curve without a name has its place alone, because its knots mean nothing by themselves.
    """
    lines = []
    for record, placed in zip(model.effects, model.placed, strict=True):
        if placed.effect.name == NAME:
            where = unnamed_place(placed, model.airframe.rotor_names)
            lines.append(f"with what all flights repeat: {where}")
            continue
        values = []
        for p in placed.effect.parameters:
            if not p.detail:
                found = record.parameters[p.name]
                low, high = found.ci95
                unit = "" if p.unit == "1" else f" {p.unit}"
                values.append(f"{p.name} {found.value:.3g}{unit} ({low:.3g} to {high:.3g})")
        lines.append(f"with {placed.effect.key}: {', '.join(values)}")
    return lines


def thermometer_lines(model: RotorModel) -> list[str]:
    """Return the line about the correction of the logs' thermometer; empty without one."""
    one = model.thermometer
    if one is None:
        return []
    return [
        f"air by the logs' thermometer less {one.warmer_k:.1f} K: so these flights agree better "
        f"than in standard air ({one.error_k:.1f} K from flight to flight)"
    ]


def _split_table(record: records.TrainingRecord) -> Table:
    """Return the table of R² and loss for each split, with the paper's values in the first row."""
    table = grid(
        ("", "training", "validation", "test", "loss", "epoch"),
        title="R² of rotor speed, one network a split (0.70 : 0.15 : 0.15)",
        caption="The paper's are of its own flights, which are not public. It prints its split as "
        "0.75 : 0.15 : 0.15, which adds up to 1.05. Split by samples: rows at random, so the test "
        "has the neighbours of learnt rows; by flights: the test is on flights not seen. Loss: the "
        "lowest on validation",
    )
    paper = (f"{value:.3f}" for value in PAPER_R2)
    table.add_row("the paper", *paper, f"{PAPER_LOWEST_LOSS}", str(PAPER_BEST_EPOCH))
    for split in record.splits:
        sets = (split.training, split.validation, split.test)
        table.add_section()
        table.add_row(
            SPLIT_WORDS[split.split],
            *(f"{part.r2:.3f}" for part in sets),
            f"{split.lowest_loss:.3f}",
            f"{split.best_epoch} of {split.epochs}",
        )
        for i, values in enumerate(zip(*(part.r2_per_rotor for part in sets), strict=True), 1):
            table.add_row(f"  rotor {i}", *(f"{value:.3f}" for value in values))
        table.add_row("  flights", *(str(part.flights) for part in sets))
    return table


def _held_out_table(conditions: tuple[records.ConditionScore, ...], title: str) -> Table:
    """Return the table of R² and RMSE on held-out flights, a row for each condition."""
    rows = [
        (
            one.condition,
            str(one.score.rows),
            f"{one.score.r2:.3f}",
            _pair_text(*one.score.r2_ci95),
            _pair_text(min(one.score.r2_per_rotor), max(one.score.r2_per_rotor)),
            f"{one.score.rmse_rpm:.0f}",
        )
        for one in conditions
    ]
    return grid(
        ("", "rows", "R²", "95 %", "rotors", "RMSE rpm"),
        rows,
        title=title,
        caption="R² is the mean over rotors, its 95 % interval over flights drawn anew. In yaw "
        "turns: more than 5 deg/s within a second",
    )


def _pair_text(low: float, high: float) -> str:
    """Return two numbers for a narrow column; below 0 with two decimals, because it is a failure
    anyway."""
    return ", ".join(f"{value:.{2 if value < 0.0 else 3}f}" for value in (low, high))


def interval_sentence(interval: Interval) -> str:
    """Return the sentence about the interval's nominal and measured coverage, or about why there is
    none."""
    if interval.flights < FEWEST_FLIGHTS:
        return f"No interval: it needs at least {FEWEST_FLIGHTS} flights."
    few = interval.flights < flights_needed(interval.coverage)
    how = f", by Student's t from {interval.flights} flights" if few else ""
    measured = interval.measured
    if measured is None:
        return (
            f"Interval for {100 * interval.coverage:.0f} % of the rows of a new flight{how}; its "
            "coverage "
            f"could not be measured, which needs {interval.flights + 1} flights."
        )
    below = sum(share < interval.coverage for share in measured.per_flight)
    return (
        f"Interval for {100 * interval.coverage:.0f} % of the rows of a new flight{how}: on "
        f"flights left out it held {100 * measured.mean:.1f} % "
        f"(worst flight {100 * min(measured.per_flight):.0f} %, "
        f"{below} of {len(measured.per_flight)} flights below {100 * interval.coverage:.0f} %); "
        f"mean width {measured.width_rpm:.0f} rpm."
    )


#: Share of rotor speed: 10 % of thrust, which at the 50 % limit is 5 points of margin. A model that
#: is off by more cannot say on which side of the limit a flight is.
USABLE = 0.05

ODD = 0.05  # probability that a training on good flights reports an outlier
FEWEST_OTHERS = 3  # flights from which a scatter can be estimated

#: Mode in which flights differ most -> what to check.
CAUSES = {
    "collective": actions.STATE_LOAD.text,
    "roll": actions.SAME_PLACE.text,
    "pitch": actions.SAME_PLACE.text,
    "yaw": actions.LEVEL_OR_LEAVE_OUT.text,
}


def fitness_sentence(shown: records.GoodFlights, model: RotorModel) -> str:
    """Return the sentence about whether the model is usable, with its error, or about the reason
    and the remedy."""
    whole, straight, turning = (
        _relative_error(shown, condition)
        for condition in ("all rows", "outside yaw turns", "in yaw turns")
    )
    most = straight if straight is not None else whole
    assert most is not None
    reach = f"rotor speed to {_percent(most)}" + ("" if turning is None else " outside turns")
    tested = f"RMS on {shown.flights} flights, each predicted by a model made without it"
    if most > USABLE:
        return f"not usable: {reach} ({tested}), because {main_error_words(shown, model)}"
    if turning is None:
        return f"usable: {reach} ({tested})"
    reach += f", {_percent(turning)} in turns"
    if turning > USABLE:
        because = main_error_words(shown, model)
        return f"usable outside turns only: {reach} ({tested}), because {because}"
    return f"usable: {reach} ({tested})"


def main_error_words(shown: records.GoodFlights, model: RotorModel) -> str:
    """Return the words about the largest part of the error, and what to do about it."""
    squares = {name: rmse**2 for name, rmse in shown.flight_rmse_rpm.items()}
    worst = max(squares, key=lambda name: squares[name])
    if squares[worst] > 0.5 * sum(squares.values()):
        off = _percent(shown.flight_rmse_rpm[worst] / shown.mean_speed_rpm)
        return f"{worst} alone is off by {off}: leave it out, or give more flights like it"
    between = np.square(shown.mode_scatter_rpm) / model.airframe.rotor_count
    if between.sum() > 0.5 * np.mean(list(squares.values())):
        mode = modes(model.airframe).names[int(np.argmax(between))]
        cause = CAUSES.get(mode, "leave out flights of an aircraft that was not in order")
        return f"flights differ from each other, most in {mode}: {cause}"
    if not any(record.name == "manoeuvre_moment" for record in model.effects):
        return "what turning takes is not known: give logs with turn rates (ATTITUDE at 4 Hz)"
    return "the channels do not say what changes: thrustmargin identify LOG... --model FILE"


def outlier_sentences(shown: records.GoodFlights) -> list[str]:
    """Return a sentence for each flight whose RMSE is unusually large, in case the aircraft was not
    in order.

    Its logarithm is above Student's prediction interval of the other flights, with a probability of
    a false one of ODD over all flights. Empty with fewer than FEWEST_OTHERS other flights.
    """
    logs = np.log(list(shown.flight_rmse_rpm.values()))
    sentences = []
    for k, (name, rmse) in enumerate(shown.flight_rmse_rpm.items()):
        rest = np.delete(logs, k)
        if rest.size < FEWEST_OTHERS:
            continue
        spread = np.std(rest, ddof=1) * np.sqrt(1.0 + 1.0 / rest.size)
        limit = stdtrit(rest.size - 1, 1.0 - ODD / logs.size) * spread
        if logs[k] - rest.mean() > limit:
            off, usual = (_percent(v / shown.mean_speed_rpm) for v in (rmse, np.exp(rest.mean())))
            sentences.append(
                f"look at {name}: off by {off}, the others by {usual}; if the aircraft was not in "
                "order, train without it"
            )
    return sentences


def _relative_error(shown: records.GoodFlights, condition: str) -> float | None:
    """Return the RMSE of a condition over the mean rotor speed; None if it was not scored."""
    for one in shown.errors:
        if one.condition == condition:
            return one.score.rmse_rpm / shown.mean_speed_rpm
    return None


def _percent(share: float) -> str:
    """Return a share as a percentage with two significant digits."""
    return f"{100 * share:.2g} %"
