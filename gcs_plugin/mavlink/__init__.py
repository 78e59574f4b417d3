"""Define MAVLink frames, message layouts, and the table from fields to channels in SI."""
