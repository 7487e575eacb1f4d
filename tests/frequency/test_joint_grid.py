"""Numbers between the nodes of a grid, neighbours and nearest places, against SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, map_coordinates
from scipy.spatial import cKDTree

from armdesign.frequency.joint_grid import between_nodes, with_neighbours
from armdesign.frequency.reach_rim import nearest_places

SHAPES = [(7,), (5, 1, 6), (20, 20, 30), (3, 4, 2, 5)]


@pytest.mark.parametrize("shape", SHAPES)
def test_between_nodes(shape: tuple[int, ...]) -> None:
    """Linear, beyond the grid as on its border; none where a node of the box has none."""
    random = np.random.default_rng(0)
    nodes = random.uniform(size=shape)
    steps = random.uniform(-0.5, np.array(shape)[:, None] + 0.5, (len(shape), 2000))
    theirs = map_coordinates(nodes, steps, order=1, mode="nearest")
    assert between_nodes(nodes, steps) == pytest.approx(theirs, abs=1e-14)
    nodes[random.uniform(size=shape) < 0.1] = np.nan
    inside = ((steps > 0) & (steps < np.array(shape)[:, None] - 1)).all(axis=0) | (1 in shape)
    theirs = map_coordinates(nodes, steps, order=1, mode="nearest")[inside]
    ours = between_nodes(nodes, steps)[inside]
    known = np.isfinite(theirs) & np.isfinite(ours)
    assert ours[known] == pytest.approx(theirs[known], abs=1e-14)
    assert 1 in shape or (np.isfinite(ours) == np.isfinite(theirs)).all()


@pytest.mark.parametrize("shape", SHAPES)
def test_with_neighbours(shape: tuple[int, ...]) -> None:
    marked = np.random.default_rng(1).uniform(size=shape) < 0.05
    theirs = binary_dilation(marked, np.ones((3,) * len(shape)))
    assert (with_neighbours(marked) == theirs).all()


@pytest.mark.parametrize(("count", "away"), [(3000, 0.5), (200, 0.01), (12, 1.0)])
def test_nearest_places(count: int, away: float) -> None:
    """The same as of a tree, where the strip is wide enough or too narrow for any."""
    random = np.random.default_rng(2)
    places, middles = random.uniform(size=(count, 2)), random.uniform(size=(40, 2))
    distances, _ = cKDTree(places).query(middles, k=12)
    near = nearest_places(places, middles, 12, away)
    ours = np.linalg.norm(places[near] - middles[:, None], axis=2)
    assert np.sort(ours, axis=1) == pytest.approx(distances, rel=1e-12)
