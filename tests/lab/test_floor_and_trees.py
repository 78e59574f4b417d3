"""The floor beside a method that fits any law: it is no lower, so what is left has no law."""

import numpy as np
from sklearn.ensemble import HistGradientBoostingRegressor

from thrustmargin.gcs_plugin.logs import read_log
from thrustmargin.models.identification.answer.floor import floor_rpm
from thrustmargin.models.identification.rows.problem import assemble
from thrustmargin.models.model.model_file import shipped_model


def test_boosted_trees_on_the_same_channels_do_not_undercut_it(sitl_logs):
    model = shipped_model()
    names = [f"worn_prop_{k}.tlog" for k in (1, 2, 3)]
    tracks = [read_log(sitl_logs / "dev" / n, airframe=model.airframe).track for n in names]
    problem = assemble(model, tracks)
    x, residual = problem.channels, problem.measured_rpm - problem.speeds()
    every = [x.airspeed, x.tank_kg, x.time_s, x.voltage, x.advance_ratio, x.load_factor, x.heading]
    tables = [x.load_factor_shifts, *x.rate_shifts, *x.acceleration_shifts]
    columns = np.concatenate([np.stack(every, axis=1), *(t[:, ::4] for t in tables)], axis=1)
    modes = problem.mode_amplitudes(residual)
    left = np.empty_like(modes)
    for f in range(3):
        out = problem.flight == f
        for k in range(4):
            trees = HistGradientBoostingRegressor(max_iter=80, learning_rate=0.06)
            left[out, k] = modes[out, k] - trees.fit(columns[~out], modes[~out, k]).predict(
                columns[out]
            )
    assert floor_rpm(problem, residual) < 1.02 * np.sqrt(np.mean(left**2))
