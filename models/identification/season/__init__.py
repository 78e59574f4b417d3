"""Find what changed on one aircraft over many flights.

Each flight is stored as small sums (`FlightEvidence`). `season_changes` needs these sums alone, not
the rows of the flights.
"""
