"""Damped modes of a linear model: poles, shapes of joints and tool, and who takes part.

The energy of a mode in its actuators lies in the oil of both chambers and in the structure in
series, Σ C |δp|² + c |A1 δp1 − A2 δp2|², in its springs κ |z|²: with trapped oil the k (r·v)² of
``frequency.modes``. The participation of a state is |w v| of the left and right eigenvectors w and
v of a pole (Pérez-Arriaga et al. 1982), which does not depend on units.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arrays import Array, Flags, ReadOnly
from armdesign.hydraulics.actuator import areas_of
from armdesign.simulation.signals import CHAMBERS
from armdesign.units import bar

if TYPE_CHECKING:
    from armdesign.simulation.linear_model import LinearModel

ROUNDING = 1e-10  # of a damping ratio
# Of the fastest pole: slower ones are the trapped oil's zeros with their rounding.
NEGLIGIBLE = 1e-5


@dataclass(frozen=True, eq=False, kw_only=True)
class DampedModes(ReadOnly):
    """m oscillatory modes of arm and oil, slow ones first; arrays are read-only.

    Attributes:
        poles: above the real axis (m,) [rad/s].
        shapes: complex amplitudes of joints and springs (k, m), column i of mode i, scaled to
            vᴴ M v = 1, the largest of them real and positive.
        tool_shapes: the same of the tool along x, y, z of the root link (3, m).
        energy_shares: of each actuator and spring in their energy (m, nc + ns).
        participation: of the states but the spools' (states, m); each column sums to 1.
        joints: names of joints and springs' joints (k,).
        parts: names of actuators and springs (nc + ns,).
        states: names of the states.
    """

    poles: Array
    shapes: Array
    tool_shapes: Array
    energy_shares: Array
    participation: Array
    joints: tuple[str, ...]
    parts: tuple[str, ...]
    states: tuple[str, ...]

    @property
    def natural_frequencies(self) -> Array:
        """|λ|/2π (m,) [Hz]."""
        return np.abs(self.poles) / (2 * math.pi)

    @property
    def damping_ratios(self) -> Array:
        """ζ = −Re λ/|λ| (m,)."""
        return damping_of(self.poles)

    @property
    def frame(self) -> Any:
        """A row per mode: frequency, damping, amplitudes, energy shares (pandas)."""
        import pandas as pd

        columns = {"frequency_hz": self.natural_frequencies, "damping": self.damping_ratios}
        names = (*self.joints, "tool_x", "tool_y", "tool_z")
        rows = zip(names, (*self.shapes, *self.tool_shapes), strict=True)
        columns |= {f"{name}_amplitude": np.abs(row) for name, row in rows}
        shares = zip(self.parts, self.energy_shares.T, strict=True)
        columns |= {f"{name}_energy_share": share for name, share in shares}
        return pd.DataFrame(columns)


def damping_of(poles: Array) -> Array:
    """ζ = −Re λ/|λ|; 0 where it is rounding alone."""
    ratios = -poles.real / np.abs(poles)
    return np.asarray(np.where(np.abs(ratios) < ROUNDING, 0.0, ratios))


def oscillatory(poles: Array, most: int) -> Array:
    """Indices of oscillatory poles above the real axis, slow ones first, at most the fastest."""
    order = np.argsort(np.abs(poles), kind="stable")
    return np.asarray(order[_rings(poles)[order]][-most:])


def fastest_poles(A: Array, count: int) -> Array:
    """Fastest oscillatory poles of each state matrix (n, count) [rad/s], slow ones first.

    In place of a pair that is overdamped stands a real pole.
    """
    poles: Array = np.linalg.eigvals(A)
    size = np.abs(poles)
    order = np.argsort(np.where(_rings(poles), size, -1.0 / (1 + size)), axis=1)[:, -count:]
    poles = np.take_along_axis(poles, order, axis=1)
    return np.take_along_axis(poles, np.argsort(np.abs(poles), axis=1), axis=1)


def _rings(poles: Array) -> Flags:
    """Whether each pole (…, ns) lies above the real axis, and is more than rounding."""
    sizes = np.abs(poles)
    return np.asarray((poles.imag > 0) & (sizes > NEGLIGIBLE * sizes.max(axis=-1, keepdims=True)))


def damped_modes_of(model: LinearModel) -> DampedModes:
    """Damped modes of a linear model, without the states of its spools, which feel no others."""
    from scipy.linalg import eig

    machine, groups = model.machine, model.state_groups
    k, size = len(model.mass_matrix), groups["spools"].start
    poles, left, right = eig(model.state_matrix_in_bar[:size, :size], left=True, right=True)
    chosen = oscillatory(poles, k)
    poles, left, right = poles[chosen], left[:, chosen], right[:, chosen]
    shapes = right[groups["positions"]]
    masses = np.einsum("im,ij,jm->m", shapes.conj(), model.mass_matrix, shapes).real
    largest = np.take_along_axis(shapes, np.abs(shapes).argmax(axis=0)[None], axis=0)[0]
    scale = np.abs(largest) / largest / np.sqrt(masses)
    shapes = shapes * scale
    pressures = [right[groups[name]] * scale * bar for name in CHAMBERS]
    areas, compliance = areas_of(machine.actuators).T, [a.compliance for a in machine.actuators]
    force = areas[0][:, None] * pressures[0] - areas[1][:, None] * pressures[1]
    energy = np.array(compliance)[:, None] * np.abs(force) ** 2
    for capacity, pressure in zip(model.capacities, pressures, strict=True):
        energy += capacity[:, None] * np.abs(pressure) ** 2
    elastic = machine.spring_stiffness[:, None] * np.abs(shapes[len(machine.joints) :]) ** 2
    energy = np.concatenate([energy, elastic])
    part = np.abs(left.conj() * right)
    return DampedModes(
        poles=poles,
        shapes=shapes,
        tool_shapes=model.tool_jacobian @ shapes,
        energy_shares=(energy / energy.sum(axis=0)).T,
        participation=part / part.sum(axis=0),
        joints=tuple(joint.name for joint in machine.arm.coordinates),
        parts=tuple(part.name for part in machine.yielding),
        states=model.states[:size],
    )
