"""Flights as rows and means: what is fitted, its candidates, least squares of a given set."""
