"""Train the model of an aircraft from its own flights, and match its load with its power system."""

#: Subcommand -> the first words of the docstring of its function.
COMMANDS = {
    "learn": "Make aircraft known from their logs",
    "match": "Match an aircraft's load with its power system",
    "train": "Train the rotor speed model of one aircraft on its own good flights",
}
