"""Gains between the poses of a map and beyond them."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import armdesign as ad
from armdesign.control.gain_schedule import _Between
from tests import machines
from tests.control.machines import single_pose


def of_pose(q: np.ndarray) -> np.ndarray:
    """Two gains (n, 2) at poses, linear in these."""
    slopes = np.array([[0.4, -0.2], [0.1, 0.5], [-0.3, 0.2]])[: q.shape[1]]
    return 3.0 + q @ slopes


def grid(points: int, joints: int = 3) -> np.ndarray:
    """Poses of a grid in a box whose sides differ."""
    axes = [np.linspace(-1.0, 1.0 + k, points) for k in range(joints)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, joints)


@pytest.mark.parametrize("joints", [1, 2, 3])
@pytest.mark.parametrize("points", [2, 3, 5])
def test_linear_within_a_box_and_clipped_beyond_it(joints: int, points: int) -> None:
    """The nearest place of a box, by whatever scales of its sides, is the clipped one."""
    q = grid(points, joints)
    between = _Between.of(q, of_pose(q))
    at = np.random.default_rng(joints).uniform(-3.0, 5.0, (300, joints))
    expected = of_pose(np.clip(at, q.min(axis=0), q.max(axis=0)))
    np.testing.assert_allclose(between(at), expected, rtol=1e-7)
    np.testing.assert_allclose(between(q), of_pose(q), rtol=1e-9)


@pytest.mark.parametrize("side", [1e-2, 1e-4, 1e-6])
def test_a_narrow_box_seen_from_afar(side: float) -> None:
    """A joint that hardly moves: the nearest place is still the clipped one."""
    q = grid(4) * np.array([1.0, 1.0, side])
    between = _Between.of(q, of_pose(q))
    at = np.random.default_rng(3).uniform(-3.0, 5.0, (400, 3))
    expected = of_pose(np.clip(at, q.min(axis=0), q.max(axis=0)))
    np.testing.assert_allclose(between(at), expected, rtol=1e-6)


@pytest.mark.parametrize("off", [1e-17, 1e-10, 1e-5])
def test_poses_hardly_off_a_plane_are_on_it(off: float) -> None:
    """A joint that stands still but for its last digits, and poses beside a slanting plane."""
    random, flat = np.random.default_rng(4), grid(4, 2)
    still = np.column_stack([flat, -1.2 + off * random.normal(size=len(flat))])
    slant = np.column_stack([flat, flat[:, 0] + off * random.normal(size=len(flat))])
    for q in (still, slant):
        between = _Between.of(q, of_pose(q))
        np.testing.assert_allclose(between(q), of_pose(q), atol=3 * off + 1e-6)
        at, step = random.uniform(-2.0, 3.0, (2, 2000, 3))
        leap = np.abs(between(at + 1e-7 * step) - between(at)).max()
        assert leap < 1e-4


def test_gains_leap_nowhere() -> None:
    """Of scattered poses with gains that have nothing to do with each other, a corner cut off.

    The nearest pose's gains, as they once were beyond the hull, leap by a third from step to step.
    """
    random = np.random.default_rng(2)
    q = grid(4)
    q = np.concatenate([q[q.sum(axis=1) < 3.0], random.uniform(-0.9, 0.9, (20, 3))])
    between = _Between.of(q, random.uniform(1.0, 2.0, (len(q), 2)))
    at, way = random.uniform(-2.0, 4.0, (20_000, 3)), random.normal(size=(20_000, 3))
    step = 1e-7 * way / np.linalg.norm(way, axis=1)[:, None]
    assert np.abs(between(at + step) - between(at)).max() < 1e-4


def test_poses_on_a_line_and_on_a_plane() -> None:
    """Their gains at the foot of a pose on it, in shares of the joints' ranges."""
    shares = np.linspace(0.0, 1.0, 9)[:, None]
    line = np.array([-1.0, 0.0, 2.0]) + shares * np.array([1.0, 2.0, -4.0])
    between = _Between.of(line, of_pose(line))
    aside = line[4] + 0.3 * np.array([1.0, -2.0, 0.0])  # shares 0.3, −0.3 and 0
    np.testing.assert_allclose(between(np.stack([line[4], aside])), of_pose(line[[4, 4]]))
    flat = grid(4, 2)
    plane = np.column_stack([flat, flat[:, 0]])
    between = _Between.of(plane, of_pose(plane))
    np.testing.assert_allclose(between(plane), of_pose(plane), rtol=1e-8)
    middle = np.array([[0.2, 0.3, 0.2]])
    np.testing.assert_allclose(between(middle), of_pose(middle), rtol=1e-8)


def test_one_pose_and_many_joints() -> None:
    """One pose's gains are those of all; of five joints the nearest pose's are taken."""
    one = np.array([[1.0, 2.0]])
    assert _Between.of(one, one)(np.zeros((3, 2))).tolist() == [[1.0, 2.0]] * 3
    q = np.random.default_rng(0).uniform(size=(40, 5))
    np.testing.assert_array_equal(_Between.of(q, q)(q + 1e-6), q)


def test_it_is_pickled_and_read_again() -> None:
    q = grid(3)
    between = _Between.of(q, of_pose(q))
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(between))(q + 0.3), between(q + 0.3))


def test_gains_of_a_motor_are_by_angle() -> None:
    """Pressure gains are speeds by pressure: of pistons in m/s/bar, of a swing motor in rad/s/bar.

    The schedule reads each column back as the controller's gain of that actuator.
    """
    machine = machines.named("slewing")
    assert [one.name for one in machine.actuators] == ["boom", "stick", "bucket", "swing"]
    q = (0.4, 0.6, -1.2, -0.8)
    bandwidths = ad.bandwidth_map(machine, single_pose(machine, q), damping=0.02)
    columns = [
        *(f"{name}_pressure_gain_m_per_s_bar" for name in ("boom", "stick", "bucket")),
        "swing_pressure_gain_rad_per_s_bar",
    ]
    for table, scheme in ((bandwidths.schedule, ""), (bandwidths.gains, "own_")):
        found = [name for name in table.columns if name.startswith(scheme) and "_bar" in name]
        assert found == [scheme + name for name in columns]
    case = bandwidths.schedule["payload"].iloc[0]
    controller = ad.gain_schedule(bandwidths, case)(q)
    stated = bandwidths.schedule.loc[bandwidths.schedule["payload"] == case, columns]
    assert controller.pressure[0, 3] > 0
    np.testing.assert_array_equal(controller.pressure, stated.to_numpy())
