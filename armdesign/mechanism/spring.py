"""Springs: joints that no actuator drives, on which structure yields: carriage, pillar, slew gear.

A spring's joint is a coordinate z of modes and motion beside the joints q of poses, with the
torque

    τ = τ₀ − κ (z − z₀) − d ż,   τ₀ = g_z(q, z₀)

It stands at z₀ whatever the pose and the load at rest: the preload τ₀ is what gravity needs there.
So K gains κ on the diagonal beside ∂g/∂(q, z) (docs/theory.md, structure that yields), and static
forces of actuators are as in a rigid machine. Static condensation would be wrong where what yields
has inertia.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from armdesign.arrays import Array


@dataclass(frozen=True, kw_only=True)
class Spring:
    """A passive joint."""

    name: str  # of the spring
    joint: str  # its joint of the URDF
    revolute: bool  # whether its numbers are of a joint that turns; else of one that slides
    stiffness: float  # κ [N m/rad, N/m]
    damping_ratio: float = 0.0  # of the joint alone, all others locked
    at: float = 0.0  # where it stands at rest, z₀ [rad, m]
    preload: float | None = None  # τ₀ at a run's pose and load [N m, N], see ``settled``
    damping: float = 0.0  # d there [N m s/rad, N s/m]

    kind = "spring"

    @property
    def stiffness_key(self) -> str:
        """Key of the stiffness in the spring's table of the machine file."""
        return f"stiffness_{'N_m_per_rad' if self.revolute else 'N_per_m'}"

    @property
    def stiffness_unit(self) -> str:
        """Unit of the stiffness."""
        return "N m/rad" if self.revolute else "N/m"

    def settled(self, gravity: float, mass: float, stiffness: float) -> Spring:
        """The spring at rest at one pose under one load: with preload, and d = 2 ζ √(K M).

        Args:
            gravity: what its joint carries there [N m, N].
            mass: diagonal term of M [kg m², kg].
            stiffness: diagonal term of K, gravity's part included [N m/rad, N/m].
        """
        damping = 2 * self.damping_ratio * math.sqrt(max(stiffness, 0.0) * mass)
        return replace(self, preload=gravity, damping=damping)


def least_stiffness_factors(stiffness_matrix: Array, springs: Array) -> Array:
    """Factors on each spring's κ alone, then on all, above which K is positive definite.

    (n, ns + 1); inf where no factor is enough.

    Args:
        stiffness_matrix: K (n, k, k), springs last.
        springs: their κ (ns,) [N m/rad, N/m].
    """
    k, ns = stiffness_matrix.shape[1], len(springs)
    factors = []
    for own in (*([j] for j in range(ns)), list(range(ns))):
        last = [k - ns + j for j in own]
        order = [i for i in range(k) if i not in last] + last
        factors.append(_least_factor(stiffness_matrix[:, order][:, :, order], springs[own]))
    return np.stack(factors, axis=1)


def least_actuator_factors(stiffness_matrix: Array, stiffness: Array, arms: Array) -> Array:
    """Factors on each actuator's stiffness alone, above which K is positive definite (nc,).

    One more term τ k r rᵀ makes det K vanish at 1 + τ k rᵀK⁻¹r = 0, where the only negative
    eigenvalue turns positive. inf where there are several, or none that it reaches.

    Args:
        stiffness_matrix: K (k, k) at one pose.
        stiffness: k of the actuators (nc,) [N/m, N m/rad].
        arms: their moment arms r (nc, k) [m/rad].
    """
    eigenvalues, modes = np.linalg.eigh(stiffness_matrix)
    factors = np.full(len(stiffness), np.inf)
    if np.sum(eigenvalues <= 0) == 1:
        reach = stiffness * ((arms @ modes) ** 2 / eigenvalues).sum(axis=1)
        factors[reach < 0] = 1 - 1 / reach[reach < 0]
    return factors


def _least_factor(stiffness_matrix: Array, springs: Array) -> Array:
    """Factor on the κ of the last coordinates above which K is positive definite (n,).

    It is where K_qq and S = K_zz − K_zq K_qq⁻¹ K_qz are; S grows with κ, so that the factor is
    1 − λ_min of κ^(−½) S κ^(−½). inf where K_qq is not.
    """
    nq = stiffness_matrix.shape[1] - len(springs)
    others, coupling = stiffness_matrix[:, :nq, :nq], stiffness_matrix[:, :nq, nq:]
    stable = np.linalg.eigvalsh(others)[:, 0] > 0
    turned = np.swapaxes(coupling[stable], 1, 2)
    condensed = stiffness_matrix[stable, nq:, nq:]
    condensed = condensed - turned @ np.linalg.solve(others[stable], coupling[stable])
    scale = np.sqrt(springs)
    factor = np.full(len(stiffness_matrix), np.inf)
    factor[stable] = 1 - np.linalg.eigvalsh(condensed / scale / scale[:, None])[:, 0]
    return factor
