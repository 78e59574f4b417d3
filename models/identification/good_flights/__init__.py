"""Build a model from an aircraft's own good flights and measure how those flights differ."""
