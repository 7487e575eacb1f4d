"""Poses under every load case, as sizes see them: what stays, and the oil's stiffness."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armdesign.arrays import Array
from armdesign.frequency.cases import load_cases
from armdesign.frequency.modes import inverse_cholesky
from armdesign.frequency.workspace import Workspace
from armdesign.hydraulics.actuator import Cylinder
from armdesign.machine.machine import Machine


@dataclass(frozen=True, eq=False, kw_only=True)
class ScaledPoses:
    """Poses with a load case, in the frame of L⁻¹, M = L Lᵀ, over a reference ω².

    Attributes:
        extension: of every cylinder (n, nc) [m].
        force: static forces (n, nc) [N].
        arm: L⁻¹r (n, nc, nq).
        rest: L⁻¹K_0 L⁻ᵀ (n, nq, nq), all stiffness but that of the cylinders' oil.
        lowest: lowest ω² with today's sizes (n,).
    """

    extension: Array
    force: Array
    arm: Array
    rest: Array
    lowest: Array

    def __getitem__(self, rows: Array) -> ScaledPoses:
        return ScaledPoses(**{name: value[rows] for name, value in vars(self).items()})

    def __len__(self) -> int:
        return len(self.lowest)

    def joined(self, other: ScaledPoses) -> ScaledPoses:
        """These poses and others."""
        return ScaledPoses(
            **{
                name: np.concatenate([value, getattr(other, name)])
                for name, value in vars(self).items()
            }
        )

    def lowest_with(self, oil: Array) -> Array:
        """Lowest eigenvalue of K_0 + Σ k r rᵀ with oil stiffnesses (nc, …, n)."""
        matrix = np.broadcast_to(self.rest, (*oil.shape[1:], *self.rest.shape[1:])).copy()
        for i, k in enumerate(oil):
            matrix += k[..., None, None] * np.einsum("na,nb->nab", self.arm[:, i], self.arm[:, i])
        matrix[~np.isfinite(matrix).all(axis=(-2, -1))] = 0.0
        return np.asarray(np.linalg.eigvalsh(matrix)[..., 0])

    def oil(self, cylinders: Sequence[Sequence[Cylinder]], medium: Machine) -> list[Array]:
        """Oil stiffness of every size of each cylinder (sizes, n) [N/m], with a machine's oil."""
        fluid, supply = medium.fluid, medium.supply
        return [
            np.stack(
                [c.stiffness(self.extension[:, i], self.force[:, i], fluid, supply) for c in sizes]
            )
            for i, sizes in enumerate(cylinders)
        ]


def scaled_poses(
    machine: Machine, workspace: Workspace, masses: Sequence[tuple[float, float]]
) -> tuple[ScaledPoses, float]:
    """Every pose and load case at shares of payload and link mass, and the reference ω²."""
    nc = len(machine.cylinders)
    closed = np.array([c.closed_length for c in machine.cylinders])
    parts = []
    cases = (case for shares in masses for case in load_cases(machine, workspace, *shares))
    for case in cases:
        poses = case.evaluate()
        inverse = inverse_cholesky(poses.mass_matrix)
        turned = np.swapaxes(inverse, 1, 2)
        arms, oil = poses.moment_arms[:, :nc], poses.oil_stiffness[:, :nc]
        of_oil = np.swapaxes(arms, 1, 2) @ (arms * oil[:, :, None])
        part = ScaledPoses(
            extension=poses.lengths[:, :nc] - closed,
            force=poses.cylinder_forces[:, :nc],
            arm=arms @ turned,
            rest=inverse @ (poses.stiffness_matrix - of_oil) @ turned,
            lowest=np.linalg.eigvalsh(inverse @ poses.stiffness_matrix @ turned)[:, 0],
        )
        parts.append(part)
    whole = parts[0]
    for part in parts[1:]:
        whole = whole.joined(part)
    reference = float(max(whole.lowest.min(), 0.01 * np.median(np.abs(whole.lowest))))
    return replace(
        whole,
        arm=whole.arm / math.sqrt(reference),
        rest=whole.rest / reference,
        lowest=whole.lowest / reference,
    ), reference
