"""Reach planes: the tool on the middle of each cell, by every posture, the worst among them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign.frequency.modes import lowest_frequency
from tests import machines


@pytest.mark.slow
@pytest.mark.parametrize("name", ["excavator_20t", "loader_crane", "crossing", "spatial"])
def test_poses_of_the_reach_plane_bring_the_tool_to_the_cells(name: str) -> None:
    """The tool is on a cell's middle to a micrometre; where joints are left over, in several
    ways.
    """
    machine = machines.named(name)
    space = ad.Workspace.reach_plane(machine, 12, 7 if len(machine.joints) > 2 else 20)
    assert machine.margins(space.q).min() >= space.end_margin - 1e-9
    tool = machine.at(space.q).tool
    place = np.stack(
        [np.copysign(np.hypot(tool[:, 0], tool[:, 1]), tool[:, 0]), tool[:, 2]], axis=1
    )
    assert space.cells is not None
    cell = np.stack(
        [np.abs(place[:, [i]] - space.cells[i]).argmin(axis=1) for i in (0, 1)], axis=1
    )
    assert_allclose(
        place, np.stack([space.cells[i][cell[:, i]] for i in (0, 1)], axis=1), atol=1e-6
    )
    ways = np.unique(cell, axis=0, return_counts=True)[1]
    if len(machine.joints) > 2:
        assert np.median(ways) >= 3
    picture = ad.frequency_map(machine, space).reach_map()
    assert np.isfinite(picture.frequency).sum() == len(ways)


def test_one_joint_reaches_no_plane() -> None:
    with pytest.raises(
        ad.ArmDesignError, match="no pose brings the tool to a cell's middle; take a grid for one"
    ):
        ad.Workspace.reach_plane(machines.named("paper_1dof"))


@pytest.mark.slow
def test_the_reach_plane_holds_the_worst_way_to_each_cell() -> None:
    """Brute force of the family of poses that bring the tool to a cell's middle: stick and boom of
    every bucket angle.

    The links from boom foot to stick foot to tool are a triangle of known sides, solved by hand,
    elbow up or down.
    """
    machine = machines.named("excavator_20t")
    space = ad.Workspace.reach_plane(machine, 12, 9)
    picture = ad.frequency_map(machine, space).reach_map()
    low, high = machine.range_within(space.end_margin).T
    q = np.column_stack([np.zeros((1201, 2)), np.linspace(low[2], high[2], 1201)])
    kinematics = machine.arm.kinematics(q)
    foot, elbow = (kinematics.translation[0, j, [0, 2]] for j in (0, 1))
    tool = machine.arm.point(kinematics, machine.tool.link, np.array(machine.tool.at))[:, [0, 2]]
    upper, lower = np.linalg.norm(elbow - foot), np.linalg.norm(tool - elbow, axis=1)
    # of the stick against the boom at 0
    bent = np.arctan2(*(tool - elbow).T[::-1]) - np.arctan2(*(elbow - foot)[::-1])
    cells = np.argwhere(np.isfinite(picture.frequency))
    for i, k in cells[:: len(cells) // 12]:
        to = np.array([picture.reach[i], picture.height[k]]) - foot
        cosine = (to @ to - upper**2 - lower**2) / (2 * upper * lower)
        poses = []
        for side in (1, -1):
            inner = side * np.arccos(np.where(abs(cosine) <= 1, cosine, np.nan))
            boom = np.arctan2(to[1], to[0]) - np.arctan2(
                lower * np.sin(inner), upper + lower * np.cos(inner)
            )
            turned = np.column_stack(
                [boom - np.arctan2(*(elbow - foot)[::-1]), inner - bent, q[:, 2]]
            )
            middle = (low + high)[:2] / 2
            turned[:, :2] = (turned[:, :2] - middle + np.pi) % (2 * np.pi) - np.pi + middle
            poses.append(turned[np.all((turned >= low - 1e-9) & (turned <= high + 1e-9), axis=1)])
        poses, lowest = np.concatenate(poses), np.inf
        for payload in machine.payloads:
            case = machine.with_payload(payload.name)
            held = poses[case.holds(poses)]
            lowest = min(lowest, lowest_frequency(case.at(held)).min()) if len(held) else lowest
        assert picture.frequency[i, k] == pytest.approx(lowest, rel=0.02)
