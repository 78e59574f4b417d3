"""The `identify` of `import thrustmargin`: the search, with its refusals in sentences."""

from __future__ import annotations

from functools import wraps
from typing import Any

from thrustmargin.gcs_plugin.wording.check_words import statement_words
from thrustmargin.models.errors import DataError, UnlikeFlightError
from thrustmargin.models.identification import loop
from thrustmargin.models.identification.answer.result import Identification
from thrustmargin.models.statement import Statement


@wraps(loop.identify)
def identify(*flights: Any, **options: Any) -> Identification:
    try:
        return loop.identify(*flights, **options)
    except UnlikeFlightError as error:
        reasons = [(name, why) for name, why in error.reasons if isinstance(why, Statement)]
        words = "; ".join(f"{name}: {statement_words(why)}" for name, why in reasons)
        raise DataError(words) from error
