"""Plan the route that sprays a field."""

#: Subcommand -> the first words of the docstring of its function.
COMMANDS = {
    "cover": "Plan the route that sprays a field",
}
