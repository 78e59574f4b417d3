"""Write the record of a spraying job that the law of a country requires."""

#: Subcommand -> the first words of the docstring of its function.
COMMANDS = {
    "record": "Write the record of a spraying job: what, where, how much, when, by whom",
}
