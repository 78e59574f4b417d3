"""Figures and tables of training and of load matching."""
