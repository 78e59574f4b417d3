"""Prepare the data of a fit: rows and short means of flights, candidate effects, noise,
row fits."""
