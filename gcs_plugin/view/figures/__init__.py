"""The page beside the scene: gauges, charts, alarms and controls."""
