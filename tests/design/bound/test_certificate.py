"""The upper bound for pins and areas: above every design that can be found, near the best, honest
about the rest.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import armdesign as ad
from armdesign import Requirements, Workspace
from armdesign.design.bound import certificate
from armdesign.design.bound.branching import first_look, nearer
from armdesign.design.bound.certificate import certificate_of
from armdesign.design.bound.columns import joint_drives
from armdesign.design.bound.lagrangian import LagrangianDual, Multipliers
from armdesign.design.bound.regions import COARSE, ENOUGH, FINE
from armdesign.design.program.constraints import constraints_at
from armdesign.design.program.problem import Problem
from armdesign.design.search.sequential_sdp import Search
from armdesign.frequency.bands import Bands
from armdesign.frequency.modes import hertz
from tests.design.bound.one_cylinder import OneCylinder
from tests.design.designs import as_machine, problem_of, solved, workspace_of
from tests.machines import ANY_LIFT_AND_TORQUE, BOOM, FOLD, LIFT, STICK, build, named, redundant

# of ω² between two bounds of nested problems: cutting ends that far from what is reached
TOLERANCE = (1 + ENOUGH) ** 2 - 1


@cache
def finished(name: str) -> Search:
    return solved(problem_of(name), 1e-6)


def bound_of(search: Search) -> float:
    bound = certificate_of(search.problem, search.x, search.rows)
    assert bound is not None
    return bound.frequency


def feasible_designs(
    problem: Problem, count: int, seed: int = 0, own: str = ""
) -> list[np.ndarray]:
    """Random pins and areas that meet all requirements, or one cylinder's, by ``limits`` at
    all holding rows.
    """
    random = np.random.default_rng(seed)
    low, high = problem.bounds
    pins = np.array([v.pin is not None for v in problem.vector.variables])
    feasible: list[np.ndarray] = []
    for _ in range(200 * count):
        x = np.where(
            pins,
            random.uniform(low, high) * random.uniform(0, 1),
            random.uniform(0.8, 1.1, len(low)),
        )
        at = constraints_at(problem, x)
        own_rows = np.array([name.endswith(own) for name in at.names])
        if at.values[own_rows].min() >= 0:
            feasible.append(x)
        if len(feasible) == count:
            break
    assert len(feasible) >= count / 3
    return feasible


# -------------------------------------------------------------------------------- shipped machines

SHIPPED = (
    "excavator_20t",
    "excavator_12t",
    "mini_excavator_2t",
    "loader_crane",
    "patu_boom",
    "paper_1dof",
)


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPPED)
def test_bound_of_every_shipped_machine(name: str) -> None:
    """Above the optimum on all its poses, and near it; no cylinder is left out.

    With rigid structure and oil without air.
    """
    machine = named(f"rigid_{name}").replace({"fluid.entrained_air_percent": 0.0})
    design = ad.optimize(machine, starts=1)
    assert design.bound is not None
    assert design.gap is not None
    assert design.certificate is not None
    assert design.certificate.held == ()
    assert 0 <= design.gap <= ENOUGH
    assert design.bound == pytest.approx(design.unrounded * (1 + design.gap))


@pytest.mark.slow
@pytest.mark.parametrize("name", SHIPPED)
def test_bound_of_gains_with_structure_that_yields(name: str) -> None:
    """Above the design of free sizes, and near it; no cylinder is taken as rigid."""
    design = ad.optimize(named(name), starts=1, catalogue="free")
    assert design.gap is not None
    assert design.certificate is not None
    assert design.certificate.held == ()
    assert 0 <= design.gap <= ENOUGH


# ------------------------------------------------------------------------------------- brute force


@pytest.mark.slow
def test_one_cylinder_against_brute_force() -> None:
    """The paper's mechanism: 13⁴ pins a level say where the global optimum is; the bound lies
    above it by < 0.6 %.
    """
    machine = named("paper_1dof")
    workspace = Workspace.grid(machine, points=(25,))
    problem = Problem.of(
        machine=machine,
        workspace=workspace,
        requirements=replace(Requirements.of(machine), **ANY_LIFT_AND_TORQUE),
        vary=("areas", "pins"),
    )
    search = solved(problem)
    best, bound = OneCylinder(problem).best(), bound_of(search)
    assert hertz(search.squared) == pytest.approx(best, rel=1e-3)
    assert best * (1 - 1e-9) <= bound < best * 1.006


# -------------------------------------------------------------------------------------- any design


@pytest.mark.slow
@pytest.mark.parametrize("name", ["double", "sprung", "yielding"])
def test_no_random_design_exceeds_the_bound(name: str) -> None:
    """Two joints that share oil: allowed designs drawn in the boxes, by the package's front
    door; on springs, or on structure in series with the oil.
    """
    search = finished(name)
    bound, problem = bound_of(search), search.problem
    reached = [
        hertz(problem.dynamics.omega_squared(x).min()) for x in feasible_designs(problem, 60)
    ]
    assert max(reached) > hertz(problem.dynamics.omega_squared(problem.vector.start).min())
    assert max([*reached, hertz(search.squared)]) <= bound
    assert bound < hertz(search.squared) * 1.05


@pytest.mark.slow
def test_no_random_design_exceeds_the_bound_of_gains() -> None:
    """Over a band of structure from rigid: above all designs, and not above what one end says."""
    problem = problem_of("double", bands=Bands(structure=(0.0, 1.0)), gain=True)
    search = solved(problem, 1e-5)
    own_bound = certificate.certificate_within_bands(problem, search.x, search.rows)
    assert own_bound is not None
    reached = [
        hertz(problem.dynamics.omega_squared(x).min()) for x in feasible_designs(problem, 40)
    ]
    assert max([*reached, hertz(search.squared)]) <= own_bound.frequency
    for k, weight in enumerate(problem.dynamics.corners.weights):
        end = problem.at_corner(k)
        alone = certificate_of(end, search.x, np.arange(len(end.dynamics.rows)))
        assert alone is not None
        assert own_bound.frequency**2 <= alone.frequency**2 / weight * (1 + TOLERANCE)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "seed"),
    [*(("double", seed) for seed in range(4)), ("sprung", 0), ("yielding", 0), ("yielding", 1)],
)
def test_any_prices_give_a_bound(name: str, seed: int) -> None:
    """Random prices in place of the solver's: less tight, but nothing that is allowed exceeds
    them.
    """
    search = finished(name)
    problem, random = search.problem, np.random.default_rng(seed)
    dual = LagrangianDual.start(problem, joint_drives(problem), search.x, search.rows)
    inverse, base = dual.scaled_bases(dual.rows)
    root = random.normal(size=base.shape)
    z = root @ np.swapaxes(root, 1, 2)
    z /= np.trace(z, axis1=1, axis2=2).sum()
    oil, (budget, today) = random.uniform(0, 2, 2), dual.budget
    multipliers = Multipliers(
        rows=dual.rows,
        columns=dual.columns,
        weight=np.swapaxes(inverse, 1, 2) @ z @ inverse / dual.reference,
        trace=np.trace(z, axis1=1, axis2=2),
        oil=oil / today,
        constant=float(np.einsum("nij,nij->", z, base) + oil.sum() * budget),
        light=1.0,
        mixed=0.0,
        mixture=np.ones(len(dual.columns)),
    )
    upper = multipliers.constant + sum(m.upper for m in dual.maxima(multipliers, FINE))
    for x in [search.x, *feasible_designs(problem, 20, seed)]:
        assert problem.dynamics.omega_squared(x, dual.rows).min() / dual.reference <= upper * (
            1 + 1e-9
        )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["double", "yielding", "excavator"])
def test_branching_against_dense_sampling(name: str) -> None:
    """Each share, by ``Poses`` of sampled machines that meet the cylinder's own requirements,
    stays below its maximum.

    What branching says it reached is reached: its value is below its upper end by the tolerance at
    most.
    """
    search = finished(name)
    problem = search.problem
    dual = LagrangianDual.start(problem, joint_drives(problem), search.x, search.rows)
    multipliers = dual.converged()
    maxima = dual.maxima(multipliers, REACHED)
    for k, (drive, most) in enumerate(zip(dual.drives, maxima, strict=True)):
        assert most.value <= most.upper <= most.value + REACHED
        own = f".{problem.machine.cylinders[drive.cylinder].name}"
        values = []
        for x in [search.x, *feasible_designs(problem, 15, k, own)]:
            machine = as_machine(problem, x)
            value = -multipliers.oil @ (
                problem.vector.areas(x)[drive.cylinder] * machine.cylinders[drive.cylinder].stroke
            )
            for row, weight in zip(multipliers.rows, multipliers.weight[:, k, k], strict=True):
                case = machine.with_payload(
                    machine.payloads[problem.dynamics.rows.payload[row]].name
                )
                poses = case.evaluate(problem.workspace.rigid[problem.dynamics.rows.pose[[row]]])
                i, j = drive.cylinder, drive.joint
                stiffness = poses.oil_stiffness[0, i] * poses.moment_arms[0, i, j] ** 2
                stiffness -= poses.cylinder_forces[0, i] * poses.moment_arm_derivatives[0, i, j, j]
                value += weight * stiffness
            values.append(value)
        assert max(values) <= most.upper + 1e-9


# ------------------------------------------------------------------------------------ monotonicity

REACHED = 0.02  # tolerance of ω² to which so many cells lead


@pytest.mark.parametrize(
    "change",
    [
        {"oil_each_share": 1.0},
        *(
            pytest.param({name: share}, marks=pytest.mark.slow)
            for name, share in (
                ("pin_box", 0.02),
                ("thrust_share", 1.02),
                ("moment_arm_share", 0.98),
                ("holding_share", 0.5),
            )
        ),
    ],
    ids=lambda change: next(iter(change)),
)
def test_tighter_requirements_never_raise_a_share(change: dict[str, float]) -> None:
    """At equal multipliers each cylinder's most falls or stays, to the tolerance of branching."""
    wide = finished("double")
    dual = LagrangianDual.start(wide.problem, joint_drives(wide.problem), wide.x, wide.rows)
    for share, drive in zip(
        dual.terms(dual.multipliers()), joint_drives(problem_of("double", **change)), strict=True
    ):
        region = {
            name: getattr(drive.shape, name) for name in ("low", "high", "scale", "pin_boxes")
        }
        narrow = replace(share, limits=drive.limits, shape=replace(share.shape, **region))
        tight, loose = (nearer(s, first_look(s), REACHED, 50_000) for s in (narrow, share))
        assert loose.upper - loose.value <= REACHED
        assert tight.upper <= loose.upper + REACHED


@pytest.mark.slow
@pytest.mark.parametrize(
    "change", [{"pin_box": 0.02}, {"oil_total_share": 0.97}], ids=lambda change: next(iter(change))
)
def test_tighter_requirements_never_raise_the_bound(change: dict[str, float]) -> None:
    """A smaller pin box, less oil: the bound as a whole falls."""
    narrow = bound_of(solved(problem_of("double", **change), 1e-5))
    assert narrow**2 <= bound_of(finished("double")) ** 2 * (1 + TOLERANCE)


# ------------------------------------------------------------------------------- what is not known


@pytest.mark.slow
def test_a_cylinder_of_unknown_shape_is_taken_as_rigid() -> None:
    """Pins out of the plane are not known: the joint is held, which only stiffens; the bound says
    so and holds.
    """
    machine = build([BOOM, STICK], [replace(LIFT, base=("root", (0.7, 0.05, 0.1))), FOLD])
    workspace = Workspace.grid(machine, points=(5, 5))
    problem = Problem.of(
        machine=machine,
        workspace=workspace,
        requirements=Requirements.of(machine),
        vary=("areas", "pins"),
    )
    search = solved(problem, 1e-5)
    bound = certificate_of(problem, search.x, search.rows)
    assert bound is not None
    assert bound.held == ("lift",)
    assert "the lift cylinder rigid" in bound.assumptions
    assert bound.frequency >= hertz(search.squared)


@pytest.mark.slow
def test_no_bound_where_joints_are_shared() -> None:
    """Several cylinders on every joint share its load."""
    single, machine = problem_of("single"), redundant()
    workspace = Workspace.grid(machine, points=[4] * len(machine.joints))
    given = {"workspace": workspace, "requirements": Requirements.of(machine)}
    problem = Problem.of(machine=machine, **given, vary=("areas", "pins"))
    assert (
        certificate_of(problem, problem.vector.start, np.arange(len(problem.dynamics.rows)))
        is None
    )
    assert (
        certificate_of(single, single.vector.start, np.arange(len(single.dynamics.rows)))
        is not None
    )


@pytest.mark.slow
@pytest.mark.parametrize("vary", [("areas",), ("areas", "pins")])
def test_structure_lowers_the_bound_too(vary: tuple[str, ...]) -> None:
    """Of one cylinder: above all random designs, near the best found, below the bounds of oil
    alone and of structure alone.

    The latter is the limit of a rigid oil: k = 1/c, of which only moment arms count.
    """
    requirements, bounds = Requirements.of(build([BOOM], [LIFT])), {}
    for soft in (0.0, 1e-8, 1e-6):
        extra = f"compliance_m_per_N = {soft}" if soft else ""
        machine = build([BOOM], [replace(LIFT, extra=extra)])
        problem = Problem.of(machine, workspace_of("single"), requirements, vary)
        search = solved(problem, 1e-5)
        bounds[soft] = bound_of(search)
        reached = [
            hertz(problem.dynamics.omega_squared(x).min()) for x in feasible_designs(problem, 20)
        ]
        assert max([*reached, hertz(search.squared)]) <= bounds[soft]
        # measured, rounded up
        assert bounds[soft] < hertz(search.squared) * 1.02
    assert bounds[1e-6] < bounds[1e-8] < bounds[0.0] * 0.99


@pytest.mark.slow
@pytest.mark.parametrize("percent", [0.5, 2.0])
@pytest.mark.parametrize("vary", [("areas",), ("areas", "pins")])
def test_air_lowers_the_bound_too(percent: float, vary: tuple[str, ...]) -> None:
    """Each chamber's oil at the greatest pressure that its design allows: no random design exceeds
    it.
    """
    machine = build([BOOM], [LIFT], air_percent=percent)
    requirements = Requirements.of(machine)
    problem = Problem.of(
        machine=machine, workspace=workspace_of("single"), requirements=requirements, vary=vary
    )
    search = solved(problem, 1e-5)
    bound = certificate_of(problem, search.x, search.rows)
    assert bound is not None
    reached = [
        hertz(problem.dynamics.omega_squared(x).min()) for x in feasible_designs(problem, 30)
    ]
    assert max([*reached, hertz(search.squared)]) <= bound.frequency
    # measured, rounded up: 10 % of it is duality's
    assert bound.frequency < hertz(search.squared) * 1.12
    airless = Problem.of(build([BOOM], [LIFT]), problem.workspace, requirements, vary)
    without = certificate_of(airless, search.x, search.rows)
    assert without is not None
    assert bound.frequency < without.frequency * 0.99


def test_chambers_are_no_stiffer_than_their_pressures_let_them() -> None:
    """Air's β over boxes of pins and volumes is never below a machine's in them, by its own
    static pressures.
    """
    hose = "hose = { cap_l = 0.9, annulus_l = 0.4, bulk_modulus_MPa = 400 }"
    machine = build([BOOM], [replace(LIFT, extra=hose)],
                    air_percent=1.0)  # fmt: skip
    problem = Problem.of(
        machine=machine,
        workspace=workspace_of("single"),
        requirements=Requirements.of(machine),
        vary=("areas", "pins"),
    )
    search = solved(problem, 1e-4)
    dual = LagrangianDual.start(problem, joint_drives(problem), search.x, search.rows)
    multipliers = dual.converged()
    (most,) = dual.maxima(multipliers, COARSE)
    for x in [search.x, *feasible_designs(problem, 20)]:
        squared = problem.dynamics.omega_squared(x, multipliers.rows)
        # one joint: Σ ⟨Z, L⁻¹K L⁻ᵀ⟩ is the weighted mean
        weighted = multipliers.trace @ (squared / dual.reference)
        assert weighted <= multipliers.constant + most.upper + 1e-9
