"""The paper's errata: what each does to the frequency, by hand.

Pencelli et al., "On the Estimation of Resonance Frequencies of Hydraulically Actuated Systems",
ISARC 2019, section 4.
"""

from __future__ import annotations

import math

import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign.paper.configurations import Mechanism, grid
from armdesign.paper.errata import errata, errata_frame
from tests.paper.dimensions import (
    A1,
    A2,
    ARM,
    BASE,
    BETA,
    BOTH,
    INERTIA,
    LENGTH,
    MASS,
    PIN,
    RIGHT,
    SPAN2,
    V1,
    V2,
    G,
    spring,
)


def test_errata_by_hand(one: Mechanism) -> None:
    """200 kg at 1 m: each misprint put into the right formula alone; docs/errata.md lists
    them.
    """
    oil, weight = BOTH * ARM**2, MASS * G
    arm_share = PIN * LENGTH * BASE / SPAN2
    right = oil - RIGHT
    quarter = spring(A1, V1 - 0.05 * A1, A2, V2 + 0.05 * A2)  # 50 mm nearer to the bottom
    omega = math.sqrt(right / INERTIA)
    expected = {
        "(12)": math.sqrt(2),
        "(13)": None,
        "(16)": math.sqrt(INERTIA / (INERTIA + LENGTH)),
        "(27)": math.sqrt((oil - weight * (PIN - arm_share)) / right),
        "(33) ∂g/∂θ": math.sqrt((oil - weight * LENGTH) / (oil - weight * PIN)),
        "(33) −F0 ∂r/∂θ": math.sqrt((oil - weight * PIN) / right),
        "(38), (39), (42)": math.sqrt((oil - weight * LENGTH) / right),
        "(34) volumes": math.sqrt(right / (quarter * ARM**2 - RIGHT)),
        "(34) areas": math.sqrt((2 * BETA * A1**2 / V1 * ARM**2 - RIGHT) / right),
        "(40)": None,
        "(42) root": 1 / omega**2,
    }
    changes = {item.equation: item.change for item in errata(one)}
    assert {name: change is None for name, change in changes.items()} == {
        name: ratio is None for name, ratio in expected.items()
    }
    for name, change in changes.items():
        if change is not None:
            # differences of two nearly equal frequencies: the file's nine digits leave them seven
            assert float(change[0]) == pytest.approx(expected[name] - 1, rel=1e-5, abs=1e-9), name


def test_errata_over_all_forty() -> None:
    """Signs and sizes: gravity's terms are small beside the oil, the factor 2 and the areas are
    not.
    """
    frame = errata_frame(errata(grid(ad.load("paper_1dof")))).set_index("equation")
    assert_allclose(
        frame.loc["(12)", ["least", "largest"]].astype(float), math.sqrt(2) - 1, rtol=1e-12
    )
    gravity = frame.loc[["(27)", "(33) ∂g/∂θ", "(33) −F0 ∂r/∂θ", "(38), (39), (42)"]]
    assert gravity[["least", "largest"]].abs().to_numpy().max() < 0.003
    assert gravity["rms_rad_per_s"].max() < 0.1
    assert frame.loc["(42) root", "largest"] < -0.99
    assert frame.loc[["(13)", "(40)"], "least"].isna().all()
    assert (frame["least"].dropna() <= frame["largest"].dropna()).all()
