"""Where the channels of a table come from: its columns, or what its comment line says of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from thrustmargin.gcs_plugin.mavlink.text import clean
from thrustmargin.models.errors import LogError
from thrustmargin.models.json_values import from_json_values
from thrustmargin.models.provenance import Provenance, Rejected, SourceKind


def column_source(name: str) -> Provenance:
    """The source of a channel that is a column, or of which this is the first of several."""
    return Provenance(kind=SourceKind.COLUMN, name=name)


def written_sources(path: Path, written: Any) -> dict[str, Provenance]:
    """The sources that the file states of its channels."""
    if not isinstance(written, dict):
        return {}
    try:
        return {
            clean(channel): _cleaned(from_json_values(Provenance, data, f"the source of {channel}"))
            for channel, data in written.items()
        }
    except ValueError as error:
        wanted = "leave `sources` out of it, or write the table with this version again"
        raise LogError(f"{path.name}: in its comment line {error}; {wanted}") from error


def _cleaned(source: Provenance) -> Provenance:
    """The same without what could do harm on a screen."""
    return replace(
        source,
        name=clean(source.name),
        fields=tuple(map(clean, source.fields)),
        instance=clean(source.instance),
        unit=clean(source.unit),
        parts=tuple(map(_cleaned, source.parts)),
        rejected=tuple(Rejected(_cleaned(r.source), r.reason) for r in source.rejected),
        remarks=tuple(map(clean, source.remarks)),
    )
