"""Many flights of one aircraft: what each says by itself, and what changed over the season.

A flight is kept as small sums (`FlightEvidence`); the season is worked out from these alone. Arrays
in, arrays out, as everywhere in `models`.
"""
