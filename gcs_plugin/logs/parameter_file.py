"""Read parameter files of ground stations: Mission Planner .param and .parm, QGroundControl
.params.

Mission Planner and MAVProxy write NAME,VALUE or NAME VALUE; QGroundControl writes five columns:
vehicle, component, NAME, VALUE, type. Lines of `#` and `//` are comments.
"""

from __future__ import annotations

import re
from math import isfinite
from pathlib import Path

from thrustmargin.models.errors import LogError
from thrustmargin.models.whole_file import regular

SUFFIXES = (".param", ".parm", ".params")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{1,31}")
_MOST_BYTES = 4 << 20


def read_parameters(path: Path) -> dict[str, float]:
    """Read a parameter file (NAME,VALUE or the columns of QGroundControl); return finite values by
    name in capitals, the last of several.

    Lines of another form are skipped. Raise LogError if the file cannot be read, is too large or
    has no parameter.
    """
    try:
        if regular(path).stat().st_size > _MOST_BYTES:
            raise LogError(f"{path.name} is too large for a parameter file")
        text = path.read_bytes().decode("utf-8-sig", "replace")
    except OSError as error:
        raise LogError(f"{path} cannot be read: {error.strerror or error}") from error
    parameters: dict[str, float] = {}
    for line in text.splitlines():
        words = re.split(r"[\s,=]+", line.split("#")[0].strip())
        if len(words) >= 4 and words[0].isdigit() and words[1].isdigit():
            words = words[2:]
        if len(words) >= 2 and _NAME.fullmatch(words[0]):
            try:
                value = float(words[1])
            except ValueError:
                continue
            if isfinite(value):
                parameters[words[0].upper()] = value
    if not parameters:
        raise LogError(
            f"{path.name}: no parameter in it; a parameter file has lines such as FRAME_CLASS,1"
        )
    return parameters
