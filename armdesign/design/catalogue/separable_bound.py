"""An upper bound on the frequency of every combination of sizes, as a sum over the cylinders.

Stiffness is a sum over the cylinders, K = K_0 + Σ_i k_i r_i r_iᵀ, whose k_i is a number of the
chosen size; motors are in K_0. Letting the choice be a mixture of sizes (weights that add up to 1)
makes it a semidefinite programme. Its multipliers, Z_j ⪰ 0 with Σ tr Z_j = 1 for the poses and y ≥
0 for the shared requirements, bound the lowest ω² of all allowed combinations by

    λ ≤ Σ_j ⟨Z_j, K_0j⟩ + y·slack + Σ_i h_i(size i),   h_i = Σ_j k_ij r_ijᵀ Z_j r_ij + y·change_i

(weak duality, whatever the solver did; everything in the frame of M's Cholesky factor).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armdesign.arrays import Array, congruent
from armdesign.design.catalogue.separable import AllowedSizes
from armdesign.design.program.corners import Corners
from armdesign.design.search.semidefinite import certificate, programme
from armdesign.errors import InfeasibleError
from armdesign.frequency.cases import load_cases
from armdesign.frequency.modes import inverse_cholesky
from armdesign.hydraulics.actuator import Cylinder
from armdesign.machine.machine import Machine


@dataclass(frozen=True, eq=False, kw_only=True)
class ScaledPoses:
    """Poses with a load case, in the frame of L⁻¹, M = L Lᵀ, over a reference ω²."""

    end: Array  # index (n,) of the end of oil and structure of ``Corners``
    extension: Array  # of every cylinder (n, nc) [m]
    force: Array  # static forces (n, nc) [N]
    arm: Array  # L⁻¹r (n, nc, nq)
    without_oil: Array  # L⁻¹K_0 L⁻ᵀ (n, nq, nq), all stiffness but the cylinders' oil
    lowest: Array  # lowest ω² with today's sizes (n,)

    def __getitem__(self, rows: Array) -> ScaledPoses:
        return ScaledPoses(**{name: value[rows] for name, value in vars(self).items()})

    def __len__(self) -> int:
        return len(self.lowest)

    def joined(self, other: ScaledPoses) -> ScaledPoses:
        """These poses and others."""
        pairs = ((name, (value, getattr(other, name))) for name, value in vars(self).items())
        return ScaledPoses(**{name: np.concatenate(pair) for name, pair in pairs})

    def lowest_with(self, oil: Array) -> Array:
        """Lowest eigenvalue of K_0 + Σ k r rᵀ with oil stiffnesses (nc, …, n)."""
        shape = *oil.shape[1:], *self.without_oil.shape[1:]
        matrix = np.broadcast_to(self.without_oil, shape).copy()
        for i, k in enumerate(oil):
            matrix += k[..., None, None] * np.einsum("na,nb->nab", self.arm[:, i], self.arm[:, i])
        matrix[~np.isfinite(matrix).all(axis=(-2, -1))] = 0.0
        return np.asarray(np.linalg.eigvalsh(matrix)[..., 0])

    def oil(self, cylinders: Sequence[Sequence[Cylinder]], corners: Corners) -> list[Array]:
        """Stiffness of every size of each cylinder (sizes, n) [N/m], with the oil of the ends."""
        stiffness = [np.empty((len(sizes), len(self))) for sizes in cylinders]
        for k, (soft, today) in enumerate(zip(corners.ends, corners.machines, strict=True)):
            rows, oil = self.end == k, (today.fluid, today.supply)
            extension, force = self.extension[rows], self.force[rows]
            for i, sizes in enumerate(cylinders):
                at_end = corners.bands.actuators_at_end(sizes, soft, corners.today)
                for n, one in enumerate(at_end):
                    stiffness[i][n, rows] = one.stiffness(extension[:, i], force[:, i], *oil)
        return stiffness


def scaled_poses(placed: Machine, corners: Corners) -> tuple[ScaledPoses, float]:
    """Every pose and load case at all corners of the bands, and the reference ω².

    ``placed`` is the machine whose pins count.
    """
    nc = len(placed.cylinders)
    closed = np.array([c.closed_length for c in placed.cylinders])
    parts = []
    for k, (corner, end) in enumerate(zip(corners.all, corners.end, strict=True)):
        machine = corners.bands.at_end(placed, corner.soft, corners.today)
        shares = corner.payload_share, corner.link_share
        for case in load_cases(machine, corners.workspace, *shares):
            poses = case.evaluate()
            weight = corners.weight_at(k, case)[:, None, None]
            inverse = inverse_cholesky(weight * poses.mass_matrix)
            turned = np.swapaxes(inverse, 1, 2)
            arms, oil = poses.moment_arms[:, :nc], poses.oil_stiffness[:, :nc]
            of_oil = np.swapaxes(arms, 1, 2) @ (arms * oil[:, :, None])
            part = ScaledPoses(
                end=np.full(len(arms), end),
                extension=poses.lengths[:, :nc] - closed,
                force=poses.cylinder_forces[:, :nc],
                arm=arms @ turned,
                without_oil=congruent(inverse, poses.stiffness_matrix - of_oil),
                lowest=np.linalg.eigvalsh(congruent(inverse, poses.stiffness_matrix))[:, 0],
            )
            parts.append(part)
    whole = parts[0]
    for part in parts[1:]:
        whole = whole.joined(part)
    reference = float(max(whole.lowest.min(), 0.01 * np.median(np.abs(whole.lowest))))
    arm, without_oil = whole.arm / math.sqrt(reference), whole.without_oil / reference
    return replace(
        whole, arm=arm, without_oil=without_oil, lowest=whole.lowest / reference
    ), reference


ROWS = 16  # poses in one programme
COLUMNS = 8  # sizes of a cylinder in one programme
ROUNDS = 20  # of programmes
# lowest poses that they choose from, and four times as many all over the workspace
WATCHED = 300
CLOSE = 1e-4  # of λ, between the bound and the mixture, where rounds end


@dataclass(frozen=True, eq=False)
class SeparableBound:
    """λ ≤ constant + Σ_i by_size[i][size i] for every allowed combination."""

    constant: float
    by_size: list[Array]

    @property
    def largest(self) -> float:
        """The bound of all combinations."""
        return float(self.constant + sum(bounds.max() for bounds in self.by_size))

    @property
    def least(self) -> float:
        """The smallest bound of a combination."""
        return float(self.constant + sum(bounds.min() for bounds in self.by_size))


def separable_bound(
    allowed: AllowedSizes, poses: ScaledPoses, corners: Corners
) -> tuple[SeparableBound, Array]:
    """The best bound of programmes of few sizes at few poses, and the poses that mattered."""
    order = np.argsort(poses.lowest)
    spread = np.arange(0, len(order), max(1, len(order) // (4 * WATCHED)))
    watched = np.unique(np.concatenate([order[:WATCHED], spread]))
    bound, rows = _Mixtures(allowed, poses[watched], corners).best_bound()
    return bound, watched[rows]


class _Mixtures:
    """Programmes over mixtures of sizes at some poses."""

    def __init__(self, allowed: AllowedSizes, poses: ScaledPoses, corners: Corners) -> None:
        self._allowed, self._poses = allowed, poses
        self._oil = poses.oil(allowed.cylinders, corners)

    def best_bound(self) -> tuple[SeparableBound, Array]:
        """The best bound of several rounds, and the poses that were in them."""
        poses, oil = self._poses, self._oil
        rows = np.argsort(poses.lowest)[:: max(1, min(WATCHED, len(poses)) // ROWS)][:ROWS]
        rows = np.resize(rows, ROWS)  # a programme has one shape: a pose may stand in it twice
        columns = [np.unique(np.linspace(0, len(k) - 1, COLUMNS).astype(int)) for k in oil]
        even = np.broadcast_to(np.eye(poses.without_oil.shape[1]), poses.without_oil[rows].shape)
        even = even / np.trace(even, axis1=1, axis2=2).sum()
        best = self._bound(even, np.zeros(len(self._allowed.slack)), rows)
        mattered = {int(row) for row in rows}
        for _ in range(ROUNDS):
            try:
                weights, y, mixture = self._multipliers(rows, columns)
            except InfeasibleError:  # the solver gave up: what is known so far still holds
                break
            bound = self._bound(weights, y, rows)
            best = min(best, bound, key=lambda b: b.largest)
            mixed = [mix @ k[c] for mix, k, c in zip(mixture, oil, columns, strict=True)]
            lowest = poses.lowest_with(np.stack(mixed))
            if best.largest - lowest.min() < CLOSE * max(abs(best.largest), 1.0):
                break
            rows = _other_rows(rows, weights, lowest)
            columns = [
                _other_columns(c, mix, bounds)
                for c, mix, bounds in zip(columns, mixture, bound.by_size, strict=True)
            ]
            mattered |= {int(row) for row in rows}
        return best, np.array(sorted(mattered))

    def _multipliers(self, rows: Array, columns: list[Array]) -> tuple[Array, Array, list[Array]]:
        """Multipliers Z of poses, y of shared requirements, and the best mixture of sizes."""
        poses, allowed = self._poses, self._allowed
        nc, m = len(columns), len(allowed.slack)
        slopes = np.zeros((nc * COLUMNS, ROWS, *poses.without_oil.shape[1:]))
        jacobian, high = np.zeros((m + 2 * nc, nc * COLUMNS)), np.zeros(nc * COLUMNS)
        arm = poses.arm[rows]
        for i, sizes in enumerate(columns):
            at = slice(i * COLUMNS, i * COLUMNS + len(sizes))
            outer = np.einsum("na,nb->nab", arm[:, i], arm[:, i])
            slopes[at] = self._oil[i][sizes][:, rows, None, None] * outer
            jacobian[:m, at] = allowed.changes[i][sizes].T
            jacobian[m + i, at], jacobian[m + nc + i, at], high[at] = -1.0, 1.0, 1.0
        value = np.concatenate([allowed.slack, np.ones(nc), -np.ones(nc)])
        step = programme(ROWS, poses.without_oil.shape[1], len(value), len(high)).solve(
            poses.without_oil[rows], slopes, value, jacobian, np.zeros(len(high)), high
        )
        parts = [step.change[i * COLUMNS : i * COLUMNS + len(c)] for i, c in enumerate(columns)]
        mixture = [
            mix / mix.sum() if mix.sum() > 0 else np.full(len(mix), 1 / len(mix)) for mix in parts
        ]
        return certificate(step), step.multipliers[:m], mixture

    def _bound(self, weights: Array, y: Array, rows: Array) -> SeparableBound:
        """The bound of multipliers on all sizes."""
        poses, allowed = self._poses, self._allowed
        arm = poses.arm[rows]
        per_stiffness = np.einsum("nca,nab,ncb->cn", arm, weights, arm)
        constant = np.einsum("nab,nab->", weights, poses.without_oil[rows]) + y @ allowed.slack
        by_size = [
            k[:, rows] @ p + change @ y
            for k, p, change in zip(self._oil, per_stiffness, allowed.changes, strict=True)
        ]
        return SeparableBound(float(constant), by_size)


def _other_rows(rows: Array, weights: Array, lowest: Array) -> Array:
    """Poses for the next programme: those with weight, and the lowest of the last mixture."""
    carried = rows[np.argsort(-np.trace(weights, axis1=1, axis2=2))][: ROWS // 2]
    wanted = dict.fromkeys([*map(int, carried), *map(int, np.argsort(lowest)[:ROWS])])
    return np.resize(np.array(list(wanted)[:ROWS]), ROWS)


def _other_columns(columns: Array, mixture: Array, bounds: Array) -> Array:
    """Sizes for the next programme: in the mixture, or with the largest bounds."""
    used = columns[np.argsort(-mixture)][: max(2, int((mixture > 1e-4).sum()))][: COLUMNS // 2]
    wanted = dict.fromkeys([*map(int, used), *map(int, np.argsort(-bounds)[:COLUMNS])])
    return np.array(list(wanted)[:COLUMNS])
