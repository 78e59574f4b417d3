"""What the live view says beside the gauges: alarms, age, outlook, link. Safe for any text."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from typing import TYPE_CHECKING

from thrustmargin.gcs_plugin.live.alarms.alarm import CRITICAL, WARNING, Alarm
from thrustmargin.gcs_plugin.live.link_vehicles import OLD
from thrustmargin.gcs_plugin.live.watch.outlook import Outlook
from thrustmargin.gcs_plugin.wording import live_words
from thrustmargin.gcs_plugin.wording import palette as colours
from thrustmargin.gcs_plugin.wording import view_words as words

if TYPE_CHECKING:
    from thrustmargin.gcs_plugin.live.watch.update import Update
    from thrustmargin.gcs_plugin.telemetry.recording import Waypoint

#: White on each is read in sunlight: contrast 7:1 and more.
RED, ORANGE, GREY = colours.css(colours.ALARM), "#8a3a00", "#4d4d4d"
#: Of a flight's verdict by its level.
VERDICT_PAPER = {
    **dict.fromkeys(("damaged", "lost", "battery", "no_thrust", "critical"), RED),
    **dict.fromkeys(("over", "near"), ORANGE),
    "under": "#00512d",
}
#: Tabs that a gloved finger hits.
STYLE = "<style>[role=tablist]{font:700 20px system-ui!important}</style>"
MOST_ALARMS = 4  # on one page: more would push the numbers off it


@dataclass(frozen=True, slots=True, kw_only=True)
class Standing:
    """One aircraft as it was last heard, for all pages: every page shows the alarms of all."""

    number: int
    update: Update | None = None  # its last rows
    alarms: tuple[Alarm, ...] = ()  # worst first
    margin: float = math.nan  # of the worst rotor; in the air only
    coloured: float = math.nan  # the margin by which that is coloured
    rests_on: str = words.WORST_ROTOR  # what it rests on, or why it is unknown
    tank_kg: float = math.nan
    flying: bool = False
    age: float = 0.0  # s of the newest row
    old_s: float = OLD  # from which it is old
    silent: float = 0.0  # s since anything was heard of it, analysed or not
    problem: str = ""  # why there is no margin
    pending: str = ""  # why its alarms are not yet known
    gone: bool = False  # left for good: nothing of it is shown
    stale: str = ""  # fields that are no longer reported, in words
    mission: Mapping[int, Waypoint] | None = None

    @property
    def faulty(self) -> frozenset[int]:
        """Numbers, from 1, of the rotors that an alarm is of."""
        return frozenset(alarm.rotor for alarm in self.alarms if alarm.rotor is not None)

    @property
    def old(self) -> bool:
        return self.age > self.old_s

    @property
    def age_words(self) -> str:
        """Whether the vehicle is silent, or only its figures are late."""
        return words.age_words(self.age, silent=self.silent > OLD)

    @property
    def stamp_us(self) -> int:
        """Ground's clock of its last row; 0 without one."""
        return 0 if self.update is None else int(self.update.stamp_us[-1])

    def as_drawn(self, drawn: Standing | None) -> Standing:
        """With the figures that its gauges show, so that no two places on the page differ."""
        if drawn is None:
            return self
        names = ("update", "margin", "coloured", "rests_on", "tank_kg", "flying")
        age = self.age + (self.stamp_us - drawn.stamp_us) * 1e-6
        return replace(self, age=age, **{name: getattr(drawn, name) for name in names})

    @property
    def shown(self) -> tuple[tuple[Alarm, ...], str, bool]:
        """What is shown of it on the pages of the others too."""
        return self.alarms, self.problem, self.gone


def alarms_html(number: int, fleet: Sequence[Standing]) -> str:
    """Every alarm that stands, above the gauges of `number`, most severe first, then its own.

    Those of the others are shown too: the pilot sees one tab. So is the age of old numbers.
    """
    every = [(one.number, alarm) for one in fleet if not one.gone for alarm in one.alarms]
    every.sort(key=lambda item: (item[1].order[:3], item[0] != number, item[0], item[1].since_s))
    lines = []
    for of, alarm in every[:MOST_ALARMS]:
        text = alarm.line if of == number else words.of_vehicle(of, alarm.line)
        lines.append(
            f'<div data-alarm style="background:{paper_of(alarm.severity)};padding:3px 8px;'
            f'margin-bottom:3px">{escape(text)}</div>'
        )
    if len(every) > MOST_ALARMS:
        lines.append(
            f'<div style="color:{RED}">{words.more_alarms(len(every) - MOST_ALARMS)}</div>'
        )
    for one in fleet:
        if one.problem and not one.gone:
            own = one.number == number
            text = one.problem if own else words.of_vehicle(one.number, one.problem)
            lines.append(f'<div data-problem style="background:{RED}">{escape(text)}</div>')
        if one.number == number and one.old:
            lines.append(f'<div data-age style="background:{GREY}">{one.age_words}</div>')
    style = "color:#fff;font:700 21px/1.15 system-ui;margin:4px 8px"
    return f'<div style="{style}">{"".join(lines)}</div>' if lines else ""


def paper_of(severity: int) -> str:
    """The background of an alarm by its MAV_SEVERITY; white is read on it."""
    if severity <= CRITICAL:
        return RED
    return ORANGE if severity <= WARNING else GREY


def fleet_html(fleet: Sequence[Standing]) -> str:
    """One bar an aircraft, to be read at a glance; nothing for one alone, which has its gauges."""
    shown = [one for one in fleet if not one.gone]
    if len(shown) < 2:
        return ""
    return "".join(_bar(one) for one in shown)


def _bar(one: Standing) -> str:
    unknown = one.old or one.problem or not one.flying
    paper = colours.MARGIN.screen(math.nan if unknown else one.coloured)
    if one.problem:
        big, small = words.NO_MARGIN, ""
    elif one.old:
        big, small = words.age_short(one.age, silent=one.silent > OLD), ""
    elif not one.flying:
        big, small = live_words.ON_GROUND, kilograms(one.tank_kg)
    else:
        big, small = words.share_words(one.margin), kilograms(one.tank_kg)
    worst = min((alarm.severity for alarm in one.alarms), default=None)
    bell = (
        ""
        if worst is None
        else f'<span data-bell style="background:{paper_of(worst)};color:#fff;padding:0 9px;'
        f'border-radius:4px">{len(one.alarms)} !</span>'
    )
    return (
        f'<div data-fleet="{one.number}" style="display:flex;justify-content:space-between;'
        f"align-items:center;gap:8px;margin:4px 10px;padding:2px 10px;border:2px solid #111;"
        f"border-radius:6px;font:800 27px system-ui;white-space:nowrap;"
        f'background:{colours.css(paper)};color:{colours.ink_on(paper)}">'
        f"<span>{one.number}</span><span>{escape(big)}</span>"
        f'<span style="font-size:19px">{escape(small)}</span>{bell}</div>'
    )


def kilograms(mass: float) -> str:
    """A mass as kg with one digit; nothing for NaN."""
    return f"{mass:.1f} kg" if math.isfinite(mass) else ""


def aged(html: str, old: bool) -> str:
    """Faint when it is old: an old number must not pass for a new one."""
    return f'<div data-old style="opacity:.35">{html}</div>' if old else html


def outlook_html(outlook: Outlook, stale: str = "", remarks: Sequence[str] = ()) -> str:
    """Time to empty, the least margin ahead and the margin after a refill, as far as known.

    `stale` says which fields are no longer reported; `remarks` what the numbers rest on.
    """
    parts = []
    if math.isfinite(outlook.seconds_to_empty):
        parts.append(words.empties_in(outlook.seconds_to_empty))
    if math.isfinite(outlook.margin_ahead):
        parts.append(words.margin_ahead(outlook.margin_ahead))
    if math.isfinite(outlook.margin_full):
        parts.append(words.margin_full(outlook.margin_full))
    lines = "".join(f"<div>{escape(part)}</div>" for part in parts)
    if stale:
        lines += f'<div data-stale style="color:{RED}">{escape(stale)}</div>'
    small = "".join(f"<div>{escape(line)}</div>" for line in remarks)
    return (
        f'<div class="tm"><div class="txt" data-gauge="outlook">{lines}</div>'
        f'<div class="small" data-remarks>{small}</div></div>'
    )


def status_html(lines: Sequence[str]) -> str:
    """Lines about link and recording; what is lost for good stands out."""
    loud = f'style="background:{RED};color:#fff;font:700 21px system-ui;padding:3px 8px"'
    loud_lines = live_words.NOT_RECORDING, live_words.BEHIND
    body = "".join(
        f"<div {loud if line.startswith(loud_lines) else ''}>{escape(line)}</div>" for line in lines
    )
    return (
        '<div data-status style="font:500 13px system-ui;color:#111;margin:2px 10px;'
        f'overflow-wrap:anywhere">{body}</div>'
    )
