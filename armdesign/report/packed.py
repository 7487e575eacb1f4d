"""Tables of numbers in pages: integers of 16 bits, little-endian, as base64."""

from __future__ import annotations

import base64
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array


@dataclass(frozen=True, kw_only=True)
class Packed:
    """A table of numbers: rows of ``scale`` columns, each an integer times its scale."""

    scale: tuple[float, ...]
    base64: str


def packed(values: Array, steps: ArrayLike = 0.0) -> Packed:
    """Numbers (n, m) as integers with a scale for each column.

    Where ``steps`` (m,) are not 0, they are rounded to whole ones, or to multiples of these where
    a column needs them: to the digits that other tables have.
    """
    table = np.nan_to_num(np.asarray(values, dtype=float), posinf=0.0, neginf=0.0)
    most = np.abs(table).max(axis=0, initial=0.0)
    finest = np.where(most > 0, most, 1.0) / (2**15 - 1)
    step = np.broadcast_to(steps, finest.shape)
    multiples = step * np.maximum(np.ceil(finest / np.where(step > 0, step, 1.0)), 1.0)
    scale = np.where(step > 0, multiples, finest)
    return _coded(table / scale, scale)


def whole(values: Array) -> Packed:
    """Integers (n, m) as they are."""
    return _coded(values, np.ones(values.shape[1]))


def _coded(values: Array, scale: Array) -> Packed:
    text = base64.b64encode(np.rint(values).astype("<i2").tobytes()).decode("ascii")
    return Packed(scale=tuple(scale.tolist()), base64=text)
