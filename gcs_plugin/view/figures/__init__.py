"""The page next to the scene: gauges, charts, alarms and controls."""
