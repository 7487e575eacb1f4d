"""Linear estimates that cannot be: of quantities that are never below zero, below it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Flags


def impossible(before: ArrayLike, change: ArrayLike) -> Flags:
    """Whether values and their linear changes add up to less than zero: no value is.

    The change is too large for a straight line. NaN is no such estimate.
    """
    return np.asarray(np.add(before, change) < 0)
