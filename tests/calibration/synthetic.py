"""Measurements that a machine would give, computed through the front door alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import armdesign as ad
from armdesign.arrays import Array
from armdesign.machine import template

BETA, AIR = "fluid.bulk_modulus_MPa", "fluid.entrained_air_percent"
LIFT, TILT = (f"cylinder.{name}.compliance_m_per_N" for name in ("lift", "tilt"))
TRUTH = {BETA: 1050.0, LIFT: 4.0e-8}


def crane() -> ad.Machine:
    """The shipped crane without air, rigid but for its oil."""
    return ad.load("loader_crane").replace({AIR: 0.0, LIFT: 0.0, BETA: 1200.0})


def lifter() -> ad.Machine:
    """Two joints, ``[links]``."""
    text = template.new("lifter", links=2)
    return ad.Machine.from_text(text, "", Path("lifter.toml"))


def poses(count: int = 8) -> Array:
    """Joint positions over the lift cylinder's stroke, two of the tilt's, two extensions."""
    machine = crane()
    low, high = machine.ranges.T
    shares = np.column_stack(
        [
            np.linspace(0.1, 0.9, count),
            np.arange(count) % 2 * 0.4 + 0.3,
            np.arange(count) % 3 * 0.4,
        ]
    )
    return low + shares * (high - low)


def measurements(
    machine: ad.Machine, q: Array, noise: float = 0.0, seed: int = 0, **more: Any
) -> pd.DataFrame:
    """The lowest frequencies at q (n, nq), with relative noise of the deviation that is told."""
    rows = []
    random = np.random.default_rng(seed)
    for n, one in enumerate(q):
        payload = ("empty", "full")[n % 2]
        frequency = ad.natural_modes(machine.with_payload(payload).at(one)).frequencies[0, 0]
        rows.append(
            {
                "payload": payload,
                "lift_boom_deg": np.degrees(one[0]),
                "tilt_boom_deg": np.degrees(one[1]),
                "extension_mm": 1e3 * one[2],
                "frequency_hz": frequency * np.exp(noise * random.standard_normal()),
                "deviation_hz": max(noise, 1e-6) * frequency,
                **more,
            }
        )
    return pd.DataFrame(rows)
