"""MAVLink: frames, layouts of messages, and the table from fields to channels in SI."""
