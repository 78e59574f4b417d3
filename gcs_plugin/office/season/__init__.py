"""A season of many logs: take logs into the store, and show which aircraft to look at first."""

#: Subcommand -> the first words of the docstring of its function.
COMMANDS = {
    "fleet": "Show which aircraft of a season to look at first, and why",
    "ingest": "Take logs into the store of a season",
}
