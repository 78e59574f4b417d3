"""Flights and live figures in the formats of other programs: MCAP for Foxglove, Prometheus."""

#: Subcommand -> the first words of the docstring of its function.
COMMANDS = {
    "export": "Write a flight as messages that Foxglove and other viewers of MCAP show",
}
#: Option of `monitor` -> the module that makes its output.
OUTPUTS = {"metrics": "thrustmargin.gcs_plugin.office.streams.metrics"}
