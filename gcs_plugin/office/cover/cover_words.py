"""Word the result of `cover`: areas, lines and ways of the route over a field."""

from __future__ import annotations

from thrustmargin.gcs_plugin.office.cover.coverage_plan import Coverage
from thrustmargin.gcs_plugin.wording.language import number, percent
from thrustmargin.gcs_plugin.wording.plan_words import hectares


def coverage_words(coverage: Coverage) -> tuple[str, ...]:
    """Return the sentences that the terminal prints on a route over a field, in their order."""
    lines, spacing = coverage.lines, coverage.lines.spacing
    headings = sorted({round(h) % 180 for h in lines.heading_deg})
    listed = ", ".join(f"{h}°" for h in headings[:3]) + (" ..." if len(headings) > 3 else "")
    wide = (
        f"{min(spacing):.2f} m"
        if max(spacing) - min(spacing) < 0.005
        else f"{min(spacing):.2f} to {max(spacing):.2f} m"
    )
    sentences = [
        f"Field {hectares(coverage.field_area)}, to spray {hectares(coverage.spray_area)}, under "
        f"the swaths {percent(coverage.sprayed_area / coverage.spray_area, 1)} of that.",
        f"{len(lines.lines)} lines, {wide} apart, heading {listed}.",
        f"Sprayed way {number(coverage.sprayed_length / 1e3, 'km', 2)}, between lines "
        f"{number(coverage.transit_length / 1e3, 'km', 2)} with the pump off.",
    ]
    if not coverage.home_given:
        sentences.append("Home is taken where the first line starts; give --home for another.")
    if coverage.ways_outside:
        sentences.append(f"Ways between lines that leave the field: {coverage.ways_outside}.")
    return (*sentences, *(f"{name} has nothing in the field." for name in coverage.elsewhere))
