"""What the pilot reads: big numbers with units, the worst rotor by name, and what they rest on.

Pure functions from a row to HTML. Black on white, because in sunlight only contrast survives. Text
that came from a log or an airframe file is escaped here; numbers that are unknown read "no data".
"""

from __future__ import annotations

from html import escape

import numpy as np

from thrustmargin.gcs_plugin.view.aircraft import tank_level
from thrustmargin.gcs_plugin.view.shown_row import ShownRow
from thrustmargin.gcs_plugin.wording import palette as colours
from thrustmargin.models.model.analysis import MEASURED
from thrustmargin.models.model.load_inference import STATED
from thrustmargin.models.model.utilisation_error import INTERVAL
from thrustmargin.models.physics.airframe import Airframe

#: Up to so many rotors have large boxes; more are drawn compactly, to fit a small laptop.
FEW_ROTORS = 4
#: The look of all gauges; a page needs it once.
STYLE = """<style>
.tm{font-family:system-ui,"DejaVu Sans",sans-serif;color:#111;padding:0 8px 8px;line-height:1.15}
.tm .big{font-size:84px;font-weight:800;letter-spacing:-3px;line-height:1}
.tm .mid{font-size:36px;font-weight:800;white-space:nowrap;letter-spacing:-1px}
.tm .cap{font-size:13px;font-weight:700;text-transform:uppercase;letter-spacing:.3px}
.tm .txt{font-size:17px;font-weight:600}
.tm .small{font-size:13px;font-weight:600}
.tm .box{border:2px solid #111;border-radius:6px;padding:6px 10px}
.tm .bar{position:relative;height:18px;background:#e4e4e4;border:1px solid #111;margin:3px 0}
.tm .bar>b{position:absolute;left:0;top:0;bottom:0}
.tm .bar>i{position:absolute;top:-4px;bottom:-4px;width:3px;margin-left:-1px;background:#111}
.tm .rank{display:flex;gap:7px;margin-top:7px}
.tm .side{flex:1;display:flex;flex-direction:column;gap:7px;min-width:0}
.tm .side>.box{flex:1}
.tm .many .rank,.tm .many .side{gap:5px}
.tm .many .rank{margin-top:5px}
.tm .many .box{padding:1px 8px;display:grid;grid-template-columns:auto 1fr;column-gap:8px;
align-items:center}
.tm .many .txt,.tm .many .small{grid-column:span 2;font-size:13px;white-space:nowrap;
overflow:hidden}
.tm .many .mid{font-size:26px}
.tm .many .small{font-size:11px}
.tm .many .small br{display:none}
.tm .said{font-size:15px;font-weight:600;margin-top:8px;border-left:6px solid #c8146e;
padding-left:8px;overflow-wrap:anywhere}
.tm .why{font-size:14px;overflow-wrap:anywhere}
.tm .worst{outline:4px solid #111;outline-offset:-2px}
</style>"""


def gauges_html(row: ShownRow, title: str, message: str = "") -> str:
    """All gauges of one aircraft at one moment, to stand on a page with `STYLE`.

    `title` is its name and `message` what it last said; both may hold anything, they are escaped.
    """
    airframe = row.analysis.model.airframe
    state = "flying" if row.flying else "on the ground"
    said = f'<div class="said" data-gauge="message">{escape(message)}</div>' if message else ""
    return (
        f'<div class="tm"><div class="small">{escape(title)} · {state}</div>'
        f"{_worst_box(row, airframe)}"
        f'<div class="rank"><div class="side">{_redundancy_box(row)}</div>'
        f'<div class="side">{_tank_box(row, airframe)}</div></div>'
        f"{_rotor_boxes(row, airframe)}{_rest(row)}{said}</div>"
    )


def _worst_box(row: ShownRow, airframe: Airframe) -> str:
    margin, worst = row.worst
    caption = "Thrust margin, worst rotor"
    claim = row.analysis.claim
    if claim.withheld:
        why = "<br>".join(escape(words) for words in (*claim.withheld, claim.remedy))
        return _box("worst", caption, "NO VERDICT", f'<span class="why">{why}</span>')
    if worst is None:
        return _box("worst", caption, "no data", "no rotor speed and no prediction")
    if not row.flying:
        return _ground_box(row)
    unknown = int(np.sum(~row.measured)) if row.measured.any() else 0
    words = f"rotor {worst + 1}, {escape(airframe.rotor_names[worst])} · {_source(row, worst)}"
    if unknown:
        words += f" · {unknown} rotor{'s' if unknown > 1 else ''} not measured"
    error = float(row.error[worst])
    if error > 0.0:
        words = f"{percent(margin - error)} to {percent(margin + error)} · {words}"
    return _big_box(caption, margin, words)


def _ground_box(row: ShownRow) -> str:
    """At rest a rotor has all its thrust left, which says nothing: what it will have in the air."""
    margin = row.margin_predicted
    least = float(np.nanmin(margin)) if np.isfinite(margin).any() else np.nan
    return _big_box("On the ground: margin in the air", least, "predicted for this load")


def _big_box(caption: str, margin: float, words: str) -> str:
    paper = colours.MARGIN.screen(margin)
    return (
        f'<div class="box" data-gauge="worst" style="margin-top:5px;'
        f'background:{colours.css(paper)};color:{colours.ink_on(paper)}">'
        f'<div class="cap">{caption}</div>'
        f'<div class="big">{percent(margin)}</div><div class="txt">{words}</div></div>'
    )


def _redundancy_box(row: ShownRow) -> str:
    free = row.analysis.redundancy_yaw_uncontrolled[row.row]
    kept = row.analysis.redundancy_yaw_kept[row.row]
    caption = "One rotor lost"
    if not np.isfinite(free):
        why = "airframe not known" if row.analysis.withheld else "load or weight unknown"
        return _box("redundancy", caption, "no data", why)
    if np.isfinite(kept) and kept >= 1.0:
        verdict = "holds height and heading"
    elif free >= 1.0:
        verdict = "holds height, not heading"
    else:
        verdict = "CANNOT hold height"
    paper = colours.REDUNDANCY.screen(free)
    return _box(
        "redundancy",
        caption,
        f"{free:.2f} x",
        f"the weight: {verdict}",
        style=f"background:{colours.css(paper)};color:{colours.ink_on(paper)}",
    )


def _tank_box(row: ShownRow, airframe: Airframe) -> str:
    tank_kg = row.track.tank_kg[row.row]
    level = tank_level(tank_kg, airframe.tank_capacity_kg)
    if not np.isfinite(tank_kg):
        return _box("tank", "Tank", "no data", "no gauge and no pump reported")
    if not np.isfinite(level):
        return _box("tank", "Tank", f"{tank_kg:.1f} kg", "its size is not known")
    bar = f'<div class="bar"><b style="width:{100 * level:.0f}%;background:#006e82"></b></div>'
    words = f"{100 * level:.0f} % of {airframe.tank_capacity_kg:g} kg"
    error = row.track.standard_errors.get("tank_kg")
    if error is not None and error[row.row] > 0.0:
        words += f", inferred, ± {INTERVAL * error[row.row]:.1f} kg"
    elif row.track.sources.get("tank_kg", "").startswith(STATED):
        words += f", {STATED}"
    return _box("tank", "Tank", f"{tank_kg:.1f} kg", words, after=bar)


def _rotor_boxes(row: ShownRow, airframe: Airframe) -> str:
    """Boxes where the rotors are: front at the top, left on the left."""
    html = []
    for rank in rotor_ranks(airframe):
        sides = "".join(
            f'<div class="side">{"".join(_rotor_box(i, row, airframe) for i in side)}</div>'
            for side in rank
        )
        html.append(f'<div class="rank">{sides}</div>')
    size = "many" if airframe.rotor_count > FEW_ROTORS else "few"
    return f'<div class="{size}">{"".join(html)}</div>'


def rotor_ranks(airframe: Airframe) -> list[list[list[int]]]:
    """Rotor indices as they sit: ranks from the front, in each the places from the left.

    Rotors at one place (a coaxial pair) share it.
    """
    forward, right = airframe.rotor_position_frd[:, :2].T
    step = 0.2 * airframe.arm
    ranks: dict[int, dict[int, list[int]]] = {}
    for i in range(airframe.rotor_count):
        rank = ranks.setdefault(-round(float(forward[i]) / step), {})
        rank.setdefault(round(float(right[i]) / step), []).append(i)
    return [[sides for _, sides in sorted(rank.items())] for _, rank in sorted(ranks.items())]


def _rotor_box(i: int, row: ShownRow, airframe: Airframe) -> str:
    margin = float(row.margin[i])
    turn = "turns left (CCW)" if airframe.rotor_spin[i] > 0 else "turns right (CW)"
    ink = colours.css(colours.MARGIN.screen(margin))
    width = 100 * float(np.clip(margin, 0, 1)) if np.isfinite(margin) else 0.0
    mark = " worst" if row.worst[1] == i else ""
    measured = row.track.rotor_speed_rpm[row.row, i]
    predicted = row.analysis.prediction.rotor_speed_rpm[row.row, i]
    speed = f"{rpm(measured)} / {rpm(predicted)} rpm"
    return (
        f'<div class="box{mark}" data-gauge="rotor-{i + 1}" title="{turn}">'
        f'<div class="txt"><b>{i + 1}</b> {escape(airframe.rotor_names[i])}</div>'
        f'<div class="mid">{percent(margin)}</div>'
        f'<div class="bar"><b style="width:{width:.0f}%;background:{ink}"></b>'
        f'<i style="left:50%"></i></div>'
        f'<div class="small">{_source(row, i)}<br> {speed}</div></div>'
    )


def _rest(row: ShownRow) -> str:
    parts = [
        ("airspeed", row.track.airspeed, "m/s"),
        ("height", row.track.height_agl, "m"),
        ("battery", row.track.voltage, "V"),
    ]
    words = " · ".join(
        f"{name} {f'{values[row.row]:.1f} {unit}' if np.isfinite(values[row.row]) else 'no data'}"
        for name, values, unit in parts
    )
    shown = f"rpm: {row.analysis.words_of_speed} / predicted · bar mark: 50 % limit"
    rotors = f'<div class="small">{shown}</div>' if row.track.rotor_count else ""
    return (
        f'<div class="txt" style="margin-top:8px">{words}</div>{rotors}'
        f'<div class="small" data-gauge="airframe">{escape(row.analysis.claim.words)}</div>'
    )


def _box(
    key: str, caption: str, number: str, words: str, *, style: str = "", after: str = ""
) -> str:
    return (
        f'<div class="box" data-gauge="{key}" style="{style}">'
        f'<div class="cap">{caption}</div><div class="mid">{number}</div>'
        f'<div class="txt">{words}</div>{after}</div>'
    )


def _source(row: ShownRow, i: int) -> str:
    """What a rotor's margin rests on; underlined unless it is a measurement."""
    basis = row.basis(i) or "no data"
    return basis if basis == MEASURED else f"<u>{basis}</u>"


def percent(share: float) -> str:
    """A share as whole per cent, "no data" for NaN."""
    return f"{100 * share:.0f} %" if np.isfinite(share) else "no data"


def rpm(speed: float) -> str:
    """A rotor speed as whole rpm, "no data" for NaN."""
    return f"{speed:.0f}" if np.isfinite(speed) else "no data"
