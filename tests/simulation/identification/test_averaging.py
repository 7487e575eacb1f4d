"""Modes of likely answers are averaged mode by mode, whatever their order."""

from __future__ import annotations

import numpy as np
import pytest

from armdesign.simulation.identification.averaging import averaged
from armdesign.simulation.identification.residual_terms import Answer


def answer(*modes: tuple[float, float], ratio: float = 1.0) -> Answer:
    """One of modes ω of some standard deviation, all with ζ = 0.02; a tenth of it is not noise."""
    poles = np.array([[omega, 0.02] for omega, _ in modes])
    variances = np.repeat([deviation**2 for _, deviation in modes], 2)
    return Answer(
        poles=poles,
        modes=len(modes),
        ratio=ratio,
        covariance=np.diag(variances),
        noise=0.9 * np.diag(variances),
        evidence=0.0,
        numerators=np.zeros((len(modes), 4)),
        remainder=np.zeros(0),
    )


def test_a_mode_keeps_its_name_where_a_vague_one_changes_sides() -> None:
    """By hand: the sure mode is at 0.7 × 1.0900 + 0.3 × 1.0902, and its variance is the mean one
    and 0.7 × 0.3 × 0.0002²; the vague one is at 0.7 × 1.07 + 0.3 × 1.20.
    """
    fits = [answer((1.07, 0.03), (1.0900, 1e-4)), answer((1.0902, 1e-4), (1.20, 0.04))]
    found = averaged(fits, np.array([0.7, 0.3]))
    np.testing.assert_allclose(found.mean, [[1.09006, 0.02], [1.109, 0.02]], rtol=1e-12)
    spread = 0.7 * 0.3 * 0.0002**2
    expected = np.sqrt(1e-8 + spread), np.sqrt(0.7 * 0.03**2 + 0.3 * 0.04**2 + 0.21 * 0.13**2)
    np.testing.assert_allclose(found.deviations[:, 0], expected, rtol=1e-9)
    assert found.remainders[0, 0] == pytest.approx(np.sqrt(1e-9 + spread))


def test_modes_as_sure_as_each_other_stay_in_order() -> None:
    """Two modes apart by many deviations: the mean is that of the first ones and of the second."""
    fits = [answer((0.9, 0.01), (1.2, 0.01)), answer((0.92, 0.01), (1.18, 0.01))]
    found = averaged(fits, np.array([0.5, 0.5]))
    np.testing.assert_allclose(found.mean[:, 0], [0.91, 1.19])


def test_modes_without_variance_are_paired_by_place() -> None:
    fits = [answer((0.9, 0.0), (1.2, 0.0)), answer((0.9, 0.0), (1.2, 0.0))]
    found = averaged(fits, np.array([0.5, 0.5]))
    np.testing.assert_allclose(found.mean[:, 0], [0.9, 1.2])
    np.testing.assert_allclose(found.deviations, 0, atol=1e-12)
