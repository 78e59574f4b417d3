"""Aircraft that fly now: state, rows, alarms, recording, console."""
