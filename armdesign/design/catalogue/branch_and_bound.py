"""The best sizes of a catalogue for given pins, and the proof that no combination is better.

Stiffness is a sum over the cylinders, K = K_0 + Σ_i k_i r_i r_iᵀ, whose k_i is a number of the
chosen size; motors are in K_0. Letting the choice be a mixture of sizes (weights that add up to 1)
makes it a semidefinite programme. Its multipliers, Z_j ⪰ 0 with Σ tr Z_j = 1 for the poses and y ≥
0 for the shared requirements, bound the lowest ω² of all allowed combinations by

    λ ≤ Σ_j ⟨Z_j, K_0j⟩ + y·slack + Σ_i h_i(size i),   h_i = Σ_j k_ij r_ijᵀ Z_j r_ij + y·change_i

(weak duality, whatever the solver did; everything in the frame of M's Cholesky factor). So one
cylinder after the other is branched on, branches whose bound lies below what is reached are cut,
and what is left is evaluated exactly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from armdesign.arrays import Array
from armdesign.design.catalogue.separable import Choices
from armdesign.design.catalogue.sizes import Sizes
from armdesign.design.search.semidefinite import certificate, contradicted, programme
from armdesign.errors import InfeasibleError
from armdesign.frequency.bands import Bands
from armdesign.frequency.cases import load_cases
from armdesign.frequency.modes import hertz, inverse_cholesky
from armdesign.frequency.workspace import Workspace
from armdesign.hydraulics.fluid import Fluid
from armdesign.hydraulics.supply import Supply
from armdesign.machine.machine import Machine

ROWS = 16  # poses in one programme
COLUMNS = 8  # sizes of a cylinder in one programme
ROUNDS = 20  # of the relaxation
# lowest poses on which the relaxation is looked at, and four times as many all over the workspace
WATCHED = 300
LIMIT = 50_000  # combinations kept at a time
BATCH = 2_000  # combinations evaluated at a time


@dataclass(frozen=True, eq=False, kw_only=True)
class Selection:
    """The best combination found: bore and rod of every cylinder [m].

    Attributes:
        sizes: bore and rod of every cylinder [m].
        frequency: its worst frequency on the workspace's poses [Hz].
        bound: worst frequency that no combination exceeds [Hz]; equal to ``frequency`` where it is
            proved the best, infinite where nothing is proved.
        below: of what ``least`` chose: worst frequency that no combination exceeds which needs
            less [Hz]; it is proved the least where that is lower than the one asked for. None for
            the others.
    """

    sizes: Sizes
    frequency: float
    bound: float
    below: float | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Loads:
    """Poses with a load case, in the frame of L⁻¹, M = L Lᵀ, over a reference ω²: what sizes do not change.

    extension, force (n, nc); arm L⁻¹r (n, nc, nq); rest L⁻¹K_0 L⁻ᵀ (n, nq, nq); lowest ω² of the
    frame (n,).
    """

    extension: Array
    force: Array
    arm: Array
    rest: Array
    lowest: Array

    def __getitem__(self, rows: Array) -> Loads:
        return Loads(**{name: value[rows] for name, value in vars(self).items()})


def select(offered: Choices, bands: Bands | None = None) -> Selection:
    """The sizes that raise the lowest frequency most, among all combinations that meet the requirements.

    Args:
        offered: cylinders to choose from, on a machine whose pins, strokes and oil count.
        bands: what is not known exactly: the worst frequency within them counts; None: all is
            exact.

    Raises:
        InfeasibleError: no combination meets the requirements.
    """
    bands = bands or Bands()
    frame = offered.judge.frame
    soft = bands.with_oil(frame, softest=True)
    cylinders = tuple(
        tuple(bands.with_largest_volumes(c) for c in options) for options in offered.cylinders
    )
    loads, reference = _loads(soft, offered.judge.workspace, bands.mass_shares(frame))
    hunt = _Hunt(
        choices=replace(offered, cylinders=cylinders), loads=loads, reference=reference, frame=soft
    )
    best, bound, chosen = hunt.best()
    sizes = [options[o] for options, o in zip(offered.cylinders, chosen, strict=True)]
    return Selection(
        sizes=tuple((c.bore, c.rod) for c in sizes),
        frequency=hertz(best * reference),
        bound=hertz(bound * reference),
    )


def _loads(
    frame: Machine, workspace: Workspace, masses: Sequence[tuple[float, float]]
) -> tuple[Loads, float]:
    """Every pose and load case at shares of payload and link mass, and the ω² that they are measured by."""
    parts = []
    nc = len(frame.cylinders)
    closed = np.array([c.closed_length for c in frame.cylinders])
    cases = (case for shares in masses for case in load_cases(frame, workspace, *shares))
    for case in cases:
        poses = case.evaluate()
        inverse = inverse_cholesky(poses.mass_matrix)
        turned = np.swapaxes(inverse, 1, 2)
        arms, oil = poses.moment_arms[:, :nc], poses.oil_stiffness[:, :nc]
        own = np.swapaxes(arms, 1, 2) @ (arms * oil[:, :, None])
        lowest = np.linalg.eigvalsh(inverse @ poses.stiffness_matrix @ turned)[:, 0]
        rest = inverse @ (poses.stiffness_matrix - own) @ turned
        parts.append(
            (
                poses.lengths[:, :nc] - closed,
                poses.cylinder_forces[:, :nc],
                arms @ turned,
                rest,
                lowest,
            )
        )
    extension, force, arm, rest, lowest = (
        np.concatenate(part) for part in zip(*parts, strict=True)
    )
    reference = float(max(lowest.min(), 0.01 * np.median(np.abs(lowest))))
    scaled = {
        "arm": arm / math.sqrt(reference),
        "rest": rest / reference,
        "lowest": lowest / reference,
    }
    return Loads(extension=extension, force=force, **scaled), reference


@dataclass(frozen=True, eq=False)
class _Worth:
    """λ ≤ constant + Σ_i of[i][size i] for every allowed combination."""

    constant: float
    of: list[Array]

    @property
    def bound(self) -> float:
        """Of all combinations."""
        return float(self.constant + sum(worth.max() for worth in self.of))

    @property
    def least(self) -> float:
        """The smallest bound of a combination."""
        return float(self.constant + sum(worth.min() for worth in self.of))


@dataclass(eq=False, kw_only=True)
class _Hunt:
    """The state of one search: poses that have been lowest (``low``), and the stiffness of all sizes there."""

    choices: Choices
    loads: Loads
    reference: float
    frame: Machine
    low: Loads = field(init=False)
    oil: list[Array] = field(init=False)  # of each cylinder (sizes, low poses)

    def best(self) -> tuple[float, float, Array]:
        """Lowest λ of the best combination, the bound on all others, and its sizes (nc,).

        The bound is infinite where the best exceeds what the multipliers say of all.
        """
        worth, rows = self._relaxed()
        self.low = self.loads[rows]
        self.oil = self._oil(self.low)
        reached, chosen, depth, tried = -math.inf, np.zeros(0, dtype=int), 0.01, math.inf
        while True:
            threshold = max(reached, worth.bound - depth * max(abs(worth.bound), 1.0))
            combinations, bounds, missed = self._above(worth, threshold)
            fresh = bounds < tried
            reached, chosen = self._try(combinations[fresh], bounds[fresh], reached, chosen)
            if reached >= threshold or missed > reached or threshold < worth.least:
                break
            depth, tried = 3 * depth, threshold
        if len(chosen) == 0:
            raise self.choices.refusal(
                f"none of {self._count} combinations is allowed, as far as tried"
            )
        return (
            reached,
            math.inf if contradicted(worth.bound, reached) else max(reached, missed),
            chosen,
        )

    # ---------------------------------------------------------------------------------- relaxation

    def _relaxed(self) -> tuple[_Worth, Array]:
        """The best bound of a few programmes of few sizes at few poses each, and the poses that mattered."""
        order = np.argsort(self.loads.lowest)
        spread = np.arange(0, len(order), max(1, len(order) // (4 * WATCHED)))
        watched = np.unique(np.concatenate([order[:WATCHED], spread]))
        loads = self.loads[watched]
        oil = self._oil(loads)
        rows = np.argsort(loads.lowest)[:: max(1, min(WATCHED, len(watched)) // ROWS)][:ROWS]
        rows = np.resize(rows, ROWS)  # a programme has one shape: a pose may stand in it twice
        columns = [np.unique(np.linspace(0, len(k) - 1, COLUMNS).astype(int)) for k in oil]
        best = self._worth(
            np.broadcast_to(np.eye(loads.rest.shape[1]), loads.rest[rows].shape),
            None,
            loads,
            oil,
            rows,
        )
        mattered = {int(row) for row in rows}
        for _ in range(ROUNDS):
            try:
                weights, y, mixture = self._programme(loads, oil, rows, columns)
            except InfeasibleError:  # the solver gave up: what is known so far still holds
                break
            worth = self._worth(weights, y, loads, oil, rows)
            best = min(best, worth, key=lambda w: w.bound)
            lowest = self._lowest(
                loads,
                np.stack([mix @ k[c] for mix, k, c in zip(mixture, oil, columns, strict=True)]),
            )
            if best.bound - lowest.min() < 1e-4 * max(abs(best.bound), 1.0):
                break
            rows = self._other_rows(rows, weights, lowest)
            columns = [
                self._other_columns(c, m, h)
                for c, m, h in zip(columns, mixture, worth.of, strict=True)
            ]
            mattered |= {int(row) for row in rows}
        return best, watched[sorted(mattered)]

    def _programme(
        self, loads: Loads, oil: list[Array], rows: Array, columns: list[Array]
    ) -> tuple[Array, Array, list[Array]]:
        """Multipliers Z of the poses, y of the shared requirements, and the best mixture of sizes in ``columns``."""
        nc, m = len(columns), len(self.choices.slack)
        slopes = np.zeros((nc * COLUMNS, ROWS, *loads.rest.shape[1:]))
        jacobian, high = np.zeros((m + 2 * nc, nc * COLUMNS)), np.zeros(nc * COLUMNS)
        arm = loads.arm[rows]
        for i, chosen in enumerate(columns):
            at = slice(i * COLUMNS, i * COLUMNS + len(chosen))
            slopes[at] = oil[i][chosen][:, rows, None, None] * np.einsum(
                "na,nb->nab", arm[:, i], arm[:, i]
            )
            jacobian[:m, at] = self.choices.changes[i][chosen].T
            jacobian[m + i, at], jacobian[m + nc + i, at], high[at] = -1.0, 1.0, 1.0
        value = np.concatenate([self.choices.slack, np.ones(nc), -np.ones(nc)])
        step = programme(ROWS, loads.rest.shape[1], len(value), len(high)).solve(
            loads.rest[rows], slopes, value, jacobian, np.zeros(len(high)), high
        )
        mixture = [step.change[i * COLUMNS : i * COLUMNS + len(c)] for i, c in enumerate(columns)]
        mixture = [
            mix / mix.sum() if mix.sum() > 0 else np.full(len(mix), 1 / len(mix))
            for mix in mixture
        ]
        return certificate(step), step.multipliers[:m], mixture

    def _worth(
        self, weights: Array, y: Array | None, loads: Loads, oil: list[Array], rows: Array
    ) -> _Worth:
        """What multipliers say about all sizes."""
        weights = weights / np.trace(weights, axis1=1, axis2=2).sum()
        y = np.zeros(len(self.choices.slack)) if y is None else y
        per_stiffness = np.einsum("nca,nab,ncb->cn", loads.arm[rows], weights, loads.arm[rows])
        constant = np.einsum("nab,nab->", weights, loads.rest[rows]) + y @ self.choices.slack
        of = [
            k[:, rows] @ p + d @ y
            for k, p, d in zip(oil, per_stiffness, self.choices.changes, strict=True)
        ]
        return _Worth(float(constant), of)

    @staticmethod
    def _other_rows(rows: Array, weights: Array, lowest: Array) -> Array:
        """Poses for the next programme: those that carried weight, and the lowest of the last mixture."""
        carried = rows[np.argsort(-np.trace(weights, axis1=1, axis2=2))][: ROWS // 2]
        wanted = dict.fromkeys([*map(int, carried), *map(int, np.argsort(lowest)[:ROWS])])
        return np.resize(np.array(list(wanted)[:ROWS]), ROWS)

    @staticmethod
    def _other_columns(columns: Array, mixture: Array, worth: Array) -> Array:
        """Sizes for the next programme: those in the mixture, and those that the multipliers value most."""
        used = columns[np.argsort(-mixture)][: max(2, int((mixture > 1e-4).sum()))][: COLUMNS // 2]
        wanted = dict.fromkeys([*map(int, used), *map(int, np.argsort(-worth)[:COLUMNS])])
        return np.array(list(wanted)[:COLUMNS])

    # -------------------------------------------------------------------------------- combinations

    @property
    def _count(self) -> int:
        return math.prod(len(options) for options in self.choices.cylinders)

    def _above(self, worth: _Worth, threshold: float) -> tuple[Array, Array, float]:
        """Allowed combinations (k, nc) whose bound reaches a threshold, the bounds, and that of the best left out."""
        chosen, bounds, missed = np.zeros((1, 0), dtype=int), np.array([worth.constant]), -math.inf
        slack = self.choices.slack[None]
        for i, (value, change) in enumerate(zip(worth.of, self.choices.changes, strict=True)):
            ahead = sum(float(later.max()) for later in worth.of[i + 1 :])
            room = sum(
                (later.max(axis=0) for later in self.choices.changes[i + 1 :]),
                np.zeros(len(self.choices.slack)),
            )
            total = bounds[:, None] + value
            fits = total + ahead >= threshold
            for k in range(slack.shape[1]):
                fits &= slack[:, None, k] + change[:, k] + room[k] >= 0
            before, size = np.nonzero(fits)
            if len(before) > LIMIT:
                order = np.argsort(-total[before, size])
                missed = max(missed, float(total[before, size][order[LIMIT]]) + ahead)
                before, size = before[order[:LIMIT]], size[order[:LIMIT]]
            chosen = np.column_stack([chosen[before], size])
            bounds, slack = total[before, size], slack[before] + change[size]
        return chosen, bounds, missed

    def _try(
        self, combinations: Array, bounds: Array, reached: float, chosen: Array
    ) -> tuple[float, Array]:
        """The best of the combinations, evaluated exactly in the order of their bounds.

        Or what was reached before.
        """
        order = np.argsort(-bounds, kind="stable")
        for start in range(0, len(order), BATCH):
            batch = order[start : start + BATCH]
            if bounds[batch[0]] < reached:
                break
            values = self._at_low_poses(combinations[batch])
            values[~self.choices.allowed(combinations[batch])] = -math.inf
            while values.max() > reached:
                first = int(values.argmax())
                found = self._everywhere(combinations[batch[first]])
                if found > reached:
                    reached, chosen = found, combinations[batch[first]]
                values = np.minimum(
                    values, self._at_low_poses(combinations[batch], len(self.low.rest) - 1)
                )
                values[first] = -math.inf
        return reached, chosen

    def _at_low_poses(self, combinations: Array, first: int = 0) -> Array:
        """Lowest λ of combinations at the poses that have been lowest so far (from the one numbered ``first``)."""
        low = self.low[np.arange(first, len(self.low.rest))]
        parts = []
        for part in np.array_split(
            combinations, max(1, len(combinations) * len(low.rest) // 100_000)
        ):
            oil = np.stack([k[size, first:] for k, size in zip(self.oil, part.T, strict=True)])
            parts.append(self._lowest(low, oil).min(axis=1))
        return np.concatenate(parts)

    def _everywhere(self, combination: Array) -> float:
        """Lowest λ of one combination over all poses.

        The lowest pose joins those that have been.
        """
        cylinders = [
            options[o] for options, o in zip(self.choices.cylinders, combination, strict=True)
        ]
        one = replace(self.choices, cylinders=tuple((c,) for c in cylinders))
        lowest = self._lowest(
            self.loads, np.stack([k[0] for k in _oil(one, self.loads, *self._medium)])
        )
        row = int(lowest.argmin())
        self.low = Loads(
            **{
                name: np.concatenate([value, vars(self.loads)[name][[row]]])
                for name, value in vars(self.low).items()
            }
        )
        self.oil = [
            np.hstack(pair)
            for pair in zip(self.oil, self._oil(self.loads[np.array([row])]), strict=True)
        ]
        return float(lowest[row])

    @property
    def _medium(self) -> tuple[Fluid, Supply]:
        return self.frame.fluid, self.frame.supply

    def _oil(self, loads: Loads) -> list[Array]:
        return _oil(self.choices, loads, *self._medium)

    @staticmethod
    def _lowest(loads: Loads, oil: Array) -> Array:
        """Lowest eigenvalue of K_0 + Σ k r rᵀ with stiffnesses (nc, …, n)."""
        matrix = np.broadcast_to(loads.rest, (*oil.shape[1:], *loads.rest.shape[1:])).copy()
        for i, k in enumerate(oil):
            matrix += k[..., None, None] * np.einsum(
                "na,nb->nab", loads.arm[:, i], loads.arm[:, i]
            )
        matrix[~np.isfinite(matrix).all(axis=(-2, -1))] = 0.0
        return np.asarray(np.linalg.eigvalsh(matrix)[..., 0])


def _oil(offered: Choices, loads: Loads, fluid: Fluid, supply: Supply) -> list[Array]:
    """Oil stiffness of every size of each cylinder at every pose, (sizes, n) [N/m]."""
    return [
        np.stack(
            [c.stiffness(loads.extension[:, i], loads.force[:, i], fluid, supply) for c in options]
        )
        for i, options in enumerate(offered.cylinders)
    ]
