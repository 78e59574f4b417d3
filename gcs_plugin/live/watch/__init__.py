"""One vehicle watched: its rows analysed, its outlook and its alarms."""
