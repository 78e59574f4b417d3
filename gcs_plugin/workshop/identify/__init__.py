"""Identify the effects that a rotor speed model lacks, and add them to it."""

#: Subcommand -> the first words of the docstring of its function.
COMMANDS = {
    "identify": "Find what a rotor speed model lacks",
}
