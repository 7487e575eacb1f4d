"""Damped modes against modes of trapped oil, and participation against perturbed poles."""

from __future__ import annotations

import numpy as np
import pytest

import armdesign as ad
from armdesign.frequency.modes import energy_shares
from tests import machines, sprung
from tests.simulation import valves as helpers
from tests.simulation.valves import WORST


@pytest.mark.parametrize(
    "name", ["excavator_20t", "loader_crane", "patu_boom", "rotator", "spatial", "redundant"]
)
def test_without_losses_they_are_the_natural_modes(name: str) -> None:
    """Shapes to vᵀ M v = 1 but for the sign, energy shares k (r·v)², structure in series too."""
    machine = helpers.with_valves(machines.named(name).replace({"damped": False}))
    for pose in machines.inner_poses(machine, 2):
        poses = machine.at(pose)
        natural, model = ad.natural_modes(poses), ad.linearize(machine, pose)
        damped = model.damped_modes
        shapes = natural.shapes[0] * np.sign(
            np.take_along_axis(
                natural.shapes[0], np.abs(natural.shapes[0]).argmax(axis=0)[None], axis=0
            )
        )
        limit = 1e-6 * np.abs(shapes).max()
        np.testing.assert_allclose(damped.shapes, shapes, atol=limit)
        np.testing.assert_allclose(
            damped.energy_shares, energy_shares(poses, natural)[0], atol=1e-6
        )
        np.testing.assert_allclose(damped.natural_frequencies, natural.frequencies[0], rtol=1e-6)
        few = model.select(outputs="tool position")
        moved = few.C[:, : len(shapes)] @ damped.shapes
        np.testing.assert_allclose(damped.tool_shapes, moved, rtol=1e-12)


def test_springs_take_their_share() -> None:
    machine = sprung.rocking().replace({"damped": False}).with_payload("full")
    poses, damped = machine.at(WORST), ad.linearize(machine, WORST).damped_modes
    assert damped.parts == ("boom", "stick", "bucket", "carriage")
    shares = energy_shares(poses, ad.natural_modes(poses))[0]
    np.testing.assert_allclose(damped.energy_shares, shares, atol=1e-6)
    assert damped.energy_shares[:, 3].max() > 0.1


def test_participation_is_what_a_pole_owes_to_each_state() -> None:
    """∂λ/∂a_kk by differences, its size over the sum of sizes (Pérez-Arriaga et al. 1982)."""
    model = ad.linearize(machines.named("excavator_20t").with_payload("full"), WORST)
    damped, step = model.damped_modes, 1e-3
    size = len(damped.states)
    assert damped.participation.shape == (size, len(damped.poles))
    for mode, pole in enumerate(damped.poles):
        owed = np.empty(size)
        for k in range(size):
            moved = []
            for sign in (1, -1):
                a = model.A[:size, :size].copy()
                a[k, k] += sign * step
                poles = np.linalg.eigvals(a)
                moved.append(poles[np.abs(poles - pole).argmin()])
            owed[k] = abs(moved[0] - moved[1]) / (2 * step)
        np.testing.assert_allclose(damped.participation[:, mode], owed / owed.sum(), atol=1e-5)


def test_frame_has_a_row_per_mode() -> None:
    model = ad.linearize(machines.named("excavator_20t").with_payload("full"), WORST)
    frame = model.damped_modes.frame
    np.testing.assert_allclose(frame["frequency_hz"], model.natural_frequencies, rtol=1e-9)
    np.testing.assert_allclose(frame["damping"], model.damping_ratios, rtol=1e-6)
    shares = frame[[f"{name}_energy_share" for name in ("boom", "stick", "bucket")]]
    np.testing.assert_allclose(shares.sum(axis=1), 1.0, rtol=1e-12)
    assert {"boom_amplitude", "tool_x_amplitude", "tool_z_amplitude"} <= set(frame)
