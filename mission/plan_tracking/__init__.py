"""Compare a flight with the forecast of its plan, and find which assumption of the forecast was
wrong.
"""
