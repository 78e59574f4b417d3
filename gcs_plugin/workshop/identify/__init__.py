"""What a rotor speed model lacks, named and added, with the error before and after."""

#: Subcommand -> the first words of the docstring of its function.
COMMANDS = {
    "identify": "Find what a rotor speed model lacks",
}
