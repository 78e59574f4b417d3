"""An aircraft's own good flights: the model fit for use, and how they differ."""
