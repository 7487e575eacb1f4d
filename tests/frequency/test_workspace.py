"""Joint grids and quasi-random poses: exact edges, counts, what cannot be."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign.machine import template
from tests import machines
from tests.frequency.cached import workspace

SERIAL = ("paper_1dof", "excavator_20t", "four_bar_left", "crossing", "branched")


@pytest.mark.parametrize("margin", [0.0, 0.02, 0.3])
@pytest.mark.parametrize("name", SERIAL)
def test_grid_ends_where_the_end_margin_begins(name: str, margin: float) -> None:
    """Definition of the workspace: the range that keeps the margin; its ends leave exactly that
    share of the stroke.
    """
    machine = machines.named(name)
    space = ad.Workspace.grid(machine, 3, end_margin=margin)
    assert_allclose(space.ranges, machine.range_within(margin), rtol=0, atol=0)
    assert space.end_margin == margin
    assert machine.margins(space.q).min() >= margin - 1e-9
    for linkage, column in zip(machine.linkages, range(len(machine.cylinders)), strict=True):
        if len(linkage.joints) == 1:
            joint = linkage.joints[0]
            for side in (0, 1):
                # not cut by the URDF
                if abs(space.ranges[joint, side] - machine.arm.limits[joint, side]) > 1e-6:
                    q = machine.ranges.mean(axis=1)
                    q[joint] = space.ranges[joint, side]
                    shared = [
                        k for k, other in enumerate(machine.linkages) if joint in other.joints
                    ]
                    assert machine.margins(q)[0, shared].min() == pytest.approx(
                        margin, abs=1e-9
                    ), column


def test_default_margin_is_that_of_the_requirements() -> None:
    machine = machines.named("excavator_20t").replace({"requirements.end_margin": 0.1})
    assert ad.Workspace.grid(machine, 3).end_margin == 0.1


def test_points_per_joint_and_the_default() -> None:
    """By hand: 3 · 4 · 5 grid poses, last joint fastest; the default is about 20 000 poses, the
    last joint finest.
    """
    machine = machines.named("excavator_20t")
    space = ad.Workspace.grid(machine, [3, 4, 5])
    assert [len(axis) for axis in space.axes] == [3, 4, 5]
    assert len(space) >= 60
    assert_allclose(space.q[:5, 2], space.axes[2], atol=0)
    default = ad.Workspace.grid(machine)
    counts = [len(axis) for axis in default.axes]
    assert 10_000 < np.prod(counts) < 40_000
    assert counts[2] == max(counts)
    assert not default.q.flags.writeable


def test_a_cylinder_across_two_joints_bounds_the_workspace() -> None:
    """Poses at which any cylinder, also one across joints, has less than its margin are no part of
    it.
    """
    machine, space = machines.named("crossing"), workspace("crossing", 9)
    assert len(space) <= 81
    assert machine.margins(space.q).min() >= space.end_margin - 1e-9


def test_a_cylinder_across_two_joints_that_fits_no_pose_is_named() -> None:
    machine = machines.named("crossing")
    (across,) = (
        c.name
        for c, k in zip(machine.cylinders, machine.linkages, strict=True)
        if len(k.joints) > 1
    )
    far = machine.replace({f"cylinder.{across}.closed_length_mm": 9000.0})
    fault = rf"cylinder\.{across}\.stroke_mm: over the workspace the pins are .* never within \[9"
    with pytest.raises(ad.ArmDesignError, match=fault):
        ad.Workspace.grid(far, points=5)


@pytest.mark.parametrize("name", ["paper_1dof", "excavator_20t", "crossing", "spatial"])
def test_sobol_poses_fill_the_ranges_and_lie_on_their_edges(name: str) -> None:
    """Equal seeds, equal poses; all keep the margin; every end of every joint and the pitch limits
    are met exactly.
    """
    machine = machines.named(name)
    space = ad.Workspace.sobol(machine, 600, seed=4)
    assert_allclose(space.q, ad.Workspace.sobol(machine, 600, seed=4).q, atol=0)
    assert not np.array_equal(space.q[:50], ad.Workspace.sobol(machine, 600, seed=5).q[:50])
    assert machine.margins(space.q).min() >= space.end_margin - 1e-9
    low, high = machine.range_within(space.end_margin).T
    assert np.all((space.q >= low) & (space.q <= high))
    if all(len(linkage.joints) == 1 for linkage in machine.linkages):
        assert len(space) >= 600
        assert np.all((space.q == low).any(axis=0) & (space.q == high).any(axis=0))
        middle = (space.q[:600] - low) / (high - low)
        # chance alone would leave 0.29/√600 = 0.012
        assert_allclose(middle.mean(axis=0), 0.5, atol=0.01)
    for payload in machine.payloads:
        if payload.pitch is not None:
            excess = machine.pitch_excess(machine.arm.kinematics(space.q), payload)
            assert (np.abs(excess) < 1e-8).sum() > 50


@pytest.mark.parametrize("count", [0, -1, 2.5, "9", True, None, 10**7])
def test_sobol_counts_that_cannot_be(count: object, excavator: ad.Machine) -> None:
    with pytest.raises(
        ad.ArmDesignError,
        match=r"count: .* is not allowed; give a whole number from 1 to 5,000,000",
    ):
        ad.Workspace.sobol(excavator, count)  # type: ignore[arg-type]
    with pytest.raises(ad.ArmDesignError, match=r"cells: .*" if count != 10**7 else r"points"):
        ad.Workspace.reach_plane(excavator, 9 if count == 10**7 else count, points=1)  # type: ignore[arg-type]


def test_a_slide_begins_at_zero() -> None:
    """The extension's length is its closed length plus q: rod in is q = 0, not the number next to
    it.
    """
    assert machines.named("loader_crane").ranges[2, 0] == 0.0


def test_a_seed_is_a_whole_number(excavator: ad.Machine) -> None:
    with pytest.raises(ad.ArmDesignError, match="seed: -1 is not allowed"):
        ad.Workspace.sobol(excavator, 10, seed=-1)


@pytest.mark.parametrize(
    ("name", "remedy"),
    [
        ("paper_1dof", r"give one number ≥ 2$"),
        ("excavator_20t", r"give one number ≥ 2, or 3 numbers, one per joint$"),
    ],
)
def test_the_remedy_for_points_names_counts_per_joint_only_where_there_are_several(
    name: str, remedy: str
) -> None:
    with pytest.raises(ad.ArmDesignError, match=rf"points: 1 is not allowed; {remedy}"):
        ad.Workspace.grid(machines.named(name), points=1)


def lifting_boom() -> ad.Machine:
    """One joint, ``[links]``, valves; its range does not depend on masses."""
    return ad.Machine.from_text(template.new("lifter", links=1), "", Path("lifter.toml"))


def test_poses_of_a_machine_serve_all_of_its_links() -> None:
    """What is computed of the links once serves every machine with the same, however made."""
    machine = lifting_boom()
    space = ad.Workspace.grid(machine, 3)
    stiffer = machine.replace({"fluid.bulk_modulus_MPa": 1500.0})
    again = ad.Machine.from_text(machine.text, machine.urdf_text, machine.source)
    assert space.on(machine) is space.on(stiffer) is space.on(again) is space
    heavy = machine.replace({"links.boom.mass_kg": 900.0})
    other = space.on(heavy)
    assert other is space.on(heavy.replace({"fluid.bulk_modulus_MPa": 1500.0}))
    assert other.machine is heavy
    for name in ("q", "weights", "axes", "end_margin", "kind", "cells"):
        assert np.array_equal(getattr(other, name), getattr(space, name))
    assert space.suits(stiffer)
    assert not space.suits(heavy)
    assert not other.suits(machine)
    assert other.suits(heavy)


@pytest.mark.parametrize(
    "answer",
    [
        lambda *given: ad.frequency_map(*given).lowest.mean(),
        lambda *given: ad.bandwidth_map(*given, damping=0.05).worst("individual")["own_hz"],
        lambda *given: ad.size_cylinders(*given).after.lowest.mean(),
    ],
    ids=["map", "bandwidths", "sizes"],
)
def test_every_door_takes_the_links_of_the_machine(answer: Callable[..., float]) -> None:
    """As over a workspace made for the machine, which has the same positions of the joint."""
    machine = lifting_boom()
    space, heavy = ad.Workspace.grid(machine, 3), machine.replace({"links.boom.mass_kg": 900.0})
    before = answer(machine, space)
    assert answer(heavy, space) == answer(heavy, ad.Workspace.grid(heavy, 3)) != before
