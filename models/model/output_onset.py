"""A rotor that loses thrust in flight, where no ESC reports a speed: by the motor outputs.

How far outputs part says little: a centre of gravity off the middle or a motor that is not level
looks like a weak rotor, and motors of one make differ. That they part within a flight, all modes at
once and in the proportions of one rotor's loss, does. So the trims are taken as unknown, and only a
sudden change names a rotor.

The outputs are read by their own thrust curve f. Equivalent speeds (`inferred.output_speed`) follow
the weight and shrink what differs between rotors; only their mean over the rotors is kept:
    N_i² = mean(N²) f(x_i) / mean(f(x))
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from thrustmargin.models.checks.sudden_change import Prior
from thrustmargin.models.flight import Floats
from thrustmargin.models.model.fault_test import MOST, FaultTest, RotorFault

#: Of a rotor's thrust: trims, of which nothing is known, and a block's noise.
TRIM, NOISE = 1.0, 0.02
#: By how much what a turn adds to outputs may differ from what it adds to speeds, which follow.
TURNS = 2.0
#: Standard error of a size for that of the thrust curve's steepness (Quiver), as a share.
CURVE_ERROR = 0.15


def square_of_outputs(equivalent_rpm: Floats, share: Floats) -> Floats:
    """Return the squared speeds (N, R), rpm², of shares (N, R) of full thrust by the outputs.

    `equivalent_rpm` (N, R) gives the mean. NaN where that or a share is unknown.
    """
    mean = np.mean(equivalent_rpm**2, axis=1, keepdims=True)
    return np.asarray(mean * share / np.mean(share, axis=1, keepdims=True))


def output_test(steps: Floats, widths: Floats, inputs: Floats) -> FaultTest:
    """Return the test that reads outputs, by the steps (R, J, M) of a rotor's loss, +- `widths`,
    and the standard deviations (M, P) of what turns add."""
    modes = steps.shape[2]
    size = math.sqrt(modes)
    prior = Prior(
        trim=np.full(modes, TRIM * size),
        noise=np.full(modes, NOISE * size),
        inputs=TURNS * inputs,
    )
    return FaultTest("propeller", steps, widths, prior)


def of_outputs(fault: RotorFault) -> RotorFault:
    """Return a fault of the outputs' test with the interval that the thrust curve's error leaves.

    The upper end stays MOST while the fault grows.
    """
    lower, upper = (
        math.hypot(end - fault.size, 1.96 * CURVE_ERROR * fault.size)
        for end in (fault.lower, fault.upper)
    )
    return replace(
        fault,
        evidence="outputs",
        lower=max(fault.size - lower, 0.0),
        upper=fault.upper if fault.upper >= MOST else min(fault.size + upper, MOST - 1e-6),
    )
