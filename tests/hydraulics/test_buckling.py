"""Buckling of stepped columns: limiting cases, a beam of finite elements, derivatives."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq

from armdesign.hydraulics.cylinder_build import (
    STEEL_MODULUS,
    euler_load,
    euler_safety,
    second_moment,
    stepped_load,
)

ROD = math.pi * 0.07**4 / 64


def by_finite_elements(i1: float, i2: float, l1: float, l2: float, elements: int = 30) -> float:
    """Smallest buckling load of a pinned beam: cubic elements, bending against geometric
    stiffness.
    """
    lengths = [l1 / elements] * elements + [l2 / elements] * elements
    inertia = [i1] * elements + [i2] * elements
    size = 2 * (len(lengths) + 1)
    bending, geometric = np.zeros((size, size)), np.zeros((size, size))
    for k, (h, i) in enumerate(zip(lengths, inertia, strict=True)):
        at = slice(2 * k, 2 * k + 4)
        bending[at, at] += (STEEL_MODULUS * i / h**3) * np.array(
            [[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h],
             [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h * h, -6 * h, 4 * h * h]]
        )  # fmt: skip
        geometric[at, at] += 1 / (30 * h) * np.array(
            [[36, 3 * h, -36, 3 * h], [3 * h, 4 * h * h, -3 * h, -h * h],
             [-36, -3 * h, 36, -3 * h], [3 * h, -h * h, -3 * h, 4 * h * h]]
        )  # fmt: skip
    free = np.setdiff1d(np.arange(size), [0, size - 2])
    pick = np.ix_(free, free)
    return 1 / float(eigh(geometric[pick], bending[pick], eigvals_only=True)[-1])


def test_second_moment_and_euler() -> None:
    """π d⁴/64, less the bore; π² E I/L² over the thrust is the package's Euler safety."""
    assert second_moment(0.07) == pytest.approx(ROD, rel=1e-15)
    assert second_moment(0.1, 0.08) == pytest.approx(math.pi / 64 * (0.1**4 - 0.08**4), rel=1e-14)
    load = euler_load(ROD, 2.0) / (300e5 * math.pi / 4 * 0.1**2)
    assert load == pytest.approx(euler_safety(0.1, 0.07, 2.0, 300e5), rel=1e-14)


def test_euler_safety_by_hand() -> None:
    """π² 210e9 I/L² over p A for a 50 mm rod in a 100 mm bore at 100 bar."""
    load = math.pi**2 * 210e9 * (math.pi * 0.05**4 / 64) / 2.0**2
    assert euler_safety(0.1, 0.05, 2.0, 100e5) == pytest.approx(
        load / (100e5 * math.pi * 0.05**2), rel=1e-12
    )


@pytest.mark.parametrize("split", [0.1, 0.5, 0.8])
def test_equal_parts_are_one_column(split: float) -> None:
    assert stepped_load(ROD, ROD, 3 * split, 3 * (1 - split)) == pytest.approx(
        euler_load(ROD, 3.0), rel=1e-13
    )


def test_rigid_barrel() -> None:
    """A rod on a rigid bar as long as itself: tan y = −y, y = k L, by hand; 2.0288 is its smallest
    root.
    """
    y = brentq(lambda y: math.tan(y) + y, 1.6, 3.1)
    assert y == pytest.approx(2.0288, abs=1e-4)
    load = stepped_load(1e6 * ROD, ROD, 1.2, 1.2)
    assert load == pytest.approx(y**2 * STEEL_MODULUS * ROD / 1.2**2, rel=1e-5)


@pytest.mark.parametrize(
    ("ratio", "l1", "l2"), [(4.0, 1.5, 1.5), (10.0, 1.0, 2.0), (0.3, 2.0, 0.7), (50.0, 2.5, 0.5)]
)
def test_against_finite_elements(ratio: float, l1: float, l2: float) -> None:
    """An independent method; 1e-5 for its 60 elements. Also between the two uniform columns."""
    load = float(stepped_load(ratio * ROD, ROD, l1, l2))
    assert load == pytest.approx(by_finite_elements(ratio * ROD, ROD, l1, l2), rel=1e-5)
    ends = sorted((euler_load(ROD, l1 + l2), euler_load(ratio * ROD, l1 + l2)))
    assert ends[0] < load < ends[1]


def test_complex_step_is_the_derivative() -> None:
    at = np.array([5 * ROD, ROD, 1.4, 1.6])
    for k in range(4):
        step = np.zeros(4)
        step[k] = 1e-4 * at[k]
        central = (stepped_load(*(at + step)) - stepped_load(*(at - step))) / (2 * step[k])
        stepped = at.astype(complex)
        stepped[k] += 1e-30j
        assert stepped_load(*stepped).imag / 1e-30 == pytest.approx(float(central), rel=1e-6)


def test_elementwise() -> None:
    loads = stepped_load(np.array([2 * ROD, 5 * ROD]), ROD, 1.0, np.array([1.0, 2.0]))
    assert loads[1] == pytest.approx(float(stepped_load(5 * ROD, ROD, 1.0, 2.0)), rel=1e-14)
    assert loads.shape == (2,)
