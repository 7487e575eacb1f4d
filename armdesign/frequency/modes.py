"""Natural modes of an arm on trapped oil: K v = ω² M v at every pose.

Three frequencies stand side by side: the coupled modes (what limits the machine), each cylinder
with the others locked (the paper's formula generalised; never below the lowest coupled mode), and
the rigid load (the paper's comparison).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from armdesign.arguments import checked
from armdesign.arrays import (
    Array,
    Flags,
    ReadOnly,
    components_first,
    congruent,
    poses_first,
    product,
    stacked,
)
from armdesign.errors import PoseError
from armdesign.machine.poses import Poses, own_joints
from armdesign.short_repr import short_repr
from armdesign.threads import in_threads, thread_chunks
from armdesign.units import GRAVITY

if TYPE_CHECKING:
    from armdesign.plots.canvas import Axes

Numbers = TypeVar("Numbers", float, Array)

LEAST_MASS = 1e-200  # [kg or kg m²]: on less, ω² may be no number
PARALLEL = 1e-9  # rows of R this near to one direction, relative, are parallel


@dataclass(frozen=True, eq=False)
class Modes(ReadOnly):
    """Natural frequencies at n poses, over joints and springs; arrays are read-only.

    Attributes:
        frequencies: coupled modes (n, k) ascending [Hz]; 0 where the pose is unstable on its
            trapped oil (ω² ≤ 0).
        shapes: motions of joints and springs (n, k, k), column i belongs to frequency i, scaled to
            vᵀ M v = 1.
        locked_frequencies: each cylinder with all others locked (n, nc) [Hz], inf where these
            leave no motion. Springs stay free. Cylinders with parallel rows of R, such as two on
            one joint, are released together.
        rigid_frequencies: each cylinder with its static load as a mass (n, nc) [Hz], inf where
            that load vanishes, and of a motor: a torque is no mass.
    """

    __repr__ = short_repr

    frequencies: Array
    shapes: Array
    locked_frequencies: Array
    rigid_frequencies: Array

    def plot(self, ax: Axes | None = None) -> Axes:
        """Axes with the coupled frequencies pose by pose, and the locked ones beside them."""
        from armdesign import plots

        return plots.modes_by_pose(self, ax)


@checked
def natural_modes(poses: Poses) -> Modes:
    """Coupled, locked and rigid-load natural frequencies, valves closed and without damping.

    Raises:
        PoseError: the inertia is not positive definite (a massless joint without payload).

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> modes = ad.natural_modes(machine.at([[-0.5], [0.0], [0.5]]))
        >>> print(modes.frequencies[:, 0].round(2))
        [ 8.77 10.77 14.25]
    """
    parts = in_threads(
        lambda rows: _natural_modes(poses[rows]),
        thread_chunks(len(poses), poses.mass_matrix.shape[-1]),
    )
    return stacked(parts, len(poses))


def _natural_modes(poses: Poses) -> Modes:
    mass, stiffness = poses.mass_matrix, poses.stiffness_matrix
    inverse = inverse_cholesky(poses.mass_matrix)
    squared, vectors = np.linalg.eigh(congruent(inverse, stiffness))
    equivalent_mass = np.abs(poses.cylinder_forces) / GRAVITY
    with np.errstate(divide="ignore"):
        rigid = hertz(poses.oil_stiffness / equivalent_mass)
    rigid[:, len(poses.machine.cylinders) :] = np.inf
    return Modes(
        frequencies=hertz(squared),
        shapes=product(np.swapaxes(inverse, 1, 2), vectors),
        locked_frequencies=_locked(poses, mass, stiffness),
        rigid_frequencies=rigid,
    )


def lowest_frequency(poses: Poses) -> Array:
    """Lowest coupled natural frequency (n,) [Hz]."""
    return _lowest(poses.mass_matrix, poses.stiffness_matrix)


def lowest_frequencies(alike: Sequence[Poses]) -> Array:
    """Lowest coupled natural frequencies (m, n) [Hz] of m machines of the same inertia."""
    return _lowest(alike[0].mass_matrix, np.stack([poses.stiffness_matrix for poses in alike]))


def _lowest(mass: Array, stiffness: Array) -> Array:
    """Lowest natural frequency of M (n, k, k) and K (…, n, k, k): (…, n) [Hz].

    NaN where they are not finite.
    """
    of_machines = tuple(range(stiffness.ndim - 3))
    known = np.isfinite(mass).all(axis=(1, 2))
    known &= np.isfinite(stiffness).all(axis=(*of_machines, -2, -1))
    if not known.all():
        lowest = np.full(stiffness.shape[:-2], np.nan)
        lowest[..., known] = _lowest(mass[known], stiffness[..., known, :, :])
        return lowest
    inverse = inverse_cholesky(mass)
    return np.asarray(hertz(np.linalg.eigvalsh(congruent(inverse, stiffness))[..., 0]))


def energy_shares(poses: Poses, modes: Modes) -> Array:
    """Share of each actuator and spring in their energy in each mode (n, k modes, nc + ns).

    The energy of actuator i is k_i (r_i·v)², of spring j κ_j z_j². What has the largest share in
    the lowest mode limits the pose: where it is a spring, every cylinder yields less.
    """
    energy = poses.oil_stiffness[:, :, None] * product(poses.moment_arms, modes.shapes) ** 2
    yielding = modes.shapes[:, poses.q.shape[1] :]
    energy = np.concatenate([energy, poses.spring_stiffness[:, :, None] * yielding**2], axis=1)
    return np.asarray(np.swapaxes(energy / energy.sum(axis=1, keepdims=True), 1, 2))


def inverse_cholesky(mass: Array) -> Array:
    """L⁻¹ (n, k, k) of M = L Lᵀ: in the frame of L⁻¹ the eigenvalues of L⁻¹K L⁻ᵀ are ω².

    Raises:
        PoseError: M is not positive definite (a massless joint without payload).
    """
    k = mass.shape[-1]
    unit = np.broadcast_to(np.eye(k)[..., None], (k, k, len(mass)))
    rows = np.concatenate([components_first(mass), unit], axis=1)  # [M 1] → [Lᵀ L⁻¹] by rows
    for j in range(k):
        if not (rows[j, j] > LEAST_MASS).all():
            fault = "is not positive definite: a joint moves no mass, or hardly any beside another"
            remedy = "give its links inertia, or a load of their order"
            raise PoseError("mass matrix", fault, remedy)
        row = rows[j, j : k + j + 1]
        row /= np.sqrt(row[0])
        rows[j + 1 :, j : k + j + 1] -= row[1 : k - j, None] * row
    return poses_first(rows[:, k:])


def hertz(squared: Numbers) -> Numbers:
    """Frequency ω/2π [Hz] of ω² [rad²/s²]; 0 for an unstable mode (ω² ≤ 0)."""
    frequency: Any = np.sqrt(np.maximum(squared, 0.0)) / (2 * math.pi)
    number: Numbers = frequency if np.ndim(squared) else frequency.item()
    return number


def _locked(poses: Poses, mass: Array, stiffness: Array) -> Array:
    """Lowest frequency of each cylinder with all others locked (n, nc) [Hz]; inf without motion.

    Locked cylinders hold the rows of R that are theirs, so only motions in the null space of these
    rows remain: K and M are restricted to it. With one cylinder per joint and no springs that is
    K_ii/M_ii of its joint. Cylinders whose row is in the span of row i, such as two on one joint,
    cannot move alone and are released together.
    """
    arms, nq = poses.moment_arms, poses.q.shape[1]
    own = own_joints(arms[..., :nq])
    if own is not None and nq == arms.shape[2]:
        return hertz(stiffness[:, own, own] / mass[:, own, own])
    if own is not None and nq + 1 == arms.shape[2]:
        return hertz(_lowest_of_two(own, mass, stiffness))
    if own is not None:
        free = ([joint, *range(nq, mass.shape[1])] for joint in own)  # with the springs
        picked = ((m[:, k][:, :, k] for m in (mass, stiffness)) for k in free)
        return np.stack([_lowest(*matrices) for matrices in picked], axis=1)
    locked = np.full(arms.shape[:2], np.inf)
    for i in range(arms.shape[1]):
        held = np.where(_in_span(arms, arms[:, i])[:, :, None], 0.0, arms)
        for rows, basis in _null_spaces(held):
            turned = np.swapaxes(basis, 1, 2)
            locked[rows, i] = _lowest(*(congruent(turned, m[rows]) for m in (mass, stiffness)))
    return locked


def _lowest_of_two(joints: Array, mass: Array, stiffness: Array) -> Array:
    """Lowest ω² of each of some joints with the last coordinate (n, nc) [rad²/s²], in closed form.

    The roots of a λ² − b λ + c = 0 with a = det M, c = det K; the lower one is c/a over the higher
    one, which loses no digits.
    """
    first, cross = (tuple(x[:, joints, at] for x in (mass, stiffness)) for at in (joints, -1))
    last = tuple(x[:, -1:, -1] for x in (mass, stiffness))
    a, c = (one * two - both**2 for one, two, both in zip(first, last, cross, strict=True))
    b = first[0] * last[1] + first[1] * last[0] - 2 * cross[0] * cross[1]
    return np.asarray(2 * c / (b + np.sqrt(np.maximum(b**2 - 4 * a * c, 0.0))))


def _in_span(rows: Array, row: Array) -> Flags:
    """Whether each of the rows (n, k, nq) is a multiple of ``row`` (n, nq): (n, k)."""
    squared = (row**2).sum(axis=1)[:, None, None]
    along = (rows @ row[:, :, None]) / np.where(squared > 0, squared, 1.0)
    across = rows - along * row[:, None, :]
    return np.asarray(np.linalg.norm(across, axis=2) <= PARALLEL * np.linalg.norm(rows, axis=2))


def _null_spaces(held: Array) -> list[tuple[Array, Array]]:
    """Orthonormal bases of the motions that leave the rows ``held`` (n, k, nq) unmoved.

    One basis for all poses of one rank, with their indices; poses without such a motion are left
    out.
    """
    _, sizes, right = np.linalg.svd(held)
    rank = (sizes > 1e-9).sum(axis=1)
    poses = [np.flatnonzero(rank == r) for r in np.unique(rank) if r < held.shape[2]]
    return [(rows, np.swapaxes(right[rows, rank[rows[0]] :], 1, 2)) for rows in poses]
