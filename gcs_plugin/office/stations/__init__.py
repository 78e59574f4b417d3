"""Files for other programs: Mission Planner, the vehicle, a companion computer."""

#: Subcommand -> the first words of the docstring of its function.
COMMANDS = {
    "install": "Copy what goes into another program",
}
