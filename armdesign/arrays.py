"""Array types of all signatures (axis 0 is the pose); chunks, rows, weighted percentiles."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from functools import wraps
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array: TypeAlias = NDArray[Any]  # of float, or complex where a complex step passes
Numbers: TypeAlias = Any  # a number or an array, or an interval where a bound is proved
Flags: TypeAlias = NDArray[np.bool_]
T = TypeVar("T")

# poses, whose arrays the cache of a core holds; a power of two would put all components of a
# matrix onto the same lines of a cache
CHUNK = 5_000


class ReadOnly:
    """Base of dataclasses whose arrays, also in mappings and tuples, cannot be written to.

    They are views: the arrays of who made one stay his to write to.
    """

    def __post_init__(self) -> None:
        self.__setstate__(vars(self))

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Copies, and what was pickled, are read-only, too."""
        vars(self).update({name: _read_only(value) for name, value in state.items()})


def _read_only(value: Any) -> Any:
    if isinstance(value, np.ndarray) and value.flags.writeable:
        value = value.view()
        value.setflags(write=False)
    elif type(value) is tuple:
        return tuple(map(_read_only, value))
    elif type(value) is dict:
        return {key: _read_only(one) for key, one in value.items()}
    return value


def read_only(method: Callable[[Any], T]) -> Callable[[Any], T]:
    """Decorator of what is computed once: arrays of the result cannot be written to."""

    @wraps(method)
    def locked(self: Any) -> Any:
        return _read_only(method(self))

    return locked


def remembered(method: Callable[[Any, Array], T]) -> Callable[[Any, Array], T]:
    """Decorator of a method of an array: its result for the last array is remembered."""
    name = f"_last_{method.__name__}"

    @wraps(method)
    def recalled(self: Any, x: Array) -> T:
        key = x.tobytes()
        last: tuple[bytes, T] | None = vars(self).get(name)
        if last is None or last[0] != key:
            last = vars(self)[name] = key, method(self, x)
        return last[1]

    return recalled


def mesh(axes: Iterable[Array]) -> Array:
    """All combinations of the axes' values (n, k), last axis fastest."""
    axes = tuple(axes)
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))


def sobol(dimensions: int, count: int, seed: int) -> Array:
    """Points (count, dimensions) of a scrambled Sobol sequence in the unit cube."""
    from scipy.stats import qmc

    sequence = qmc.Sobol(dimensions, rng=np.random.default_rng(seed))
    return np.asarray(sequence.random_base2(math.ceil(math.log2(count)))[:count])


def chunks(count: int, size: int | None = None) -> Iterator[slice]:
    """Slices of at most ``size`` or ``CHUNK`` rows that cover ``count``; an empty one for none."""
    size = size or CHUNK
    return (slice(start, min(start + size, count)) for start in range(0, max(count, 1), size))


def stacked(parts: Iterable[T], count: int) -> T:
    """One dataclass of ``count`` rows from parts of its arrays, each released once copied.

    Fields that are no arrays come from the first part.
    """
    parts = iter(parts)
    part = next(parts)
    names = [field.name for field in fields(part)]  # type: ignore[arg-type]
    values: dict[str, Any] = {name: getattr(part, name) for name in names}
    arrays = {name: value for name, value in values.items() if isinstance(value, np.ndarray)}
    row = len(next(iter(arrays.values())))
    if row == count:
        return part
    whole = {}
    for name, array in arrays.items():
        whole[name] = np.empty_like(array, shape=(count, *array.shape[1:]))
        whole[name][:row] = array
    for part in parts:
        end = row
        for name, target in whole.items():
            array = getattr(part, name)
            end = row + len(array)
            target[row:end] = array
        row = end
    return type(part)(**values | whole)


def by_columns(rows: Sequence[Mapping[str, object]]) -> dict[str, Array]:
    """Columns (n,) by name of rows by name; NaN where a row has none of a name."""
    names = dict.fromkeys(name for row in rows for name in row)
    columns = {name: [row.get(name, np.nan) for row in rows] for name in names}
    texts = {name for name in names if any(isinstance(cell, str) for cell in columns[name])}
    return {n: np.array(c, dtype=object if n in texts else None) for n, c in columns.items()}


def product(a: Array, b: Array) -> Array:
    """A B (…, i, k) of many small matrices (…, i, j) and (…, j, k).

    Sums over numbers that lie side by side, pose after pose. BLAS, one matrix after the other, is
    slower up to four rows, and as each waits for its lock, two threads take longer than one.
    """
    if a.shape[:-2] == b.shape[:-2] == (1,):  # einsum adds up in another order than of more
        return product(np.repeat(a, 2, axis=0), np.repeat(b, 2, axis=0))[:1]
    left, right = components_first(a), components_first(b)
    return poses_first(np.einsum("ij...,jk...->ik...", left, right))


def congruent(turn: Array, matrix: Array) -> Array:
    """T A Tᵀ (…, i, i) of T (…, i, j) and A (…, j, j)."""
    return product(product(turn, matrix), np.swapaxes(turn, -1, -2))


def positive_definite(matrices: Array) -> bool:
    """Whether symmetric matrices (n, k, k) all are, by their pivots."""
    rows = np.array(components_first(matrices))
    for j in range(len(rows)):
        if not (rows[j, j] > 0).all():
            return False
        rows[j + 1 :, j + 1 :] -= (rows[j + 1 :, j] / rows[j, j])[:, None] * rows[j, j + 1 :]
    return True


def components_first(matrices: Array) -> Array:
    """Matrices (…, i, j) as an array (i, j, …), numbers of a component side by side in memory."""
    components = matrices.transpose(-2, -1, *range(matrices.ndim - 2))
    if components.strides[-1] == components.itemsize:
        return components
    return np.ascontiguousarray(components)


def poses_first(components: Array) -> Array:
    """An array (i, j, …) as a view (…, i, j)."""
    return components.transpose(*range(2, components.ndim), 0, 1)


def in_columns(parts: Sequence[Array]) -> Array:
    """Arrays (n, …) as one (n, m, …), numbers of a component side by side in memory."""
    return np.stack([part.T for part in parts], axis=parts[0].ndim - 1).T


def side_by_side(values: Iterable[Any]) -> Array:
    """Numbers along the last axis (k,), read-only; of machines that differ row by row (n, k).

    Each of the k values is one number, or one for each of n rows.
    """
    columns = list(values)
    rows = next((column.shape for column in columns if isinstance(column, np.ndarray)), ())
    together = np.empty((*rows, len(columns)), np.result_type(float, *columns))
    for k, column in enumerate(columns):
        together[..., k] = column
    together.setflags(write=False)
    return together


def percentiles(
    values: Array, weights: Array, percents: Sequence[float] | Array, groups: Array | None = None
) -> Array:
    """Percentiles (k,) of values (n,) with weights (n,) ≥ 0, linear between neighbours.

    0 % and 100 % are least and greatest of all values, also of weight zero; equal weights give
    ``np.percentile``, and so do weights that are all zero. Infinite values are allowed.

    Args:
        values: of which.
        weights: of the values.
        percents: (k,) [%].
        groups: number of the group of each value (n,): percentiles (m, k) of each of the m groups
            that there are, in ascending order; None: all are one.
    """
    group = np.zeros(len(values), dtype=int) if groups is None else groups
    order = np.lexsort((values, group))
    values, weights = values[order], weights[order]
    _, first, which, counts = np.unique(group[order], True, True, True)
    last = first + counts - 1
    weights = np.where((np.add.reduceat(weights, first) > 0)[which], weights, 1.0)
    place = np.cumsum(weights) - weights / 2
    shares = np.asarray(percents, dtype=float) / 100
    at = place[first, None] + shares * (place[last] - place[first])[:, None]
    ends = (np.minimum(first + 1, last)[:, None], last[:, None])
    after = np.clip(np.searchsorted(place, at), *ends)
    before = np.maximum(after - 1, first[:, None])
    step = place[after] - place[before]
    part = np.clip((at - place[before]) / np.where(step > 0, step, 1.0), 0.0, 1.0)
    mixed = np.zeros_like(at)
    for rows, share in ((before, 1 - part), (after, part)):
        mixed += np.where(share > 0, values[rows], 0.0) * share
    extremes = np.where(shares < 0.5, values[first, None], values[last, None])
    spread = np.where((shares > 0) & (shares < 1), mixed, extremes)
    return spread[0] if groups is None else spread


def weighted_share(flags: Flags, weights: Array) -> float:
    """Share of true flags (n,) by weights (n,) ≥ 0, or by number if all weights are zero."""
    return float(np.average(flags, weights=weights if weights.any() else None))


def unmasked(values: ArrayLike) -> Array:
    """Values as floats, NaN where NumPy masks them.

    Raises:
        TypeError, ValueError: a value is no number.
    """
    return np.asarray(np.ma.filled(np.ma.asarray(values, dtype=float), np.nan))
