"""Lengths, moment arms and their derivatives by joints and pins, against finite differences.

The machines are the shipped ones and the odd ones of `machines.py`: four-bars of either knee,
spatial arms, telescopes, cylinders across joints.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign.mechanism.linkage.four_bar import FourBar
from tests.checks import assert_same, difference
from tests.machines import inner_poses, named

FOUR_BAR = ("base", "pivot", "lug", "rocker", "coupler")  # its places


def test_moment_arms_are_derivatives_of_lengths(machine: ad.Machine) -> None:
    """Virtual work, τ = Rᵀ F, asks for R = ∂ℓ/∂q and nothing else; H = ∂R/∂q (finite
    differences).
    """
    q = inner_poses(machine, 4)
    for linkage in machine.drives:
        actuation = linkage.actuation(machine.arm.kinematics(q))
        arms = difference(lambda x, k=linkage: k.length(machine.arm.kinematics(x)), q)
        curves = difference(
            lambda x, k=linkage: k.actuation(machine.arm.kinematics(x)).moment_arm, q
        )
        assert_same(actuation.moment_arm, arms, 1e-9)
        assert_same(actuation.moment_arm_derivative, curves, 1e-8)
        assert np.all(np.delete(actuation.moment_arm, linkage.joints, axis=1) == 0)


@pytest.mark.parametrize("place", ["rod_end", *FOUR_BAR])
def test_steps_are_derivatives_by_every_pin_and_bar(machine: ad.Machine, place: str) -> None:
    """ℓ, r, H and the cosine at the knee against central differences, whose rounding is 1e-9; of
    all coordinates of a place at once, and at poses that repeat values of the linkage's joint.
    """
    poses, step = machine.arm.kinematics(np.tile(inner_poses(machine, 3), (3, 1))), 1e-30
    for linkage in machine.linkages:
        at = linkage.place(place)
        if at is None:
            with pytest.raises(ValueError, match=place):
                linkage.stepped_actuation(poses, [(place, 0)], step)
            with pytest.raises(ValueError, match=place):
                linkage.with_places({place: (0.0, 0.0, 0.0)})
            continue
        moves = [(place, axis) for axis in range(len(at))]
        exact = linkage.stepped_actuation(poses, moves, step)
        shift = 1e-6 * np.eye(len(at))
        for rows, change in zip(
            np.split(np.arange(len(exact.length)), len(at)), shift, strict=True
        ):
            ends = [linkage.with_places({place: np.array(at) + sign * change}) for sign in (1, -1)]
            known = [end.actuation(poses) for end in ends]
            for name in ("length", "moment_arm", "moment_arm_derivative"):
                new, old = (getattr(one, name) for one in known)
                slope = getattr(exact, name)[rows].imag / step
                assert_allclose(slope, (new - old) / 2e-6, rtol=1e-6, atol=1e-9)
            assert_allclose(exact.length[rows].real, linkage.length(poses), rtol=1e-12)
        if linkage.transmission_words:
            stepped = linkage.stepped(moves, step, len(poses))
            slopes = stepped.transmission(poses.repeated(len(at))).imag.reshape(len(at), -1)
            for slope, change in zip(slopes / step, shift, strict=True):
                new, old = (
                    linkage.with_places({place: np.array(at) + sign * change}).transmission(poses)
                    for sign in (1, -1)
                )
                assert_allclose(slope, (new - old) / 2e-6, rtol=1e-6, atol=1e-9)


def test_a_moved_pin_is_where_it_was_put() -> None:
    """`with_places` changes one place and nothing else, and gives back what it was given."""
    linkage = named("excavator_20t").linkages[2]
    for place in FOUR_BAR:
        at = linkage.place(place)
        assert at is not None
        moved = linkage.with_places({place: tuple(value + 0.01 for value in at)})
        assert_allclose(moved.place(place), np.array(at) + 0.01, rtol=1e-15)
        assert moved.with_places({place: at}) == linkage


def test_the_knee_is_on_its_side_and_at_both_bars() -> None:
    """By definition: rocker from the pivot, coupler from the lug, left or right seen with x right
    and z up.
    """
    for name, side in (("four_bar_left", 1), ("four_bar_right", -1), ("excavator_20t", 1)):
        machine = named(name)
        poses = machine.arm.kinematics(inner_poses(machine, 5))
        bars = machine.linkages[2]
        assert isinstance(bars, FourBar)
        to_local = np.swapaxes(machine.arm.link_rotation(poses, bars.pivot.link), 1, 2)
        pivot = machine.arm.point(poses, bars.pivot.link, np.array(bars.pivot.at))
        lug = machine.arm.point(poses, bars.lug.link, np.array(bars.lug.at))
        knee = bars.ends(poses)[1]
        rocker, to_lug = (
            np.einsum("nij,nj->ni", to_local, x - pivot)[:, [0, 2]] for x in (knee, lug)
        )
        assert_allclose(np.linalg.norm(rocker, axis=1), bars.rocker, rtol=1e-12)
        assert_allclose(np.linalg.norm(rocker - to_lug, axis=1), bars.coupler, rtol=1e-12)
        turn = to_lug[:, 0] * rocker[:, 1] - to_lug[:, 1] * rocker[:, 0]
        assert np.all(np.sign(turn) == side)
        u, v = -rocker, to_lug - rocker
        angle = np.arccos(np.sum(u * v, axis=1) / bars.rocker / bars.coupler)
        assert_allclose(np.arccos(bars.transmission(poses)), angle, rtol=1e-9)
