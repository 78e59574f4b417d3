"""Terms of a search with effects of the catalogue, and with unnamed curves, by their keys."""

from tests.models.known_effects import known_curve, known_effect
from thrustmargin.models.identification.rows.candidates import Term


def known_term(key: str, rotor: int | None = None) -> Term:
    return Term(effect=known_effect(key), rotor=rotor)


def curve_term(mode: str, channel: str, rotor: int | None = None) -> Term:
    return Term(effect=known_curve(mode, channel), rotor=rotor)
