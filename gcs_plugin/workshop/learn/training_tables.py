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
from thrustmargin.gcs_plugin.wording.language import Verbatim, decimal, percent, say
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
    """Return the tables and sentences to print about a trained model, in order.

    They are fitness, training domain, effects, interval and errors on held-out flights. Of a model
    without an interval or a training domain only the description is returned.
    """
    record, interval, domain = model.training, model.interval, model.training_domain
    if interval is None or domain is None:
        return [model.description]
    shown = model.good_flights
    parts: list[RenderableType] = [] if shown is None else [fitness_sentence(shown, model)]
    parts += [
        say(
            "{model}; airspeed {airspeed} m/s, tank {tank} kg",
            model=Verbatim(model.description),
            airspeed=f"{domain.airspeed[0]:.1f} to {domain.airspeed[1]:.1f}",
            tank=f"{domain.tank_kg[0]:.1f} to {domain.tank_kg[1]:.1f}",
        ),
        *effect_lines(model),
        *thermometer_lines(model),
        interval_sentence(interval),
    ]
    if shown is not None:
        parts += outlier_sentences(shown)
        title = say("The model on flights left out in turn")
        parts.append(_held_out_table(shown.errors, title))
    if record is not None:
        title = say("The network alone on flights left out in turn; it learns nothing of yaw turns")
        parts.append(_held_out_table(record.left_out, title))
        parts += [_split_table(record)] if record.splits else []
    return parts


def effect_lines(model: RotorModel) -> list[str]:
    """Return a line for each effect in the model, with its main parameters and 95 % intervals.

    A learnt curve has only the mode and channel it acts on, because its parameters mean nothing by
    themselves.
    """
    lines = []
    for record, placed in zip(model.effects, model.placed, strict=True):
        if placed.effect.name == NAME:
            where = unnamed_place(placed, model.airframe.rotor_names)
            lines.append(say("with what all flights repeat: {where}", where=where))
            continue
        values = []
        for p in placed.effect.parameters:
            if not p.detail:
                found = record.parameters[p.name]
                low, high = found.ci95
                unit = "" if p.unit == "1" else f" {p.unit}"
                values.append(f"{p.name} {found.value:.3g}{unit} ({low:.3g} to {high:.3g})")
        lines.append(
            say("with {effect}: {values}", effect=placed.effect.key, values=", ".join(values))
        )
    return lines


def thermometer_lines(model: RotorModel) -> list[str]:
    """Return one line on the correction of the air temperature in logs, K, and its error.

    Empty if the model has no correction.
    """
    one = model.thermometer
    if one is None:
        return []
    return [
        say(
            "air by the logs' thermometer less {warmer} K: so these flights agree better than in "
            "standard air ({error} K from flight to flight)",
            warmer=f"{one.warmer_k:.1f}",
            error=f"{one.error_k:.1f}",
        )
    ]


_SPLIT_CAPTION = (
    "The paper's are of its own flights, which are not public. It prints its split as "
    "0.75 : 0.15 : 0.15, which adds up to 1.05. Split by samples: rows at random, so the test "
    "has the neighbours of learnt rows; by flights: the test is on flights not seen. Loss: the "
    "lowest on validation"
)


def _split_table(record: records.TrainingRecord) -> Table:
    """Return the table of R², lowest loss and its epoch for each split of the data, and each rotor.

    The first row has the paper's values.
    """
    table = grid(
        ("", *map(say, ("training", "validation", "test", "loss", "epoch"))),
        title=say("R² of rotor speed, one network a split (0.70 : 0.15 : 0.15)"),
        caption=say(_SPLIT_CAPTION),
    )
    paper = (decimal(f"{value:.3f}") for value in PAPER_R2)
    lowest = decimal(f"{PAPER_LOWEST_LOSS}")
    table.add_row(say("the paper"), *paper, lowest, str(PAPER_BEST_EPOCH))
    for split in record.splits:
        sets = (split.training, split.validation, split.test)
        table.add_section()
        table.add_row(
            say(SPLIT_WORDS[split.split]),
            *(decimal(f"{part.r2:.3f}") for part in sets),
            decimal(f"{split.lowest_loss:.3f}"),
            say("{epoch} of {all}", epoch=split.best_epoch, all=split.epochs),
        )
        for i, values in enumerate(zip(*(part.r2_per_rotor for part in sets), strict=True), 1):
            shown = (decimal(f"{value:.3f}") for value in values)
            table.add_row(f"  {say('rotor {number}', number=i)}", *shown)
        table.add_row(f"  {say('flights')}", *(str(part.flights) for part in sets))
    return table


def _held_out_table(conditions: tuple[records.ConditionScore, ...], title: str) -> Table:
    """Return a table, headed `title`, of R² and RMSE, rpm, on held-out flights, a row for each
    condition.
    """
    rows = [
        (
            say(one.condition),
            str(one.score.rows),
            decimal(f"{one.score.r2:.3f}"),
            _pair_text(*one.score.r2_ci95),
            _pair_text(min(one.score.r2_per_rotor), max(one.score.r2_per_rotor)),
            f"{one.score.rmse_rpm:.0f}",
        )
        for one in conditions
    ]
    return grid(
        ("", say("rows"), "R²", "95 %", say("rotors"), "RMSE rpm"),
        rows,
        title=title,
        caption=say(
            "R² is the mean over rotors, its 95 % interval over flights drawn anew. In yaw turns: "
            "more than 5 deg/s within a second"
        ),
    )


def _pair_text(low: float, high: float) -> str:
    """Return `low, high` for a narrow column of the table, with three decimals.

    Below 0 two decimals suffice, because such a score is a failure anyway.
    """
    ends = (f"{value:.{2 if value < 0.0 else 3}f}" for value in (low, high))
    return say("{low}, {high}", **dict(zip(("low", "high"), ends, strict=True)))


def interval_sentence(interval: Interval) -> str:
    """Return the sentence on the interval: its nominal coverage, and that measured on held-out
    flights.

    With too few flights it says that there is no interval, or that its coverage could not be
    measured.
    """
    if interval.flights < FEWEST_FLIGHTS:
        return say("No interval: it needs at least {count} flights.", count=FEWEST_FLIGHTS)
    few = interval.flights < flights_needed(interval.coverage)
    how = say(", by Student's t from {count} flights", count=interval.flights) if few else ""
    measured, share = interval.measured, percent(interval.coverage)
    if measured is None:
        return say(
            "Interval for {share} of the rows of a new flight{how}; its coverage could not be "
            "measured, which needs {count} flights.",
            share=share,
            how=how,
            count=interval.flights + 1,
        )
    return say(
        "Interval for {share} of the rows of a new flight{how}: on flights left out it held {held} "
        "(worst flight {worst}, {below} of {all} flights below {share}); mean width {width}.",
        share=share,
        how=how,
        held=percent(measured.mean, 1),
        worst=percent(min(measured.per_flight)),
        below=sum(one < interval.coverage for one in measured.per_flight),
        all=len(measured.per_flight),
        width=f"{measured.width_rpm:.0f} rpm",
    )


#: Share of rotor speed: 10 % of thrust, which at the 50 % limit is 5 points of margin. A model that
#: is off by more cannot say on which side of the limit a flight is.
USABLE = 0.05

ODD = 0.05  # probability that a training on good flights reports an outlier
FEWEST_OTHERS = 3  # flights from which a scatter can be estimated

#: Mode in which flights differ most -> what to check.
CAUSES = {
    "collective": actions.STATE_LOAD,
    "roll": actions.SAME_PLACE,
    "pitch": actions.SAME_PLACE,
    "yaw": actions.LEVEL_OR_LEAVE_OUT,
}
OTHER_CAUSE = "leave out flights of an aircraft that was not in order"


def fitness_sentence(shown: records.GoodFlights, model: RotorModel) -> str:
    """Return the sentence that the model is usable, with its relative error on held-out flights.

    If it is not, or outside of turns only, the sentence says why and what to do.
    """
    whole, straight, turning = (
        _relative_error(shown, condition)
        for condition in ("all rows", "outside yaw turns", "in yaw turns")
    )
    most = straight if straight is not None else whole
    assert most is not None
    words = "rotor speed to {share}" if turning is None else "rotor speed to {share} outside turns"
    reach = say(words, share=_percent(most))
    words = "RMS on {count} flights, each predicted by a model made without it"
    known = {"tested": say(words, count=shown.flights)}
    if most > USABLE:
        words = "not usable: {reach} ({tested}), because {why}"
        return say(words, reach=reach, why=Verbatim(main_error_words(shown, model)), **known)
    if turning is None:
        return say("usable: {reach} ({tested})", reach=reach, **known)
    reach = say("{reach}, {share} in turns", reach=reach, share=_percent(turning))
    if turning > USABLE:
        words = "usable outside turns only: {reach} ({tested}), because {why}"
        return say(words, reach=reach, why=Verbatim(main_error_words(shown, model)), **known)
    return say("usable: {reach} ({tested})", reach=reach, **known)


def main_error_words(shown: records.GoodFlights, model: RotorModel) -> str:
    """Return the largest part of the error on held-out flights in words, and what to do about it.

    It is one flight, a difference between flights, missing turn rates, or an unknown cause.
    """
    squares = {name: rmse**2 for name, rmse in shown.flight_rmse_rpm.items()}
    worst = max(squares, key=lambda name: squares[name])
    if squares[worst] > 0.5 * sum(squares.values()):
        off = _percent(shown.flight_rmse_rpm[worst] / shown.mean_speed_rpm)
        words = "{log} alone is off by {off}: leave it out, or give more flights like it"
        return say(words, log=Verbatim(worst), off=off)
    between = np.square(shown.mode_scatter_rpm) / model.airframe.rotor_count
    if between.sum() > 0.5 * np.mean(list(squares.values())):
        mode = modes(model.airframe).names[int(np.argmax(between))]
        cause = CAUSES[mode].text if mode in CAUSES else say(OTHER_CAUSE)
        words = "flights differ from each other, most in {mode}: {cause}"
        return say(words, mode=say(mode), cause=cause)
    if not any(record.name == "manoeuvre_moment" for record in model.effects):
        return say("what turning takes is not known: give logs with turn rates (ATTITUDE at 4 Hz)")
    return say("the channels do not say what changes: thrustmargin identify LOG... --model FILE")


def outlier_sentences(shown: records.GoodFlights) -> list[str]:
    """Return a sentence for each flight with an unusually large RMSE, whose aircraft may be faulty.

    The logarithm of its RMSE is above Student's prediction interval of the other flights; the
    probability of a false sentence is ODD over all flights. Empty with fewer than FEWEST_OTHERS
    other flights.
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
            words = (
                "look at {log}: off by {off}, the others by {usual}; if the aircraft was not in "
                "order, train without it"
            )
            sentences.append(say(words, log=Verbatim(name), off=off, usual=usual))
    return sentences


def _relative_error(shown: records.GoodFlights, condition: str) -> float | None:
    """Return the RMSE of a condition over the mean rotor speed; None if it was not scored."""
    for one in shown.errors:
        if one.condition == condition:
            return one.score.rmse_rpm / shown.mean_speed_rpm
    return None


def _percent(share: float) -> str:
    """Return a share as a percentage with two significant digits."""
    return decimal(f"{100 * share:.2g} %")
