"""The model of one aircraft, and the analysis and verdict of its flights."""
