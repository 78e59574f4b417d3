"""Commands of the residual loop: a model from flights, and what it lacks."""
