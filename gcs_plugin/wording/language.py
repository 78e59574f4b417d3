"""Translate sentences and write numbers for people, in the language that the user chose.

Sentences are written in English where they are made. `de.po` in this folder, a file of gettext,
holds the German of each, with the same {placeholders}; a sentence that it lacks stays English.
The language is chosen by `--language de` with any command, or by the variable
THRUSTMARGIN_LANGUAGE, as for MAVProxy and services.

Numbers are rounded and carry their unit; NaN and None are "unknown".

Text that others wrote, in a log or on a link, is made printable, so that it cannot control a
terminal. Every command loads this file, so it imports neither numpy nor pymavlink.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from importlib import resources
from typing import TypeGuard

from thrustmargin.models.errors import DataError

#: The first is what a browser of another language is shown.
LANGUAGES = ("en", "de")
VARIABLE = "THRUSTMARGIN_LANGUAGE"

#: The language that a page asks for, in the thread or task that answers it; empty for none.
_ASKED: ContextVar[str] = ContextVar("language", default="")


@contextmanager
def speaking(code: str) -> Iterator[None]:
    """Set the language within the `with` block, for this thread or asyncio task only.

    It serves web requests, whose browsers ask for a language. A `code` that is not in LANGUAGES
    selects none: the program's own language applies.
    """
    token = _ASKED.set(code if code in LANGUAGES else "")
    try:
        yield
    finally:
        _ASKED.reset(token)


def spoken() -> str:
    """Return the code of the language in which to write: "en" or "de".

    It is that of the `with speaking` block, else of an environment variable, else "en". Raise
    DataError if the variable has a language that is not in LANGUAGES.
    """
    if asked := _ASKED.get():
        return asked
    code = os.environ.get(VARIABLE, "").lower() or LANGUAGES[0]
    if code not in LANGUAGES:
        raise DataError(f"no language {code!r}; there are {', '.join(LANGUAGES)}")
    return code


@cache
def _catalogue(language: str) -> dict[str | None, dict[str, str]]:
    """Return the translations into `language`: context -> English text -> translation.

    The context is None for sentences and "page" for the words of the live page.
    """
    import polib  # English needs none of it

    file = resources.files(__package__ or "") / f"{language}.po"
    tables: dict[str | None, dict[str, str]] = {}
    for entry in polib.pofile(file.read_text("utf-8")):
        tables.setdefault(entry.msgctxt, {})[str(entry.msgid)] = str(entry.msgstr)
    return tables


def translations(language: str, context: str | None = None) -> dict[str, str]:
    """Return the sentences of a language by their English; empty for English itself.

    `context` is the msgctxt of the entries: None for sentences of `say`, "page" for the words of
    the live page.
    """
    return {} if language == LANGUAGES[0] else _catalogue(language).get(context, {})


def say(english: str, /, *listed: object, **values: object) -> str:
    """Return the sentence `english` in the chosen language, with its {placeholders} filled in.

    `listed` fill the unnamed placeholders, `values` the named ones. A sentence without a
    translation stays English. Without any value, braces stay as they are.
    """
    language = spoken()
    text = translations(language).get(english, english)
    if not (listed or values):
        return text
    if language == LANGUAGES[0]:
        return text.format(*listed, **values)
    named = {name: _comma(value) for name, value in values.items()}
    return text.format(*map(_comma, listed), **named)


class Sentence(str):
    """A text in the program's language that carries its translations into all LANGUAGES.

    It is made where its numbers are computed, before the language of a page's reader is known.
    """

    __slots__ = ("_by_language",)
    _by_language: dict[str, str]

    @classmethod
    def of(cls, make: Callable[[], str]) -> Sentence:
        """Return a sentence that has the text of `make` in each language.

        `make` is called once for each language of LANGUAGES.
        """
        texts = {}
        for language in LANGUAGES:
            with speaking(language):
                texts[language] = str(make())
        made = cls(texts[spoken()])
        made._by_language = texts
        return made

    def now(self) -> str:
        """Return the text in the language selected now."""
        return self._by_language[spoken()]


def in_spoken(text: str) -> str:
    """Return a `Sentence` in the language selected now; another text unchanged."""
    return text.now() if isinstance(text, Sentence) else text


class _Number(float):
    """A number that a sentence fills in by a format, with the signs of the language."""

    def __format__(self, how: str) -> str:
        return super().__format__(how).replace(",", " ").replace(".", ",")


class Verbatim(str):
    """A text that `say` fills in unchanged: a name of a file, or a text in the language already."""


def sentence(capitals: str) -> str:
    """Return a line of capitals in small letters if the language is English, else unchanged.

    In German small letters would hide which words are nouns.
    """
    if spoken() == LANGUAGES[0]:
        return capitals.lower()
    return capitals


def decimal(text: str) -> str:
    """Replace the decimal point in a number's text by the sign of the language."""
    return text if spoken() == LANGUAGES[0] else text.replace(".", ",")


def _comma(value: object) -> object:
    """Return a number or text with the language's decimal sign, and its word for `to` in intervals.

    Verbatim texts and other values are returned unchanged.
    """
    if isinstance(value, float):
        return _Number(value)
    if not isinstance(value, str) or isinstance(value, Verbatim):
        return value
    text = re.sub(r"(?<=\d)\.(?=\d)", ",", value)
    return re.sub(r"(?<=\d) to (?=\d)", f" {say('to')} ", text)


UNKNOWN = "unknown"
BEYOND_CEILING = "beyond the ceiling"  # of a margin below 0, which has no degrees
#: Amount below which a smaller unit is used. Unit -> how many of the smaller one make it, its name.
SMALL = 0.05
SMALLER: Mapping[str, tuple[float, str]] = {
    "kg": (1e3, "g"),
    "N m": (1e3, "mN m"),
    "N m s": (1e3, "mN m s"),
    "kg m²": (1e7, "g cm²"),
    "m²": (1e4, "cm²"),
}


def known(value: float | None) -> TypeGuard[float]:
    """Return True if `value` is a finite number."""
    return value is not None and math.isfinite(value)


def number(value: float | None, unit: str = "", decimals: int = 1) -> str:
    """Return a number, rounded to `decimals`, with its unit: `12.3 kg`; `unknown` for NaN and None.

    Thousands are separated by a space; zero has no sign.
    """
    if not known(value):
        return say(UNKNOWN)
    text = f"{value:,.{decimals}f}".replace(",", " ")
    if float(text.replace(" ", "")) == 0.0:
        text = text.lstrip("-")
    text = decimal(text.replace("-", "\N{MINUS SIGN}"))
    return f"{text} {unit}".rstrip()


def unbroken(text: str) -> str:
    """Put no-break spaces between numbers and their units, so that no line ends between them."""
    return re.sub(r"(?<=[0-9]) (?=[^ ]{1,3}(?:\b|$|[ ,;.)]))", "\N{NO-BREAK SPACE}", text)


def significant(value: float | None, digits: int = 4) -> str:
    """Return a number with `digits` significant digits; `unknown` for NaN and None.

    Below 1e-4 and from 1e9 on it has an exponent, `1.23e-05`.
    """
    if not known(value):
        return say(UNKNOWN)
    if value and not 1e-4 <= abs(value) < 1e9:
        return f"{value:.{digits - 1}e}"
    size = len(str(int(abs(value)))) if abs(value) >= 1.0 else 0
    return number(value, "", max(0, digits - size))


def percent(share: float | None, decimals: int = 0) -> str:
    """Return a share in per cent: `64 %` for 0.64."""
    return number(None if share is None else share * 100.0, "%", decimals)


def percent_within(share: float, low: float, high: float) -> str:
    """Return a share with its interval, `52 % (47 to 57)`; without it if both ends are equal or one
    is unknown."""
    if not (known(low) and known(high)) or high - low < 1e-9:
        return percent(share)
    ends = f"({number(low * 100.0, '', 0)} {say('to')} {number(high * 100.0, '', 0)})"
    return f"{percent(share)} {ends}"


def within(
    value: float,
    low: float,
    high: float,
    unit: str = "",
    *,
    factor: float = 1.0,
    most: int = 2,
    table_largest: float = 0.0,
) -> tuple[str, str]:
    """Return an amount and its interval as texts, `8 %` and `(7.8 to 8.2)`.

    All are multiplied by `factor`. The decimals, at most `most`, are those of the first digit of
    the half width; one more if both ends would look alike or one like 0. Amounts below SMALL get a
    smaller unit, `2.7 g` for 0.0027 kg, unless `table_largest`, the largest amount of the table, is
    SMALL or more. The second text is empty without an interval.
    """
    largest = max(abs(value), abs(low), abs(high)) * abs(factor)
    if unit in SMALLER and largest < SMALL:
        if table_largest < SMALL:
            finer, unit = SMALLER[unit]
            factor, largest = factor * finer, largest * finer
        if 0.0 < largest < 1.0:
            most = max(most, 1 - math.floor(math.log10(largest)))
    value, ends = value * factor, sorted((low * factor, high * factor))
    half = (ends[1] - ends[0]) / 2
    if not math.isfinite(half) or half <= 0.0:
        return number(value, unit, most), ""
    decimals = min(most, -math.floor(math.log10(half) + 1e-6))
    texts = [_rounded(v, decimals) for v in (value, *ends)]
    if texts[1] == texts[2] or any(
        not round(end, decimals) and abs(end) > 0.01 * half for end in ends
    ):
        texts = [_rounded(v, decimals + 1) for v in (value, *ends)]
    amount = re.sub(r"[.,]0+$|([.,]\d*?)0+$", r"\1", texts[0])
    return f"{amount} {unit}".rstrip(), f"({texts[1]} {say('to')} {texts[2]})"


def shown_unit(unit: str, name: str = "") -> tuple[float, str]:
    """Return (factor, unit) with which a number in the unit `unit` of files is displayed.

    A share, "1", is displayed in per cent, except for a parameter with "exponent" in its `name`. A
    unit without a rule is kept, with the factor 1.
    """
    if unit == "1" and "exponent" in name:
        return 1.0, ""
    people = {
        "1": (100.0, "%"),
        "m": (1000.0, "mm"),
        "rad": (DEGREES, "°"),
        "1/s": (6000.0, say("% a minute")),
    }
    return people.get(unit, (1.0, unit.replace("^2", "²")))


def joined(parts: tuple[str, str]) -> str:
    """Return amount and interval as one text."""
    return " ".join(parts).rstrip()


def _rounded(value: float, decimals: int) -> str:
    """Return a number rounded to `decimals`, which may be negative, without a unit."""
    return number(round(value, decimals), "", max(0, decimals))


def more(share: float, decimals: int = 2) -> str:
    """Return a share in per cent, with a plus sign if positive: `+75.83 %` for 0.7583."""
    text = percent(share, decimals)
    return f"+{text}" if share > 0.0 else text


def clock(seconds: float | None) -> str:
    """Return seconds as `3:07` or `1:02:45`, cut to whole seconds; `unknown` for NaN and None."""
    if not known(seconds):
        return say(UNKNOWN)
    whole = int(abs(seconds))
    hours, minutes, rest = whole // 3600, whole // 60 % 60, whole % 60
    text = f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
    return f"-{text}" if seconds < 0 and whole else text


def duration(seconds: float | None) -> str:
    """Return a duration, s, as `1 h 5 min`, `3 min 28 s`, `12 s` or `0.4 s`.

    Return `unknown` for NaN and None.
    """
    if not known(seconds):
        return say(UNKNOWN)
    if seconds < 10.0:
        return number(seconds, "s", 1)
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    hours, minutes, rest = whole // 3600, whole // 60 % 60, whole % 60
    if hours:
        return f"{hours} h {minutes} min"
    return f"{minutes} min {rest} s" if rest else f"{minutes} min"


def area(square_metres: float | None) -> str:
    """Return square metres as `0.84 ha`; as `m²` below a tenth of a hectare."""
    if not known(square_metres):
        return say(UNKNOWN)
    if square_metres < 1000.0:
        return number(square_metres, "m²", 0)
    return number(square_metres / 1e4, "ha", 2)


def place(north: float, east: float) -> str:
    """Return a position, m from the start, as `12 m north, 40 m west of the start`; empty if
    unknown."""
    if not (known(north) and known(east)):
        return ""
    along = f"{abs(north):.0f} m {say('north' if north >= 0 else 'south')}"
    across = f"{abs(east):.0f} m {say('east' if east >= 0 else 'west')}"
    return say("{along}, {across} of the start", along=along, across=across)


def from_direction(degrees: float) -> str:
    """Return a direction as `from SE (142°)`; `unknown` for NaN."""
    if not known(degrees):
        return say(UNKNOWN)
    names = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")
    where = f"{say(names[round(degrees / 45.0) % 8])} ({degrees % 360:.0f}°)"
    return say("from {where}", where=where)


DEGREES = 180.0 / math.pi
#: Channel -> name, unit, and what its numbers are multiplied by for that unit.
CHANNEL_WORDS: Mapping[str, tuple[str, str, float]] = {
    "airspeed": ("airspeed", "m/s", 1.0),
    "tank_kg": ("tank level", "kg", 1.0),
    "time_s": ("time in the log", "s", 1.0),
    "advance_ratio": ("climb (axial advance ratio)", "", 1.0),
    "radius_over_height": ("rotor radius over height", "", 1.0),
    "voltage": ("battery voltage", "V", 1.0),
    "density": ("air density", "kg/m³", 1.0),
    "heading": ("heading", "°", DEGREES),
    "spraying": ("spraying", "", 1.0),
    "yaw_rate": ("yaw rate", "°/s", DEGREES),
    "yaw_acceleration": ("yaw acceleration", "°/s²", DEGREES),
    "load_factor": ("load factor", "", 1.0),
}


def channel_name(channel: str) -> str:
    """Return the usual name of a channel; without one, the channel's own name with spaces."""
    if channel not in CHANNEL_WORDS:
        return channel.replace("_", " ")
    return say(CHANNEL_WORDS[channel][0])


def channel_title(channel: str) -> str:
    """Return the name of a channel with its unit, as the title of an axis."""
    unit = CHANNEL_WORDS[channel][1] if channel in CHANNEL_WORDS else ""
    return f"{channel_name(channel)}{f', {unit}' if unit else ''}"


def chance(probability: float, flights: int = 0) -> str:
    """Return a probability as `60 %`, and never as 0 or 100 %: `over 99 %`, `under 1 %`.

    If `flights` is above 0, `by 3 flights` is appended.
    """
    share = say("over 99 %" if probability > 0.5 else "under 1 %")
    if 0.01 <= probability <= 0.99:
        share = percent(probability)
    if not flights:
        return share
    words = "{share} by {count} flights" if flights > 1 else "{share} by {count} flight"
    return say(words, share=share, count=flights)


def printable(raw: bytes) -> str:
    """Return a field's text up to its first zero byte, trimmed; control characters become
    spaces.
    """
    return piece(raw).strip()


def piece(raw: bytes) -> str:
    """Return a field's text up to its first zero byte, for a text that is sent in several fields.

    Control characters become spaces; nothing is trimmed.
    """
    return clean(bytes(raw).split(b"\0", 1)[0].decode("utf-8", "replace"))


def clean(text: str) -> str:
    """Return the text with each control or other unprintable character replaced by a space.

    Bytes of a file name that are not UTF-8 become question marks.
    """
    if text.isprintable():
        return text
    text = text.encode("utf-8", "replace").decode("utf-8")
    return "".join(c if c.isprintable() else " " for c in text)


def clean_lines(text: str) -> str:
    """Clean each line of a text and keep the line ends."""
    return "\n".join(map(clean, text.split("\n")))
