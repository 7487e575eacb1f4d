"""Tables of numbers in pages: integers of 16 or 32 bits, little-endian, as base64."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array


@dataclass(frozen=True, kw_only=True)
class Packed:
    """A table of numbers: in each column of ``scale``, integers of ``bits`` times its scale."""

    scale: tuple[float, ...]
    base64: str
    bits: int = 16


def packed(values: Array) -> Packed:
    """Numbers (n, m) within 1/65534 of the largest in their column."""
    table = _finite(values)
    scale = _largest(table) / (2**15 - 1)
    return _coded(table / scale, scale)


def rounded(values: Array, decimals: Sequence[int]) -> Packed:
    """Numbers (n, m) rounded as they are printed, to the decimals (m,) of their columns.

    Coarser only beyond 2³¹ last digits.
    """
    columns = zip(_finite(values).T.tolist(), decimals, strict=True)
    table = np.array([[round(value, digits) for value in column] for column, digits in columns]).T
    scale = np.maximum(10.0 ** -np.array(decimals), _largest(table) / (2**31 - 1))
    return _coded(table / scale, scale, bits=32)


def whole(values: Array) -> Packed:
    """Integers (n, m) as they are."""
    return _coded(values, np.ones(values.shape[1]))


def _finite(values: Array) -> Array:
    return np.nan_to_num(np.asarray(values, dtype=float), posinf=0.0, neginf=0.0)


def _largest(table: Array) -> Array:
    """The largest absolute value of each column (m,), 1 where all are 0."""
    most = np.abs(table).max(axis=0, initial=0.0)
    return np.where(most > 0, most, 1.0)


def _coded(values: Array, scale: Array, bits: int = 16) -> Packed:
    text = base64.b64encode(np.rint(values).astype(f"<i{bits // 8}").tobytes()).decode("ascii")
    return Packed(scale=tuple(scale.tolist()), base64=text, bits=bits)
