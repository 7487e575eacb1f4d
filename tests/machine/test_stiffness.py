"""The stiffness matrix at every pose, against differences of the static torque on trapped oil."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign.hydraulics.fluid import bulk_modulus
from armdesign.hydraulics.oil_spring import static_pressures
from tests.checks import assert_same, difference
from tests.machines import inner_poses


def trapped_torque(machine: ad.Machine, q0: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Net static torque Rᵀ F − g at q when the oil was shut in at q0: the pressures follow the
    volumes.

    Each chamber's pressure rises by what its volume lost over its capacity V/β(p0) +
    V_hose/β_hose; where the mounting yields, the piston moves by ℓ + cF. Neither A²/C nor K_g is
    written down.
    """
    start = machine.at(q0)
    force = start.cylinder_forces  # (n, nc), as all that follows; the chamber is the first axis
    area = np.array([(c.bore_area, c.annulus_area) for c in machine.actuators]).T[:, None]
    preload = np.array([(c.valve and c.valve.preload) or 0.0 for c in machine.actuators])
    empty = np.maximum(machine.supply.return_pressure, preload)  # the chamber without load
    pressure = np.array(static_pressures(force, area[0], area[1], empty))
    piston = [
        start.lengths[:, i] - c.closed_length + c.compliance * force[:, i]
        for i, c in enumerate(machine.actuators)
    ]
    chambers = [c.volumes(x) for c, x in zip(machine.actuators, piston, strict=True)]
    hoses = [
        (c.cap_hose_volume, c.annulus_hose_volume) / np.array(c.hose_modulus)
        for c in machine.actuators
    ]
    modulus = bulk_modulus(pressure, machine.fluid.bulk_modulus, machine.fluid.air)
    capacity = np.stack(chambers, axis=-1) / modulus + np.array(hoses).T[:, None]
    yielding = np.array([c.compliance for c in machine.actuators])

    def torque(q: np.ndarray) -> np.ndarray:
        there = machine.evaluate(machine.rigid_poses(q))

        def excess(rise: float) -> np.ndarray:
            """Oil force less the force on the mounting when that has risen: zero where the piston
            finds its place.
            """
            piston = there.lengths - start.lengths + yielding * rise
            rises = np.array([-area[0], area[1]]) * piston / capacity
            return area[0] * (pressure + rises)[0] - area[1] * (pressure + rises)[1] - force - rise

        # the excess is linear in the rise
        force_at_rest = force + excess(0.0) / (excess(0.0) - excess(1.0))
        return np.einsum("ncj,nc->nj", there.moment_arms, force_at_rest) - there.gravity_torque

    return torque


def test_stiffness_is_the_derivative_of_the_torque_on_trapped_oil(machine: ad.Machine) -> None:
    q = inner_poses(machine, 3)
    torque = trapped_torque(machine, q)
    gravity = machine.at(q).gravity_torque
    assert_allclose(
        torque(q), 0, atol=1e-9 * np.abs(gravity).max(), err_msg="equilibrium: g = Rᵀ F"
    )
    assert_same(machine.at(q).stiffness_matrix, -difference(torque, q), 1e-8)


def test_poses_are_selected_by_index_slice_and_mask() -> None:
    """Axis 0 stays; an index beyond is told as of an array."""
    machine = ad.load("paper_1dof")
    poses = machine.at([[-0.3], [0.1], [0.2]])
    for rows, q in ((0, [-0.3]), (-1, [0.2]), (np.int64(1), [0.1]), (slice(1, None), [0.1, 0.2])):
        few = poses[rows]
        assert few.q[:, 0].tolist() == q
        assert few.mass_matrix.shape == (len(q), 1, 1)
    with pytest.raises(IndexError, match="index 3 is out of bounds"):
        poses[3]
