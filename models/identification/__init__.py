"""Explain the residual of a rotor speed model: find missing effects, add them, report the error."""
