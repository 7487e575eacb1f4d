"""Colours of actuators stay apart for people with any common colour blindness."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from armdesign.arrays import Array
from armdesign.drawing.colours import ACTUATORS

SIGHTS = {  # Machado, Oliveira & Fernandes 2009, severity 1.0, on linear red, green, blue
    "normal": np.eye(3),
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritanopia": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
}
XYZ = [  # of linear sRGB, IEC 61966-2-1
    [0.4124, 0.3576, 0.1805],
    [0.2126, 0.7152, 0.0722],
    [0.0193, 0.1192, 0.9505],
]
WHITE = np.sum(XYZ, axis=1)
APART = 15.0  # CIE 1976; 2.3 is just seen


def lab(colour: str, sight: str) -> Array:
    """CIE L*a*b* of a colour as it is seen."""
    srgb = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    seen = np.clip(np.array(SIGHTS[sight]) @ linear, 0.0, 1.0)
    share = np.array(XYZ) @ seen / WHITE
    x, y, z = np.where(share > 216 / 24389, np.cbrt(share), (24389 / 27 * share + 16) / 116)
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.parametrize("sight", SIGHTS)
def test_any_two_actuators_are_told_apart(sight: str) -> None:
    seen = [lab(colour, sight) for colour in ACTUATORS]
    assert min(np.linalg.norm(a - b) for a, b in combinations(seen, 2)) > APART


def test_white_is_white() -> None:
    np.testing.assert_allclose(lab("#ffffff", "normal"), [100, 0, 0], atol=1e-6)
