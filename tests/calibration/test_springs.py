"""Springs among the unknowns."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

import armdesign as ad
from tests.sprung import rocking

STIFFNESS, BETA = "spring.carriage.stiffness_N_m_per_rad", "fluid.bulk_modulus_MPa"


def test_the_stiffness_of_a_spring_and_the_oils_modulus_are_found() -> None:
    """From the lowest and the highest of four modes at six poses, without noise."""
    truth, rows = rocking().replace({STIFFNESS: 1.7e7, BETA: 1050.0}), []
    shares = np.random.default_rng(0).uniform(0.2, 0.8, (6, 3))
    low, high = truth.ranges.T
    for q in low + shares * (high - low):
        frequencies = ad.natural_modes(truth.with_payload("empty").at(q)).frequencies[0]
        places = dict(zip(("boom_deg", "stick_deg", "bucket_deg"), np.degrees(q), strict=True))
        rows += [
            {"payload": "empty", "frequency_hz": frequencies[mode - 1], "mode": mode} | places
            for mode in (1, 4)
        ]
    calibrated = ad.calibrate(rocking(), pd.DataFrame(rows), fit=[STIFFNESS, BETA]).machine
    assert calibrated.springs[0].stiffness == pytest.approx(1.7e7, rel=1e-6)
    assert calibrated.fluid.bulk_modulus == pytest.approx(1050e6, rel=1e-6)
