"""Intervals of unknowns whose χ² is no parabola, where its profile is known in closed form."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from armdesign.arrays import Array
from armdesign.calibration.fit import Fit, determined
from armdesign.calibration.least_squares import LeastSquares
from armdesign.calibration.measured import measured_of
from armdesign.calibration.prediction import Predictor
from armdesign.calibration.unknowns import unknowns_of
from tests.calibration.synthetic import BETA, crane

BEST = 1000.0  # MPa
NORMAL = 1.959964  # deviations to the ends of 95 %

Formula = Callable[[float], float | list[float]]


@dataclass(frozen=True, eq=False)
class ClosedForm(LeastSquares):
    """Residuals that are a function of the value over the best one."""

    formula: Formula

    def residuals(self, u: Array) -> Array:
        return np.atleast_1d(self.formula(math.exp(u[0]) / BEST)).astype(float)


def found(file_value: float, formula: Formula) -> tuple[Fit | None, float]:
    """The fit of what is determined, and the relative deviation if the unknown is not."""
    machine = crane().replace({BETA: file_value})
    row = {"payload": "full", "lift_boom_deg": 20, "tilt_boom_deg": -30, "extension_mm": 0}
    measured = measured_of([{**row, "frequency_hz": 2}], machine)
    unknowns = unknowns_of(machine, [BETA])
    problem = ClosedForm(machine, Predictor(machine, measured), unknowns, formula)
    _, fit, loose = determined(problem)
    return fit, loose.get(BETA, math.nan)


def linear(deviation: float) -> Callable[[float], float]:
    """What is linear in the value: that has the interval 1 ± 1.96 deviations, times the best."""
    return lambda value: (value - 1) / deviation


@pytest.mark.parametrize("highest", [0.5, 1.9])
def test_a_chi_squared_that_hardly_rises_determines_nothing(highest: float) -> None:
    """Of curvature 1 %, but χ² nowhere exceeds ``highest``² < 1.96²: all values are allowed."""
    fit, deviation = found(
        1.01 * BEST, lambda value: highest * math.tanh(math.log(value) / 0.01 / highest)
    )
    assert fit is None
    assert deviation > 1


def test_a_chi_squared_that_rises_on_one_side_alone_determines_nothing() -> None:
    """A value that may be as large as one likes."""
    fit, _ = found(1.2 * BEST, lambda value: min(math.log(value) / 0.05, 1.0))
    assert fit is None


def test_a_steep_chi_squared_is_enough_though_the_file_is_right() -> None:
    """χ² does not fall from the file's value, but rises on either side of it."""
    fit, _ = found(BEST, linear(0.02))
    assert fit is not None
    assert fit.deviations == pytest.approx(0.02, rel=0.05)


@pytest.mark.parametrize("deviation", [0.1, 0.2, 0.25])
def test_an_interval_reaches_to_where_chi_squared_has_risen(deviation: float) -> None:
    """Downwards in logarithms; upwards no less than by the curvature."""
    fit, _ = found(1.5 * BEST, linear(deviation))
    assert fit is not None
    below, above = fit.ends[0]
    assert math.exp(-below) == pytest.approx(1 - NORMAL * deviation, rel=0.04)
    assert above == pytest.approx(NORMAL * deviation, rel=1e-3)
    assert fit.deviations[0] == pytest.approx(below / NORMAL, rel=1e-6)


@pytest.mark.parametrize(("file_value", "held"), [(0.5, True), (1.5, True), (5.0, False)])
def test_a_refuted_value_is_not_held(file_value: float, held: bool) -> None:
    """The interval 0.12 … 1.88 is too wide; values in it are held, 5 is 8.9 deviations off."""
    fit, _ = found(file_value * BEST, linear(0.45))
    assert (fit is None) is held


def test_a_refuted_value_is_not_held_though_none_is_the_best() -> None:
    """What is best at none, as a compliance of a stiff machine, has an upper end alone.

    χ² = (value/deviation)² has no curvature in logarithms where the value is next to none, and
    has risen by 1.96² at 1.96 deviations, far from there.
    """
    fit, _ = found(5 * BEST, lambda value: value / 0.1)
    assert fit is not None
    assert not fit.loose.any()
    assert math.exp(fit.u[0]) < 1e-4 * BEST
    assert math.exp(fit.u[0] + fit.ends[0, 1]) / BEST == pytest.approx(NORMAL * 0.1, rel=0.02)


@pytest.mark.parametrize("height", [1.4, 2.3])
def test_a_lower_minimum_that_an_interval_leads_to_is_taken(height: float) -> None:
    """χ² = height² sin²(π x/d) + (x/d − 1)² over x = ln(value) is 0 at d, and about 1 near 0.

    Between them it rises to height² + ¼, less than an interval's end where the profile goes on, or
    more where it stops on the crest. The fit stayed near 0, as it begins there.
    """
    distance = 0.4

    def waves(value: float) -> list[float]:
        share = math.log(value) / distance
        return [height * math.sin(math.pi * share), share - 1]

    fit, _ = found(BEST, waves)
    assert fit is not None
    assert fit.u[0] - math.log(BEST) == pytest.approx(distance, abs=1e-6)
    assert fit.chi_squared == pytest.approx(0.0, abs=1e-9)
    below, _ = fit.ends[0]
    assert bool(below > distance) is (height**2 < NORMAL**2)  # whether the other one is within
