"""The worst pose: refined off the grid, in the workspace, found by an independent search too."""

from __future__ import annotations

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import differential_evolution

import armdesign as ad
from armdesign.frequency.cases import load_cases
from armdesign.frequency.modes import lowest_frequency
from armdesign.frequency.worst_frequency import (
    _Search,
    local_minima,
    lowest_of_poses,
    lowest_rows,
    worst_anywhere,
    worst_frequency,
)
from tests import machines
from tests.frequency.cached import mapped
from tests.opening import opening

SERIAL = ("paper_1dof", "excavator_20t", "four_bar_left", "crossing", "branched")

# Found by tests/reference_planar.py (grid 21 × 21 × 121, of the shipped machine 11 × 11 × 61,
# zoomed), which shares no code with the package.
WORST_FREQUENCY = {"excavator_20t": 0.767092, "rigid_excavator_20t": 0.910210}
WORST_Q = [1.154484, -1.057556, -2.191324]


def test_sobol_and_grid_find_the_same_worst_pose() -> None:
    machine = machines.named("excavator_20t")
    worst = ad.frequency_map(machine, ad.Workspace.sobol(machine, 1000)).worst
    assert worst.frequency == pytest.approx(WORST_FREQUENCY[machine.name], abs=1e-6)


@pytest.mark.parametrize("name", [*SERIAL, "redundant", "spatial"])
def test_worst_pose_is_below_the_grid_and_inside(name: str) -> None:
    """Refinement only lowers the minimum, never leaves the workspace, and its numbers belong to
    its pose.
    """
    frequencies, machine = mapped(name, 4), machines.named(name)
    worst = frequencies.worst
    assert worst.frequency <= frequencies.frame["f1_hz"].min() + 1e-12
    loaded = machine.with_payload(worst.payload)
    low, high = frequencies.workspace.ranges.T
    assert np.all((worst.q >= low) & (worst.q <= high))
    assert loaded.margins(worst.q).min() >= frequencies.workspace.end_margin - 1e-9
    assert loaded.holds(worst.q).all()
    poses = loaded.at(worst.q)
    assert_allclose(worst.frequency, ad.natural_modes(poses).frequencies[0, 0], rtol=1e-12)
    assert_allclose(worst.tool, poses.tool[0], atol=1e-12)
    assert worst.cylinder in {cylinder.name for cylinder in machine.cylinders}
    assert worst.joints == machine.joints


def test_no_search_is_spent_on_another_slew_of_the_same_arm() -> None:
    """A slew changes no frequency: of four starts three were the first one slewed."""
    machine = machines.slewing()
    workspace = ad.Workspace.grid(machine, points=[5, 3, 3, 3])
    poses, _ = lowest_of_poses([machine], workspace)[0].starts["full"]
    arms = poses[:, 1:] / np.ptp(workspace.ranges, axis=1)[1:]
    apart = np.abs(arms[:, None] - arms).max(axis=2) + np.eye(len(arms))
    assert len(arms) == 4
    assert apart.min() > 0.2


@pytest.mark.parametrize("name", ["paper_1dof", "excavator_20t", "crossing"])
def test_grid_minimum_never_rises_when_the_grid_is_refined(name: str) -> None:
    """STYLE, known answer 7: grids of 3, 5, 9 values contain each other; the worst pose hardly
    moves.
    """
    minima = [mapped(name, points).frame["f1_hz"].min() for points in (3, 5, 9)]
    assert minima[0] >= minima[1] - 1e-12
    assert minima[1] >= minima[2] - 1e-12
    assert mapped(name, 9).worst.frequency == pytest.approx(
        mapped(name, 5).worst.frequency, rel=1e-3
    )


@pytest.mark.parametrize("name", ["excavator_20t", "redundant"])
def test_the_limiting_cylinder_is_the_one_whose_stiffening_helps_most(name: str) -> None:
    """Rayleigh: f² rises with k_i in proportion to cylinder i's share of the mode's spring
    energy.
    """
    frequencies, machine = mapped(name, 4), machines.named(name)
    assert len(frequencies.limiting) == len(frequencies.frame)
    worst = frequencies.worst
    poses = machine.with_payload(worst.payload).at(worst.q)
    gains = []
    for i in range(len(machine.cylinders)):
        extra = (
            1e-4
            * poses.oil_stiffness[0, i]
            * np.outer(poses.moment_arms[0, i], poses.moment_arms[0, i])
        )
        shape = ad.natural_modes(poses).shapes[0, :, 0]
        gains.append(shape @ extra @ shape)
    assert machine.cylinders[int(np.argmax(gains))].name == worst.cylinder


@pytest.mark.parametrize("points", [(5, 5, 7), (9, 9, 15)])
@pytest.mark.parametrize("name", WORST_FREQUENCY)
def test_worst_pose_agrees_with_an_independent_search(name: str, points: tuple[int, ...]) -> None:
    worst = mapped(name, points).worst
    assert worst.frequency == pytest.approx(WORST_FREQUENCY[name], abs=1e-6)
    assert_allclose(worst.q, WORST_Q, atol=2e-5)
    assert worst.payload == "full"
    assert worst.cylinder == "boom"


def test_heavier_links_are_searched_between_the_poses_too() -> None:
    """Against the map of a machine whose URDF has the heavier links; the worst is off the grid."""
    machine, share = machines.named("spatial"), 1.3
    number = r'(?<=<mass value=")[^"]+|(?<= i[xyz][xyz]=")[^"]+'
    urdf = re.sub(number, lambda value: repr(share * float(value[0])), machine.urdf_text)
    heavy = ad.Machine.from_text(machine.text, urdf, machine.source)
    expected = ad.frequency_map(heavy, ad.Workspace.grid(heavy, 2)).worst
    workspace = ad.Workspace.grid(machine, 2)
    worst = worst_anywhere(machine, workspace, link_share=share)
    assert worst.frequency == pytest.approx(expected.frequency, rel=1e-6)
    assert worst.cylinder == expected.cylinder
    assert_allclose(worst.q, expected.q, atol=1e-3)
    lowest = worst_frequency(machine, workspace, link_share=share).frequency
    assert worst.frequency < 0.9 * lowest


@pytest.mark.parametrize("name", ["excavator_20t", "excavator_12t", "patu_boom", "loader_crane"])
def test_from_poses_far_above_the_lowest_no_search_ends_lower(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Against searches from all of them, as in the file and with structure as soft as oil."""
    machine = machines.named(name)
    soft = ad.Bands(structure=(1.0, 1.0)).at_end(machine, frozenset())
    workspace = ad.Workspace.grid(machine)
    found = [worst_anywhere(one, workspace).frequency for one in (machine, soft)]
    monkeypatch.setattr("armdesign.frequency.worst_frequency.FAR", np.inf)
    every = [worst_anywhere(one, workspace).frequency for one in (machine, soft)]
    assert_allclose(found, every, rtol=1e-7)


@pytest.mark.parametrize("name", ["excavator_20t", "excavator_12t"])
def test_a_kink_between_the_poses_of_a_coarse_grid_is_found(name: str) -> None:
    """Much air: the worst pose lies where stick and bucket bear no load, in a kink.

    Against scipy's differential evolution, the best of three. By hand: a cylinder whose chambers
    both stand at return pressure p bears p (A1 − A2). Descents alone from the coarse grid end 8
    and 12 % higher.
    """
    machine = machines.named(name).replace({"fluid.entrained_air_percent": 3.0})
    workspace = ad.Workspace.grid(machine, points=3)
    worst = ad.frequency_map(machine, workspace).worst
    case = machine.with_payload(worst.payload)

    def frequency(q: np.ndarray) -> np.ndarray:
        allowed = case.holds(q.T) & workspace.in_stroke(q.T)
        found = np.full(len(allowed), 1e3)
        found[allowed] = ad.natural_modes(case.at(q.T[allowed])).frequencies[:, 0]
        return found

    least = min(
        differential_evolution(
            frequency,
            workspace.ranges,
            rng=seed,
            popsize=40,
            tol=1e-8,
            vectorized=True,
            updating="deferred",
            polish=False,
        ).fun
        for seed in range(3)
    )
    assert worst.frequency == pytest.approx(least, rel=1e-4)
    stick = machine.cylinders[1]
    rest = (
        machine.section.supply.return_pressure_bar * 1e5 * (stick.bore_area - stick.annulus_area)
    )
    assert case.at(worst.q).cylinder_forces[0, 1] == pytest.approx(rest, rel=0.01)


def test_equally_low_poses_come_in_the_order_of_the_workspace() -> None:
    """Brute force: sorting all; what sorts them differs between kinds of processors."""
    frequency = np.tile([3.0, 1.0, 2.0], 2000)
    in_order = sorted(range(6000), key=lambda row: (frequency[row], row))[:300]
    assert lowest_rows(frequency).tolist() == in_order


def test_a_descent_from_where_a_four_bar_is_open_ends_in_the_workspace() -> None:
    """It has no frequency and no strokes there: the way back is by how far it is open."""
    machine = opening()
    workspace = ad.Workspace.grid(machine, points=4)
    case = next(load_cases(machine, workspace))
    frequency = lowest_frequency(case.machine.at(workspace.q))
    q = np.array([[0.4, -1.0, 0.75]])
    assert np.isneginf(machine.margins(q)).any()
    minima = [at for at, _ in local_minima(case, frequency, q)]
    assert len(minima) > 1
    assert machine.margins(np.array(minima)).min() >= workspace.end_margin - 1e-9
    search = _Search(case)
    for x in np.array([[0.6, 0.6, 0.905], [0.6, 0.6, 0.88]]):  # open, and next to that
        value, slopes = search.value_and_gradient(x)
        assert np.isfinite([value, *slopes, *search.room(x)]).all()
