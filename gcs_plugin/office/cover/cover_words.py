"""Word the result of `cover`: areas, lines and ways of the route over a field."""

from __future__ import annotations

from thrustmargin.gcs_plugin.office.cover.coverage_plan import Coverage
from thrustmargin.gcs_plugin.wording.language import number, percent
from thrustmargin.gcs_plugin.wording.plan_words import hectares


def coverage_words(found: Coverage) -> tuple[str, ...]:
    """Return the sentences about a route over a field, in the order of the terminal."""
    lines, spacing = found.lines, found.lines.spacing
    headings = sorted({round(h) % 180 for h in lines.heading_deg})
    listed = ", ".join(f"{h}°" for h in headings[:3]) + (" ..." if len(headings) > 3 else "")
    wide = (
        f"{min(spacing):.2f} m"
        if max(spacing) - min(spacing) < 0.005
        else f"{min(spacing):.2f} to {max(spacing):.2f} m"
    )
    said = [
        f"Field {hectares(found.field_area)}, to spray {hectares(found.spray_area)}, under the "
        f"swaths {percent(found.sprayed_area / found.spray_area, 1)} of that.",
        f"{len(lines.lines)} lines, {wide} apart, heading {listed}.",
        f"Sprayed way {number(found.sprayed_length / 1e3, 'km', 2)}, between lines "
        f"{number(found.transit_length / 1e3, 'km', 2)} with the pump off.",
    ]
    if not found.home_given:
        said.append("Home is taken where the first line starts; give --home for another.")
    if found.ways_outside:
        said.append(f"Ways between lines that leave the field: {found.ways_outside}.")
    return (*said, *(f"{name} has nothing in the field." for name in found.elsewhere))
