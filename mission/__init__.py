"""Represent missions: plans, routes over fields, and the places where a vehicle flew and
sprayed.
"""
