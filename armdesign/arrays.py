"""The array types of all signatures; shapes are in the docstrings, axis 0 is the pose."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[Any]  # of float, or complex where a complex step passes
Flags: TypeAlias = NDArray[np.bool_]
