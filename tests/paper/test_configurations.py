"""The paper's 40 configurations in closed form, by hand and by the general machine.

Pencelli et al., "On the Estimation of Resonance Frequencies of Hydraulically Actuated Systems",
ISARC 2019, section 4.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign.paper.configurations import FORMULAS, Mechanism, error_of, grid, rms_error
from tests.paper.dimensions import (
    A1,
    A2,
    ALL,
    ARM,
    BETA,
    BOTH,
    INERTIA,
    LENGTH,
    MASS,
    RIGHT,
    V1,
    V2,
    G,
    hertz,
)


def test_forty_configurations() -> None:
    """8 masses × 5 lengths: the paper, section 4; the length runs fastest."""
    at = grid(ad.load("paper_1dof"))
    assert len(at.load_mass) == 8 * 5 == 40
    assert list(zip(at.load_mass, at.link_length, strict=True)) == ALL


def test_every_formula_by_hand(one: Mechanism) -> None:
    """200 kg at 1 m, each number from the dimensions above and from nothing else."""
    static = MASS * LENGTH / ARM  # the weight's moment over the moment arm, over g
    mean, mean_volume = (A1 + A2) / 2, (V1 + V2) / 2
    expected = {
        "static_11": hertz(2 * BETA * A1**2 / V1, static),
        "static_12_as_printed": hertz(2 * BOTH, static),
        "static_12": hertz(BOTH, static),
        "reflected_12": hertz(BOTH, INERTIA / ARM**2),
        "joint_42_as_printed": hertz(2 * BETA * A1**2 / V1 * ARM**2 - MASS * G * LENGTH, INERTIA),
        "joint_42_mean_area": hertz(
            2 * BETA * mean**2 / mean_volume * ARM**2 - MASS * G * LENGTH, INERTIA
        ),
        "joint_exact": hertz(BOTH * ARM**2 - RIGHT, INERTIA),
    }
    frequencies = {name: float(values[0]) for name, values in one.frequencies.items()}
    assert list(frequencies) == list(FORMULAS)
    assert frequencies == pytest.approx(
        expected, rel=1e-6
    )  # the file's closed length has nine digits


def test_exact_formula_is_the_general_machine_in_all_forty() -> None:
    """The machine's eigenvalue knows nothing of the paper's formulas: an independent method."""
    machine = ad.load("paper_1dof")
    exact = grid(machine).frequencies["joint_exact"]
    frequencies = []
    for mass, length in ALL:
        case = machine.replace(
            {"payload.load.mass_kg": mass, "payload.load.at_mm": [1000 * length, 0, 150]}
        )
        frequencies.append(ad.natural_modes(case.at([0.0])).frequencies[0, 0])
    assert_allclose(exact, frequencies, rtol=1e-8)


def test_order_of_the_formulas_over_all_forty() -> None:
    """The paper's finding, with margins: the static mass is an order of magnitude worse than the
    joint-coupled load.

    (11) over (42): 158.5/11.4 = 13.9; (42) from the bore area over (42) from the means: 11.4/0.18.
    """
    computed = grid(ad.load("paper_1dof")).frequencies
    errors = error_of(computed, computed["joint_exact"])
    assert errors["static_11"] > 10 * errors["joint_42_as_printed"]
    assert errors["joint_42_as_printed"] > 50 * errors["joint_42_mean_area"]
    assert errors["static_12"] > 1000 * errors["reflected_12"]
    assert errors["static_12_as_printed"] > errors["static_11"] > errors["static_12"]
    assert errors["joint_exact"] == 0


def test_rms_error_by_hand() -> None:
    """Differences of 3 and 4 Hz: √(12.5) Hz in rad/s."""
    assert rms_error([10.0, 20.0], np.array([7.0, 24.0])) == pytest.approx(
        2 * math.pi * math.sqrt(12.5)
    )
