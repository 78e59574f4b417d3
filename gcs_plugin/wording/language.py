"""The language that is spoken: sentences are written in English, and looked up in a table.

`sentences_de.toml` beside this file holds the German of each, by its English with the same
{placeholders}; what is not in it stays English. Chosen by `--language de` with any command, or by
the variable THRUSTMARGIN_LANGUAGE, as for MAVProxy and services.
"""

from __future__ import annotations

import os
import re
import tomllib
from functools import cache
from importlib import resources

from thrustmargin.models.errors import DataError

#: The first is what a browser of another language is shown.
LANGUAGES = ("en", "de")
VARIABLE = "THRUSTMARGIN_LANGUAGE"


def spoken() -> str:
    """The code of the language, `en` unless another was chosen.

    Raises DataError for one that there is not.
    """
    code = os.environ.get(VARIABLE, "").lower() or LANGUAGES[0]
    if code not in LANGUAGES:
        raise DataError(f"no language {code!r}; there are {', '.join(LANGUAGES)}")
    return code


@cache
def translations(language: str) -> dict[str, str]:
    """Sentences of a language by their English; none for English itself."""
    if language == LANGUAGES[0]:
        return {}
    file = resources.files(__package__ or "") / f"sentences_{language}.toml"
    return tomllib.loads(file.read_text("utf-8"))["sentences"]


def say(english: str, /, *listed: object, **values: object) -> str:
    """A sentence in the language that is spoken, with its {placeholders} filled in.

    Without values it is taken as it is, braces and all.
    """
    language = spoken()
    text = translations(language).get(english, english)
    if not (listed or values):
        return text
    if language == LANGUAGES[0]:
        return text.format(*listed, **values)
    named = {name: _comma(value) for name, value in values.items()}
    return text.format(*map(_comma, listed), **named)


def sentence(capitals: str) -> str:
    """A line of capitals in small letters, which in German is the text that it was made from."""
    if spoken() == LANGUAGES[0]:
        return capitals.lower()
    return capitals


def decimal(text: str) -> str:
    """A number's text with the decimal sign of the language."""
    return text if spoken() == LANGUAGES[0] else text.replace(".", ",")


def _comma(value: object) -> object:
    """Numbers in a text with a decimal comma, and their intervals in its words."""
    if not isinstance(value, str):
        return value
    text = re.sub(r"(?<=\d)\.(?=\d)", ",", value)
    return re.sub(r"(?<=\d) to (?=\d)", f" {say('to')} ", text)
