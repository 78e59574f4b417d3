"""Speeds that follow the battery's voltage, from a voltage of their own on."""

from dataclasses import replace

from tests.models.made_flights import F16, curve_model, made_flights, table
from thrustmargin.models.effects import effects_for
from thrustmargin.models.flight import FlightTrack
from thrustmargin.models.identification.loop import identify_checked
from thrustmargin.models.network.records import GoodFlights

RIGHT_AT = 53.2  # V, 14 cells of 3.8; full they have 58.8


def misread(track: FlightTrack, number: int) -> FlightTrack:
    """Speeds that somebody works out: right at 53.2 V, 0.7 % off for each per cent away from it."""
    volts = 58.0 - 0.08 * track.time_s - 0.5 * number
    shown = track.rotor_speed_rpm * (1.0 + 0.7 * (volts / RIGHT_AT - 1.0))[:, None]
    return replace(track, voltage=volts, rotor_speed_rpm=shown)


def test_where_speeds_are_right_is_no_hidden_mass():
    model = replace(curve_model(), good_flights=GoodFlights(flights=5))
    tracks = [misread(t, k) for k, t in enumerate(made_flights(3, duration=120.0))]
    names = ["battery_voltage", "extra_mass", "tank_scale", "thrust_drift"]
    found = identify_checked(tracks, model, catalogue=effects_for(F16, table(names)))
    assert [f.term.key for f in found.found] == ["battery_voltage"]
    exponent, level = found.found[0].value[0]
    assert abs(exponent + 1.4) < 0.2  # the thrust that speeds seem to make goes as their square
    assert abs((1.0 + level) * F16.ceiling_voltage - RIGHT_AT) < 0.5
