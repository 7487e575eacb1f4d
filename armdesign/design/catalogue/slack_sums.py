"""Slacks that are sums over the cylinders, and which requirements exclude each other."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armdesign.arrays import Array, Flags

LOST = 1e3  # times its limit: a slack below minus this is as good as any other
ROUNDING = 1e-12  # of a slack
TOLERANCE = 1e-9  # of a slack


@dataclass(frozen=True, eq=False)
class SlackSums:
    """Slacks as sums over the cylinders.

    Attributes:
        slack: of the machine as it is placed (m,).
        changes: by each cylinder's sizes (sizes, m).
        touched: which cylinder changes which (nc, m).
    """

    slack: Array
    changes: list[Array]
    touched: Flags

    def combination(self, columns: Array) -> Array | None:
        """A combination (nc,) that meets the requirements in ``columns``; None if none does.

        Cylinder after cylinder, combinations that another beats in all that they share are
        dropped.
        """
        alone = self.touched.sum(axis=0) == 1
        shared = columns[~alone[columns]]
        reached, chosen = self.slack[None, shared], np.zeros((1, 0), dtype=int)
        for i, change in enumerate(self.changes):
            left = meeting(self.slack, change, columns[alone[columns] & self.touched[i, columns]])
            if len(left) == 0:
                return None
            left = left[_undominated(change[np.ix_(left, shared)])]
            reached = np.repeat(reached, len(left), axis=0) + np.tile(
                change[np.ix_(left, shared)], (len(reached), 1)
            )
            chosen = np.column_stack(
                [np.repeat(chosen, len(left), axis=0), np.tile(left, len(chosen))]
            )
            best = _undominated(reached)
            reached, chosen = reached[best], chosen[best]
        meets = np.flatnonzero(np.all(reached >= 0, axis=1))
        return chosen[meets[0]] if len(meets) > 0 else None

    def nearest(self, give: Array, keep: Array) -> Array | None:
        """The combination (nc,) that meets ``keep`` and misses ``give`` least; None if none can.

        Of several that do, one that misses the first of ``give`` least, then the next.
        """
        shares, every = np.zeros(len(self.slack)), np.union1d(keep, give)
        shares[give] = 2 * LOST
        best = self.eased(shares).combination(every)
        if best is None:
            return None
        for some in (give, *give[:, None]):
            low, trial, high = 0.0, 0.0, self._missed(best, some)
            while trial < high:
                shares[some] = trial
                met = self.eased(shares).combination(every)
                if met is None:
                    low = trial
                else:
                    best, high = met, self._missed(met, some)
                trial = (low + high) / 2 if high - low > TOLERANCE * (1 + high) else high
            shares[some] = high + ROUNDING * (1 + high)
        return best

    def eased(self, shares: Array) -> SlackSums:
        """The same with requirements eased by shares (m,)."""
        return replace(self, slack=self.slack + shares)

    def _missed(self, combination: Array, columns: Array) -> float:
        """The largest share by which a combination misses requirements."""
        changed = sum(
            change[o, columns] for change, o in zip(self.changes, combination, strict=True)
        )
        return float(np.maximum(-(self.slack[columns] + changed), 0.0).max())


def _undominated(points: Array) -> Array:
    """Rows of points (n, m) than which no other is at least as large in everything."""
    kept, left = [], np.arange(len(points))
    while len(left) > 0:
        best = left[points[left].sum(axis=1).argmax()]
        kept.append(best)
        left = left[np.any(points[left] > points[best], axis=1)]
    return np.array(kept)


def meeting(slack: Array, change: Array, columns: Array) -> Array:
    """Rows of ``change`` that meet the requirements in ``columns``."""
    return np.flatnonzero(np.all(slack[columns] + change[:, columns] >= 0, axis=1))


def disjoint_subsets(sums: SlackSums, columns: Array) -> list[Array]:
    """Irreducible infeasible subsets without a common requirement, until the rest can be met."""
    subsets, left = [], columns
    while sums.combination(left) is None:
        subsets.append(_irreducible_subset(sums, left))
        left = np.setdiff1d(left, subsets[-1])
    return subsets


def _irreducible_subset(sums: SlackSums, columns: Array) -> Array:
    """Requirements that no combination meets together while any one less could be met."""
    for column in columns:
        if sums.combination(np.array([column])) is None:
            return np.array([column])
    for column in columns:
        fewer = columns[columns != column]
        if sums.combination(fewer) is None:
            columns = fewer
    return columns
