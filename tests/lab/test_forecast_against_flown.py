"""A flight that the model has not seen, forecast from its mission and parameters alone."""

from tests.lab.forecast_against_flown import compare
from thrustmargin.models.model.model_file import shipped_model


def test_a_windy_flight_is_as_forecast():
    made = compare("dev/windy_1.tlog", shipped_model())
    assert not made.learnt
    assert len(made.stretches) >= 12
    assert abs(made.worst("leg", "mean_error")) <= 1.5
    assert abs(made.worst("turn", "peak_error")) <= 5.0
    assert abs(made.flight_s[0] / made.flight_s[1] - 1.0) <= 0.03
    assert abs(made.tank_end_kg[0] - made.tank_end_kg[1]) <= 0.02 * made.fill_kg
