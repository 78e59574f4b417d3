"""How large each effect may be found, and what is too small to name: lower, upper, usual, smallest.

Bounds are physical or generous: a rotor cannot gain a third of its thrust nor fly with 70 % of it
lost; a mass on board below -10 kg or above 20 kg is no sprayer of this size any more.
"""

import pytest

from thrustmargin.models.effects import CATALOGUE

#: As the code has them, written down by hand: a change there is to be seen here.
USUAL_ARM = 0.9595439

#: (effect, parameter) of an aircraft of USUAL_MASS and USUAL_ARM -> lower, upper, scale, smallest
SIZES = {
    ("sensor_lag", "lag"): (-0.5, 0.5, 0.2, 0.05),
    ("tank_scale", "gain"): (0.5, 2, 0.1, 0.01),
    ("tank_zero", "offset"): (-5, 5, 0.5, 0.1),
    ("tank_drift", "rate"): (-0.02, 0.02, 0.001, 0.00015),
    ("airspeed_bias", "bias"): (-5, 5, 1, 0.3),
    ("airspeed_gain", "gain"): (0.5, 2, 0.1, 0.03),
    ("wind", "wind_north"): (-20, 20, 5, 1),
    ("wind", "wind_east"): (-20, 20, 5, 1),
    ("extra_mass", "mass"): (-10, 20, 2, 0.1),
    ("load_factor", "gain"): (-0.5, 2, 1, 0.05),
    ("load_factor", "imu_share"): (0, 1, 1, 0),
    ("load_factor", "derivative_correction"): (-0.33, 0.5, 0.2, 0),
    ("load_factor", "lag"): (0, 0.3, 0.2, 0),
    ("parasite_drag", "drag_area"): (-1, 6, 1, 0.05),
    ("slung_load", "mass"): (-2, 20, 2, 0.1),
    ("slung_load", "cable"): (3.838176, 6.286352, 0.7676351, 0),
    ("cg_offset", "x"): (-0.5, 0.5, 0.05, 0.0025),
    ("cg_offset", "y"): (-0.5, 0.5, 0.05, 0.0025),
    ("cg_offset", "x_full"): (-0.5, 0.5, 0.05, 0.0025),
    ("cg_offset", "y_full"): (-0.5, 0.5, 0.05, 0.0025),
    ("drag_moment", "roll"): (-4, 4, 0.5, 0.05),
    ("drag_moment", "pitch"): (-4, 4, 0.5, 0.05),
    ("flow_moment", "roll"): (-1, 1, 0.1, 0.01),
    ("flow_moment", "pitch"): (-1, 1, 0.1, 0.01),
    ("manoeuvre_moment", "inertia_roll"): (-60, 60, 5, 0.2),
    ("manoeuvre_moment", "inertia_pitch"): (-60, 60, 5, 0.2),
    ("manoeuvre_moment", "inertia_yaw"): (-60, 60, 5, 0.2),
    ("manoeuvre_moment", "damping_roll"): (-300, 300, 5, 0.2),
    ("manoeuvre_moment", "damping_pitch"): (-300, 300, 5, 0.2),
    ("manoeuvre_moment", "damping_yaw"): (-300, 300, 5, 0.2),
    ("manoeuvre_moment", "load_exponent"): (-2, 2, 0.5, 0),
    ("manoeuvre_moment", "derivative_correction_tilt"): (-0.33, 0.5, 0.2, 0),
    ("manoeuvre_moment", "derivative_correction_yaw"): (-0.33, 0.5, 0.2, 0),
    ("manoeuvre_moment", "lag"): (0, 0.3, 0.1, 0),
    ("manoeuvre_moment", "spin_up"): (0, 1, 0.2, 0),
    ("weathervane", "lever"): (-0.2, 0.2, 0.02, 0.002),
    ("yaw_trim", "moment"): (-20, 20, 1, 0.1),
    ("yaw_trim", "tilt"): (-0.15, 0.15, 0.03, 0.0017),
    ("air_density", "temperature_offset"): (-35, 35, 8, 0),
    ("air_density", "torque_share"): (0, 1, 0.5, 0),
    ("battery_voltage", "exponent"): (-2.5, 2.5, 0.5, 0.05),
    ("battery_voltage", "level"): (-0.2, 0.1, 0.06, 0),
    ("climb_inflow", "slope"): (-2, 6, 1, 0.05),
    ("ground_effect", "strength"): (0, 3, 0.2, 0.02),
    ("rotor_degradation", "loss"): (-0.3, 0.7, 0.05, 0.004),
    ("rotor_degradation", "torque_share"): (-1, 2, 0.75, 0),
    ("rotor_degradation", "onset_time"): (0, 100000, 60, 0),
    ("rotor_degradation", "end_time"): (0, 100000, 60, 0),
    ("rotor_degradation", "onset_clock"): (0, 1e11, 60, 0),
    ("rotor_degradation", "end_clock"): (0, 1e11, 60, 0),
    ("thrust_drift", "rate"): (-0.001, 0.002, 0.0001, 1.7e-05),
    ("translational_lift", "gain"): (-0.5, 1, 0.1, 0.01),
}
FOUND = {(e.name, p.name): p for e in reversed(CATALOGUE) for p in e.parameters}


def test_every_parameter_has_its_size():
    assert {(e.name, p.name) for e in CATALOGUE for p in e.parameters} == set(SIZES)


@pytest.mark.parametrize(("place", "sizes"), SIZES.items(), ids=lambda v: str(v))
def test_a_parameter_may_be_found_between_its_bounds(place, sizes):
    p = FOUND[place]
    assert (p.lower, p.upper, p.scale, p.smallest) == pytest.approx(sizes, rel=1e-5)
    assert p.lower <= p.start <= p.upper


#: where a fit starts, if not at nothing; least half width of an interval: of all, and of the value
STARTS = {
    "airspeed_gain.gain": 1.0,
    "tank_scale.gain": 1.0,
    "load_factor.gain": 0.5,
    "load_factor.imu_share": 0.5,
    "load_factor.lag": 0.05,
    "parasite_drag.drag_area": 0.5,
    "manoeuvre_moment.derivative_correction_tilt": 1 / 12,
    "manoeuvre_moment.derivative_correction_yaw": 1 / 12,
    "manoeuvre_moment.lag": 0.02,
    "air_density.torque_share": 1.0,
    "battery_voltage.exponent": 1.0,
    "ground_effect.strength": 1 / 16,
    "rotor_degradation.torque_share": 1.0,
}
RESOLUTION = {
    "sensor_lag:rotor speed.lag": 0.01,
    "rotor_degradation:onset.onset_time": 0.3,
    "rotor_degradation:for a while.onset_time": 0.3,
    "rotor_degradation:for a while.end_time": 0.3,
    "rotor_degradation:in each flight.onset_time": 0.3,
    "rotor_degradation:since.onset_clock": 0.3,
    "rotor_degradation:until repaired.onset_clock": 0.3,
    "rotor_degradation:until repaired.end_clock": 0.3,
}
ACCURACY = {"load_factor.gain": 0.05, "yaw_trim.moment": 0.15, "weathervane.lever": 0.15}
ACCURACY |= {"yaw_trim:tilted arm.tilt": 0.15}
ACCURACY |= {f"cg_offset.{axis}": 0.01 for axis in "xy"}
ACCURACY |= {f"cg_offset:tank.{axis}_full": 0.01 for axis in "xy"}
ACCURACY |= {
    f"manoeuvre_moment.{what}_{axis}": 0.15 if axis == "yaw" else 0.04
    for what in ("inertia", "damping")
    for axis in ("roll", "pitch", "yaw")
}


def values_of(field: str, *, but: float = 0.0) -> dict[str, float]:
    found = {f"{e.key}.{p.name}": getattr(p, field) for e in CATALOGUE for p in e.parameters}
    return {key: value for key, value in found.items() if value != but}


def test_fits_start_where_nothing_is_or_where_an_effect_is_usual():
    found = values_of("start")
    cables = {k: v for k, v in found.items() if k.endswith(".cable")}
    onsets = {k for k in found if k.startswith("rotor_degradation:")}
    assert {k: found[k] for k in found if k not in onsets | set(cables)} == pytest.approx(STARTS)
    assert {found[k] for k in onsets} == {1.0}
    width = 16.0 ** (1 / 7)  # lengths of 4 to 64 arms in seven pieces, each from its middle
    middles = [4.0 * USUAL_ARM * width ** (k + 0.5) for k in range(7)]
    assert list(cables.values()) == pytest.approx(middles, rel=0.015)


def test_no_interval_is_finer_than_the_form_of_its_effect():
    assert values_of("resolution") == RESOLUTION
    assert values_of("accuracy") == ACCURACY
    absent = {k: v for k, v in values_of("absent").items() if v is not None}
    assert absent == {"airspeed_gain.gain": 1.0, "tank_scale.gain": 1.0}


def having(flag: str) -> set[str]:
    return {e.key for e in CATALOGUE if getattr(e, flag)}


WHEN = ("onset", "for a while", "in each flight", "since", "until repaired")


def test_what_kind_of_thing_each_effect_is():
    onsets = {f"rotor_degradation:{when}" for when in WHEN}
    assert having("begins") == onsets
    arms = {"yaw_trim:tilted arm", "extra_mass:on an arm"}
    assert having("of_one_arm") == arms
    assert having("of_one_rotor") == onsets | {"rotor_degradation", *arms}
    torque = {"rotor_degradation", "air_density", "yaw_trim:tilted arm"}
    assert having("torque") == onsets | torque
    assert having("on_airframe") == onsets | {
        "rotor_degradation",
        "extra_mass",
        "extra_mass:on an arm",
    }
    assert having("afterwards") == {"rotor_degradation:onset", "rotor_degradation:since"}
    assert having("gone") == {"rotor_degradation:until repaired"}
    assert having("delays") == {"sensor_lag:rotor speed"}
    assert having("by_flights") == {"tank_zero"}
    assert having("of_every_aircraft") == {
        *("load_factor", "parasite_drag", "cg_offset", "cg_offset:tank", "drag_moment"),
        *("flow_moment", "manoeuvre_moment", "weathervane", "yaw_trim"),
        *("climb_inflow", "translational_lift"),
    }
    assert having("temperature_offset") == {"air_density"}
    without = {e.name for e in CATALOGUE if not e.with_tank}
    assert without == {"slung_load", "flow_moment", "drag_moment", "weathervane"}
    own = {f"{e.key}.{p.name}" for e in CATALOGUE for p in e.parameters if p.per_flight}
    in_one_flight = {"rotor_degradation:onset", "rotor_degradation:for a while"}
    assert {key.split(".")[0] for key in own} == {"wind", "tank_zero"} | in_one_flight
