"""What is read beside the scene: gauges, charts, alarms, and the controls."""
