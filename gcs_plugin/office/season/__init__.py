"""A season of many flights: show which aircraft to look at first, and why."""

#: Subcommand -> the first words of the docstring of its function.
COMMANDS = {
    "fleet": "Show which aircraft of a season to look at first, and why",
}
