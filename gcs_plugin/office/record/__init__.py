"""The record of a spraying job, as the law asks for it."""

#: Subcommand -> the first words of the docstring of its function.
COMMANDS = {
    "record": "Write the record of a spraying job: what, where, how much, when, by whom",
}
