"""One module a subcommand; each holds a typed function of the module's name."""
