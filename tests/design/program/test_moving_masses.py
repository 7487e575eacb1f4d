"""Own masses of cylinders and four-bars that follow sizes and pins: closed form, brute force,
derivatives, bounds.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign import Machine, Requirements, Workspace
from armdesign.design.bound.certificate import areas_bound
from armdesign.design.program.constraints import constraints_at
from armdesign.design.program.problem import Problem
from armdesign.design.requirements.check import static_loads
from armdesign.design.requirements.holding import Lift
from armdesign.design.search.prices import prices
from armdesign.frequency.modes import hertz
from tests.checks import assert_same
from tests.design.brute_force import where_allowed, zoomed_best
from tests.design.by_machine import slopes, true_frequencies
from tests.design.designs import as_machine, solved, some_x
from tests.design.program.weighed_machines import bars, posed
from tests.machines import ANY_LIFT_AND_TORQUE, CylinderSpec, Joint, build, named

# ------------------------------------------------------------------ what x stands for, derivatives


@pytest.mark.parametrize(
    "vary", [("areas",), ("areas", "pins"), ("areas", "linkages"), ("linkages",)]
)
def test_frequencies_are_those_of_the_machine_that_x_describes(vary: tuple[str, ...]) -> None:
    """``as_machine`` weighs its bars by hand: area × length of barrel and rod, length of rocker
    and coupler.
    """
    problem = posed(bars("triple"), vary)
    for x in (problem.vector.start, some_x(problem, 1, 0.1), some_x(problem, 2, 0.1)):
        frequencies = np.sqrt(problem.dynamics.omega_squared(x)) / (2 * np.pi)
        assert_allclose(frequencies, true_frequencies(problem, x), rtol=1e-9)


def only_rocker() -> Machine:
    """Nothing weighs but a rocker, as on a loader crane whose table gives the mass of the bracket
    alone.
    """
    cylinders = [
        replace(
            c,
            barrel_mass=0.0,
            rod_mass=0.0,
            linkage_masses=tuple(
                (bar, 0.0 if bar == "coupler" else mass) for bar, mass in c.linkage_masses
            ),
        )
        for c in bars("triple").cylinders
    ]
    return replace(bars("triple"), cylinders=tuple(cylinders))


@pytest.mark.slow
@pytest.mark.parametrize("vary", [("areas",), ("areas", "linkages"), ("linkages",)])
@pytest.mark.parametrize("machine", [bars("triple"), only_rocker()])
def test_derivatives_of_stiffness_less_inertia(machine: Machine, vary: tuple[str, ...]) -> None:
    """∂(K − ω² M), by every variable, against central differences of K and M themselves in one
    frame.
    """
    problem = posed(machine, vary)
    x, squared = some_x(problem, 3), 900.0
    rows = np.linspace(0, len(problem.dynamics.rows) - 1, 5).astype(int)
    expected = slopes(lambda y: problem.dynamics.scaled_stiffness(y, rows, x, squared), x)
    base, actual = problem.dynamics.scaled_stiffness_and_gradient(x, rows, squared)
    assert_allclose(base, problem.dynamics.scaled_stiffness(x, rows), rtol=1e-12)
    for v in range(len(x)):
        assert_same(actual[v], expected[v], 1e-7)


@pytest.mark.parametrize("vary", [("areas",), ("areas", "linkages")])
def test_derivative_of_a_frequency(vary: tuple[str, ...]) -> None:
    """∂ω² = vᵀ(∂K − ω² ∂M)v / vᵀMv of the lowest mode, against central differences of
    the eigenvalue.
    """
    problem = posed(bars("triple"), vary)
    x = some_x(problem, 4)
    row = np.array([problem.dynamics.omega_squared(x).argmin()])
    squared = float(problem.dynamics.omega_squared(x, row)[0])
    base, change = problem.dynamics.scaled_stiffness_and_gradient(x, row, squared)
    mode = np.linalg.eigh(base[0])[1][:, 0]
    expected = slopes(lambda y: problem.dynamics.omega_squared(y, row), x)[:, 0]
    actual = np.einsum("i,vij,j->v", mode, change[:, 0], mode)
    assert_allclose(actual, expected, rtol=0, atol=1e-7 * np.abs(expected).max())


@pytest.mark.slow
@pytest.mark.parametrize("vary", [("areas",), ("cylinder.lift", "cylinder.tilt.four_bar")])
def test_derivatives_of_limits(vary: tuple[str, ...]) -> None:
    """Holding and a lift carry the bars; by every variable against central differences."""
    lift = Lift(name="hook", mass=200.0, joints={"boom": 0.05, "stick": -0.1, "bucket": 0.1})
    problem = posed(bars("triple"), vary, lifts=(lift,))
    x = some_x(problem, 5)
    holding = np.arange(0, len(problem.dynamics.rows), 17)
    expected = slopes(lambda y: constraints_at(problem, y, holding).values, x)
    actual = constraints_at(problem, x, holding)
    assert "lift.hook" in actual.names
    assert_allclose(actual.jacobian.T, expected, rtol=0, atol=1e-8 * np.abs(expected).max())


def test_holding_is_that_of_the_machine_that_x_describes() -> None:
    """Static forces of bars that have grown, by the check's own ``static_loads``."""
    problem = posed(bars("double"), ("areas", "pins"))
    x = some_x(problem, 6, 0.1)
    at, machine = constraints_at(problem, x), as_machine(problem, x)
    push, pull = static_loads(machine, problem.workspace)
    supply, share = machine.supply, problem.requirements.holding_share
    for i, c in enumerate(machine.cylinders):
        held = supply.pressure * c.bore_area - supply.return_pressure * c.annulus_area
        held_back = supply.pressure * c.annulus_area - supply.return_pressure * c.bore_area
        scale = supply.pressure * problem.machine.cylinders[i].bore_area
        rooms = [
            (share * most - load) / scale
            for most, load in ((held, push[i]), (held_back, pull[i]))
            if load > 0
        ]
        expected = min(rooms)
        holding = at.values[[n == f"holding.{c.name}" for n in at.names]]
        assert holding.min() == pytest.approx(expected, rel=1e-9)


def test_only_what_follows_x_is_moved() -> None:
    """Pins that leave the four-bar alone leave its rocker; nothing that varies, nothing that
    follows.
    """

    def own(*vary: str) -> dict[int, list[str]]:
        problem = posed(bars("triple"), vary)
        return (
            {}
            if problem.vector.moving_masses is None
            else {i: list(names) for i, names in problem.vector.moving_masses.bars.items()}
        )

    both = ["barrel", "rod"]
    assert own("areas") == {0: both, 1: both, 2: both}
    assert own("cylinder.tilt.base") == {2: both}
    assert own("cylinder.tilt.four_bar.rocker_mm") == {2: [*both, "rocker", "coupler"]}
    assert own("cylinder.fold.rod_mm") == {1: both}
    assert posed(named("excavator_20t"), ("areas", "pins")).vector.moving_masses is None
    # its rocker weighs, but stays
    assert posed(named("loader_crane"), ("areas", "pins")).vector.moving_masses is None


# ------------------------------------------------------------------------------------- closed form


def lever(rod_kg: float) -> Machine:
    """A cylinder that pushes 20 kg on a lever of 1 m; its rod weighs."""
    boom = Joint("boom", "root", mass=1.0, com=(0.0, 0.0, 0.0), limits=(-1e-3, 1e-3))
    push = CylinderSpec(
        "push",
        ("root", (1.0, 0.0, -2.0)),
        ("boom", (1.0, 0.0, 0.0)),
        rod_mm=60,
        extra=f"rod_kg = {rod_kg}",
    )
    return build([boom], [push], payload=("boom", (1.0, 0.0, 0.0)), payload_kg=20)


@pytest.mark.parametrize("rod_kg", [0.5, 200.0])
def test_one_actuator_closed_form(rod_kg: float) -> None:
    """One cylinder, one pose, oil as today, a rod that may be thinner: the best areas, by hand.

    With dead volumes in proportion k = β (A1/V1 + A2/V2) = c1 A1 + c2 A2 with V per area, and J =
    J0 + u (A1 − A2) with u a square metre of rod. ω² = k r²/J (gravity's share is 1e-3) rises with
    A2, up to the oil; with A1 it rises if c1 (J0 − u A2) > c2 u A2, up to the oil, and else it
    falls, so A1 is as little as Euler's rod leaves: A1 − √(c A1) = A2.
    """
    machine = lever(rod_kg)
    problem = Problem.of(
        machine=machine,
        workspace=Workspace(
            q=np.zeros((1, 1)),
            weights=np.ones(1),
            axes=(np.array([-1e-3, 1e-3]),),
            end_margin=0.02,
            machine=machine,
        ),
        requirements=Requirements(buckling_share=0.3, **ANY_LIFT_AND_TORQUE),
        vary=("areas",),
        proportional=True,
    )
    (c,), at, bare = machine.cylinders, machine.at([0.0]), lever(0.0).at([0.0])
    s = float(at.extensions[0, 0]) * c.stroke
    per_cap = machine.fluid.bulk_modulus / (s + c.cap_dead_volume / c.bore_area)
    per_annulus = machine.fluid.bulk_modulus / (
        c.stroke - s + c.annulus_dead_volume / c.annulus_area
    )
    inertia = bare.mass_matrix[0, 0, 0]
    of_rod = (at.mass_matrix[0, 0, 0] - inertia) / (c.bore_area - c.annulus_area)
    root = math.sqrt(0.3 * (c.bore_area - c.annulus_area) ** 2 / c.bore_area)
    slim = (root / 2 + math.sqrt(root**2 / 4 + c.annulus_area)) ** 2
    rises = per_cap * (inertia - of_rod * c.annulus_area) > per_annulus * of_rod * c.annulus_area
    assert rises == (rod_kg < 1)
    bore = c.bore_area if rises else slim
    stiffness = (per_cap * bore + per_annulus * c.annulus_area) * at.moment_arms[0, 0, 0] ** 2

    search = solved(problem)
    assert_allclose(problem.vector.areas(search.x)[0], [bore, c.annulus_area], rtol=1e-6)
    squared = stiffness / (inertia + of_rod * (bore - c.annulus_area))
    assert search.squared == pytest.approx(squared, rel=2e-3)
    bound = areas_bound(search)
    assert bound is not None
    assert bound >= hertz(search.squared)
    # Euler's rod is replaced by its chord
    assert bound < hertz(search.squared) * (1.001 if rises else 1.2)


# ------------------------------------------------------------------------------------- brute force


class TwoCylinders:
    """ω² of machines whose barrels and rods weigh, by the front door's own poses.

    Inertia, gravity and its slope are affine in each bar's mass: what a kilogram adds is read off
    machines with it.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem, self.machine = problem, problem.machine
        bars = itertools.product(self.machine.cylinders, ("barrel", "rod"))
        keys = [f"cylinder.{c.name}.{bar}_kg" for c, bar in bars]
        light, q = dict.fromkeys(keys, 0.0), problem.workspace.q
        self.bare = self.machine.replace(light).at(q)
        self.with_one = [self.machine.replace(light | {key: 1.0}).at(q) for key in keys]
        self.today = np.array([[c.bore_area, c.annulus_area] for c in self.machine.cylinders])

    def masses(self, a: np.ndarray) -> np.ndarray:
        """Of barrels and rods (n, bars) [kg] with shares ``a`` (n, cylinders, 2) of the areas."""
        today = self.today
        weights = np.array([[c.barrel_mass, c.rod_mass] for c in self.machine.cylinders])
        rod = (a[:, :, 0] * today[:, 0] - a[:, :, 1] * today[:, 1]) / (today[:, 0] - today[:, 1])
        shares = np.stack([a[:, :, 0], rod], axis=2)
        return np.asarray((shares * weights).reshape(len(a), -1))

    def weighed(self, name: str, kg: np.ndarray) -> np.ndarray:
        """What the poses call ``name``, with those masses, (n, poses, …)."""
        base = getattr(self.bare, name)
        added = [getattr(pose, name) - base for pose in self.with_one]
        return np.asarray(base + np.tensordot(kg, added, axes=1))

    def oil(self, a: np.ndarray, i: int) -> np.ndarray:
        """A1²/V1 + A2²/V2 of a cylinder, (n, poses)."""
        c = self.machine.cylinders[i]
        s = self.bare.lengths[:, i] - c.closed_length
        a1, a2 = (a[:, i] * self.today[i]).T[:, :, None]
        v1, v2 = a1 * s + c.cap_dead_volume, a2 * (c.stroke - s) + c.annulus_dead_volume
        return np.asarray(a1**2 / v1 + a2**2 / v2)

    def worst(self, x: np.ndarray) -> np.ndarray:
        """Least ω² [1/s²] over the poses, for each row of area shares."""
        a = x.reshape(-1, 2, 2)
        kg = self.masses(a)
        stiffness = self.weighed("gravity_stiffness", kg) + self.weighed("geometric_stiffness", kg)
        for i, arms in enumerate(np.moveaxis(self.bare.moment_arms, 1, 0)):
            outer = np.einsum("ni,nj->nij", arms, arms)
            stiff = self.machine.fluid.bulk_modulus * self.oil(a, i)
            stiffness = stiffness + stiff[..., None, None] * outer
        lower = np.linalg.inv(np.linalg.cholesky(self.weighed("mass_matrix", kg)))
        modes = np.linalg.eigvalsh(lower @ stiffness @ np.swapaxes(lower, 2, 3))
        return np.asarray(modes[..., 0].min(axis=1))

    def best(self) -> float:
        """Best worst frequency [Hz] over areas on a grid that zooms in."""
        low, high = np.full(4, 0.6), np.full(4, 1.1)
        value = where_allowed(self.problem, self.worst)
        return hertz(zoomed_best(value, low, high, points=9, levels=9, shrink=0.4)[0])


@pytest.mark.parametrize("share", [1.0, 0.95])
def test_two_actuators_against_brute_force(share: float) -> None:
    """Areas that share the oil and carry each other: no grid design is better, none exceeds the
    bound.
    """
    problem = posed(bars("double"), ("areas",), oil_total_share=share, **ANY_LIFT_AND_TORQUE)
    search = solved(problem)
    best, bound = TwoCylinders(problem).best(), areas_bound(search)
    assert bound is not None
    assert search.violation < 1e-9
    assert hertz(search.squared) == pytest.approx(
        true_frequencies(problem, search.x).min(), rel=1e-9
    )
    assert hertz(search.squared) > best * (1 - 1e-6)
    assert best * (1 - 1e-9) < bound < hertz(search.squared) * 1.02


# ----------------------------------------------------------------------------------------- duality


@pytest.mark.parametrize("name", ["single", "double", "triple"])
def test_the_bound_is_the_optimum_where_everything_is_affine(name: str) -> None:
    """K and M affine in the areas, no rod that limits: ω² is quasi-concave, a step without promise
    is the optimum.
    """
    problem = posed(bars(name, 0.1), ("areas",), proportional=True, oil_each_share=1.0)
    search = solved(problem)
    bound = areas_bound(search)
    assert problem.vector.moving_masses is not None
    assert bound is not None
    assert -1e-9 < bound / hertz(search.squared) - 1 < 1e-6


@pytest.mark.parametrize("proportional", [False, True])
def test_the_stand_in_changes_sign_at_the_optimum(proportional: bool) -> None:
    """The stand-in K − λ(M − M0), in any frame M0, changes sign with K − λ M: above at the
    optimum, below beyond it.
    """
    problem = posed(
        bars("double"),
        ("areas",),
        proportional=proportional,
        oil_each_share=1.0,
        buckling_share=0.5,
    )
    search = solved(problem)
    everywhere = np.arange(len(problem.dynamics.rows))
    lowest = []
    for lam in search.squared * np.array([1 - 1e-6, 1 + 1e-6]):
        scaled = problem.dynamics.scaled_stiffness(search.x, everywhere, problem.vector.start, lam)
        lowest.append(np.linalg.eigvalsh(scaled)[:, 0].min() - lam)
    assert lowest[0] > 0 > lowest[1]


def test_complementary_slackness() -> None:
    """A requirement with room is worth nothing: multiplier × slack = 0 at an optimum, with masses
    too.
    """
    search = solved(posed(bars("triple"), ("areas",), proportional=True))
    worth = {label: priced.at_margin for label, priced in prices(search).items()}
    for label in worth:
        room = search.limits.values[[n == label for n in search.limits.names]].min()
        assert worth[label] * room < 1e-7, label
    assert max(worth.values()) > 1e-3


def test_worth_is_the_gain_of_more_oil() -> None:
    """Envelope theorem, against solving again with 0.1 % more: the multiplier knows that more area
    weighs more.
    """
    search = solved(posed(bars("double"), ("areas",)))
    more = solved(posed(bars("double"), ("areas",), oil_total_share=1.001))
    worth = {label: priced.at_margin for label, priced in prices(search).items()}
    gain = 10 * (math.sqrt(more.squared / search.squared) - 1)
    assert gain > 0.002
    assert worth["oil.cap.total"] + worth["oil.annulus.total"] == pytest.approx(gain, rel=0.03)


# ---------------------------------------------------------------------------- a limit, a neighbour


@pytest.mark.slow
def test_light_bars_are_nearly_none() -> None:
    """A thousandth of the masses moves the optimum by their share: masses held at today's then
    make no difference.
    """
    light, bare = bars("double", 1e-3), bars("double", 0.0)
    squares = [
        solved(posed(machine, ("areas", "pins")), 1e-6).squared for machine in (light, bare)
    ]
    assert squares[0] == pytest.approx(squares[1], rel=2e-3)
    heavy = solved(posed(bars("double"), ("areas", "pins")), 1e-6)
    assert heavy.squared < 0.8 * squares[1]


@pytest.mark.slow
@pytest.mark.parametrize("vary", [("areas",), ("areas", "pins")])
def test_no_better_neighbour(vary: tuple[str, ...]) -> None:
    """Moves in random directions that keep all requirements gain less than 1e-4."""
    problem = posed(bars("double"), vary)
    search, random = solved(problem, 1e-6), np.random.default_rng(5)
    low, high = problem.bounds
    for direction in random.normal(size=(80, len(low))):
        for size in (1e-3, 1e-2, 0.05):
            x = np.clip(search.x + size * direction / np.abs(direction).max(), low, high)
            if problem.dynamics.omega_squared(x, search.rows).min() > search.squared * (1 + 1e-4):
                assert constraints_at(problem, x).values.min() < -1e-7


@pytest.mark.slow
def test_the_saved_machine_weighs_what_its_sizes_say(tmp_path: Path) -> None:
    """Masses to the gram from rounded bores, rods and lengths; the search and the file agree on
    the frequency.
    """
    machine = bars("double")
    design = ad.optimize(machine, Workspace.grid(machine, points=4), starts=1)
    saved = ad.load(design.machine.save(tmp_path / "new.toml"))
    for new, old in zip(saved.cylinders, machine.cylinders, strict=True):
        longer = new.closed_length / old.closed_length
        assert new.barrel_mass == pytest.approx(
            old.barrel_mass * (new.bore / old.bore) ** 2 * longer, abs=1e-3
        )
        assert new.rod_mass == pytest.approx(
            old.rod_mass * (new.rod / old.rod) ** 2 * longer, abs=1e-3
        )
    assert min(design.slacks.values()) >= -1e-9
    assert design.after.frame["f1_hz"].min() == pytest.approx(design.unrounded, rel=5e-3)

    """Gravity, and Σ ⟨W, ∂g/∂q − ω² M⟩ for random weights, of random designs, both ways."""
