"""Route, field and forecast. Imports models only."""
