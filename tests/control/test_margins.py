"""Disk margins: against python-control, closed forms, brute force, and the bounded real lemma."""

from __future__ import annotations

import math

import control
import numpy as np
import pytest
from scipy.optimize import minimize

import armdesign as ad
from armdesign.arrays import Array
from armdesign.control import margins
from armdesign.control.controller import Controller, closed_loop
from armdesign.control.lanes import LANES
from armdesign.control.loops import FINE, Loops
from armdesign.control.margins import (
    SWEEPS,
    Room,
    balanced,
    bound,
    disk_margin_for,
    gain_margin_db,
    largest_norms,
    norms,
    phase_margin,
)
from armdesign.control.stability import stability
from armdesign.simulation.plant.compiled import borrowing
from armdesign.units import deg
from tests.control.machines import many_plants, worst_plant

write_room = borrowing(margins.write_room)
ABOVE = {1: 1e-6, 2: 1e-6, 3: 0.06, 4: 0.08}  # by number of loops: measured, of random matrices


def matrices(size: int, count: int = 50) -> Array:
    generator = np.random.default_rng(size)
    return generator.normal(size=(count, size, size)) + 1j * generator.normal(
        size=(count, size, size)
    )


def structured_norms(some: Array) -> Array:
    """μ(X) (n,) of matrices (n, m, m)."""
    return norms(balanced(some))


def test_the_largest_norm_is_that_of_each_matrix_alone() -> None:
    """Also where most of them are next to diagonal, as sensitivities are: bounds skip these."""
    for size in (1, 2, 3, 4):
        some = matrices(size)
        near = np.eye(size) * (1 + 0.1j) + 0.05 * some
        stacks = np.stack([some, near, 0.3 * some, 0 * some])
        alone = np.stack([np.linalg.svd(stack, compute_uv=False)[:, 0] for stack in stacks])
        last = np.moveaxis(stacks, 1, -1)
        assert (bound(last) >= alone * (1 - 1e-12)).all()
        for least in (0.0, 1.2 * np.median(alone)):
            largest = largest_norms(last, bound(last), np.full(4, least))
            np.testing.assert_allclose(largest, np.maximum(alone.max(axis=1), least), rtol=1e-12)


def test_matrices_are_balanced_alike_alone_and_with_others() -> None:
    """One by one, many along the first axis, and many along the last one."""
    for size in (1, 2, 3, 4):
        some = matrices(size)
        each = np.array([structured_norms(matrix[None])[0] for matrix in some])
        np.testing.assert_allclose(structured_norms(some), each, rtol=1e-12)
        many = np.moveaxis(balanced(np.moveaxis(some, 0, -1)[None])[0], -1, 0)
        np.testing.assert_allclose(np.linalg.svd(many, compute_uv=False)[:, 0], each, rtol=1e-12)


def test_6_db_and_45_deg_need_0_828() -> None:
    """2 (g − 1)/(g + 1) and 2 tan(φ/2): 6 dB needs 2/3, 45 deg need 0.828."""
    assert disk_margin_for(6, 1e-3) == pytest.approx(2 / 3, abs=3e-3)
    assert disk_margin_for(6, 45 * deg) == pytest.approx(2 * math.tan(math.pi / 8))
    assert disk_margin_for(6, 45 * deg) == pytest.approx(0.828, abs=5e-4)
    assert float(gain_margin_db(2 / 3)) == pytest.approx(20 * math.log10(2))
    assert float(phase_margin(0.8284271)) / deg == pytest.approx(45, abs=1e-5)


@pytest.mark.parametrize(("gain", "phase"), [(0, 45), (math.nan, 45), (6, 0), (6, 90), (6, -5)])
def test_margins_that_no_disk_keeps(gain: float, phase: float) -> None:
    with pytest.raises(ad.ArmDesignError, match="margin"):
        disk_margin_for(gain, phase * deg)


def test_one_loop_is_python_controls() -> None:
    """``control.disk_margins`` of one loop, at 50 poses."""
    plant = many_plants()
    loops = Loops.of(plant)
    for pose in range(len(plant)):
        loop = np.moveaxis(loops.positions[pose, :1, :1], -1, 0) * 0.3
        omega = loops.omega[pose]
        response = control.FrequencyResponseData(loop.transpose(1, 2, 0), omega)
        size = np.abs(1 / (1 + response(1j * omega).ravel()) - 0.5)
        norm = structured_norms(1 / (1 + loop) - 0.5)
        assert 1 / norm.max() == pytest.approx(1 / size.max(), rel=1e-9)


@pytest.mark.parametrize("size", [1, 2, 3, 4, 5])
def test_what_cholesky_says_of_a_matrix(size: int) -> None:
    """The norm and the room below a limit, by the singular values of D X D⁻¹, Osborne's D."""
    room, limit, some = Room.of(size), 1.1, matrices(size, LANES)
    some /= structured_norms(some)[:, None, None]
    above = []
    for matrix in some:
        d = np.ones(size)
        for _ in range(SWEEPS if size > 1 else 0):
            for i in range(size):
                others = np.arange(size) != i
                row = np.linalg.norm(matrix[i, others] / d[others])
                d[i] = np.sqrt(np.linalg.norm(matrix[others, i] * d[others]) / row)
        values = np.linalg.svd(matrix * d[:, None] / d, compute_uv=False)
        assert values[0] == pytest.approx(1, rel=1e-12)
        above.append(np.prod(1 - (values / limit) ** 2))
    stacked = np.ascontiguousarray(some.transpose(1, 2, 0))
    write_room(stacked, limit, room)
    np.testing.assert_allclose(room.left, above, rtol=1e-9)
    write_room(stacked, 0.9, room)
    assert (room.left == 0).all()


@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_structured_norm_is_the_least_over_scalings(size: int) -> None:
    """A search over D. Osborne's D is exact for two loops, else never below, and little above.

    So much it is of random matrices; where one mode rings, matrices are nearly of rank one, for
    which it is exact.
    """
    for matrix, norm in zip(matrices(size, 12), structured_norms(matrices(size, 12)), strict=True):

        def scaled(x: Array, of: Array = matrix) -> float:
            d = np.exp(np.concatenate([[0.0], x]))
            return float(np.linalg.norm(of * d[:, None] / d, 2))

        least = min(
            minimize(scaled, start, method="Nelder-Mead", options={"xatol": 1e-9}).fun
            if size > 1
            else scaled(start)
            for start in (np.zeros(size - 1), np.full(size - 1, 0.3))
        )
        assert least * (1 - 1e-6) <= norm <= (1 + ABOVE[size]) * least


def test_structured_norm_of_rank_one_is_exact() -> None:
    """μ(a bᵀ) = Σ |a_i b_i| (Doyle 1982)."""
    a, b = matrices(3)[:, :, 0], matrices(3)[:, :, 1]
    norm = structured_norms(a[:, :, None] * b[:, None, :])
    np.testing.assert_allclose(norm, np.abs(a * b).sum(axis=1), rtol=2e-3)


def test_structured_norm_knows_no_units() -> None:
    units = np.array([1.0, 1e3, 1e-3])
    balanced = structured_norms(matrices(3))
    np.testing.assert_allclose(
        structured_norms(matrices(3) * units[:, None] / units), balanced, rtol=0.02
    )


def test_no_allowed_change_of_all_gains_and_phases_makes_loops_unstable() -> None:
    """Changes in each loop by its own, of the size that the margin guarantees: still stable."""
    plant, factor = worst_plant(), 10 ** (float(gain_margin_db(0.828)) / 20)
    gains = np.full((1, 3), 1.0), np.full((1, 3), 1.9e-4)
    for shares in np.stack(np.meshgrid(*[[-1, 0, 1]] * 3), -1).reshape(-1, 3):
        changed = [gain * factor**shares for gain in gains]
        controller = Controller(position=changed[0], pressure=changed[1], corner=np.array([2.0]))
        poles = np.linalg.eigvals(closed_loop(plant, controller)[0])
        assert poles.real.max() < 1e-6


@pytest.mark.slow
def test_grid_misses_no_peak() -> None:
    """The margin on the grid equals the one on 20 000 frequencies, to 1 %."""
    plant = worst_plant()
    for position, pressure in ((0.095, 0.0), (1.1, 1.9e-4), (0.5, 3e-4)):
        controller = Controller(
            position=np.full((1, 3), position),
            pressure=np.full((1, 3), pressure),
            corner=np.array([2.0]),
        )
        omega = np.geomspace(0.05, 300, 20_000)[None]
        dense = Loops(omega, *plant.response(omega), plant.moment_arms)
        ringing = stability(plant, controller).ringing
        grid = Loops.of(plant, FINE, ringing).figures(controller)
        for name in ("command_margin", "position_margin", "peak"):
            value = getattr(dense.figures(controller), name)
            np.testing.assert_allclose(getattr(grid, name), value, rtol=0.01)
