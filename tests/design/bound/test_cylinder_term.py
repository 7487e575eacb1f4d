"""Terms of cylinders hold stiffness, and their slopes are derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings

from armdesign import Machine
from armdesign.design.bound.cylinder_constraints import cylinder_constraints
from armdesign.design.bound.cylinder_spring import CylinderSpring, Structure
from armdesign.design.bound.cylinder_term import CylinderTerm
from armdesign.design.bound.intervals import Interval, interval
from armdesign.design.bound.shape_of_pins import coordinates
from armdesign.hydraulics.actuator import Cylinder
from armdesign.mechanism.joint_ranges import sweep
from tests.design.bound.shapes import (
    CYLINDERS,
    ROUNDING,
    box_around,
    box_shares,
    cylinder,
    designs,
    some_design,
)


def stiffnesses(
    machine: Machine, cylinder: Cylinder, out: np.ndarray, force: np.ndarray, area: np.ndarray
) -> np.ndarray:
    """Of a cylinder, (areas, extensions) [N/m]."""
    return np.array(
        [
            cylinder.stiffness(
                out,
                force,
                machine.fluid,
                machine.supply,
                areas=tuple(pair),
                stroke=cylinder.stroke,
            )
            for pair in area
        ]
    )


@pytest.mark.parametrize(
    "soft", [0.4, *(pytest.param(soft, marks=pytest.mark.slow) for soft in (0.0, 3.0))]
)
@pytest.mark.parametrize(
    "name", ["lift", *(pytest.param(c, marks=pytest.mark.slow) for c in CYLINDERS if c != "lift")]
)
@settings(max_examples=60)
@given(seed=designs, width=box_shares, place=box_shares)
def test_terms_hold_stiffness(
    name: str, soft: float, seed: int, width: list[float], place: list[float]
) -> None:
    """k r² − F H − μ·v by the machine's own formulas, at any pins of a box and any v, is below
    the box's bound, also with structure ``soft`` times as compliant as the oil at mid stroke.

    Boxes of no width, and of one v where structure yields, are exact.
    """
    problem, i, angles, shape = cylinder(name)
    x, random = some_design(problem, seed), np.random.default_rng(seed)
    machine, old = problem.machine, problem.machine.cylinders[i]
    joint, limits = machine.linkages[i].joints[0], cylinder_constraints(problem, i)
    assert limits is not None
    exact = problem.vector.linkages(x)[i].actuation(sweep(machine.arm, joint, angles))
    arm, (closed, stroke) = exact.moment_arm[:, joint], np.stack(problem.vector.strokes(x))[:, i]
    if (arm * shape.sign).min() < 1e-3:
        return  # not a cylinder that works
    compliance = soft * old.oil_compliance(machine.fluid, machine.supply)
    old = replace(old, compliance=compliance, closed_length=closed, stroke=stroke)
    area = np.array([old.bore_area, old.annulus_area]) * random.uniform(0.5, 1.1, (5, 2))
    weight, gravity = random.uniform(0, 1, len(angles)), random.normal(size=len(angles)) * 1e4
    force, curve = gravity / arm, exact.moment_arm_derivative[:, joint, joint]
    price = random.normal(size=2) * 1e6
    k = stiffnesses(machine, old, exact.length - closed, force, area)
    values = (k * arm**2 - force * curve) @ weight - area @ price * stroke
    torque, beta = interval(np.append([0, 0], gravity * shape.sign)), machine.fluid.bulk_modulus
    structure = Structure(np.full(len(angles) + 2, old.compliance), beta, torque)
    share = CylinderTerm(
        shape=shape,
        limits=limits,
        structure=structure if soft else None,
        weight=np.concatenate([[0, 0], weight * beta]),
        bend=interval(np.concatenate([[0, 0], weight * gravity])),
        price=price,
        dead=np.array([old.cap_dead_volume, old.annulus_dead_volume]),
        hoses=np.zeros(2),
    )
    at = coordinates(problem, i, shape, x)
    low, high = box_around(at, shape, np.array(width) * 0.1, np.array(place))
    volume, scale = area * stroke, np.abs(values).max()
    assert np.all(bounds(share, low, high, volume) >= values - ROUNDING * scale)
    together = 1 if soft else 5
    for volumes, exact_ones in zip(
        volume.reshape(-1, together, 2), values.reshape(-1, together), strict=True
    ):
        none = bounds(share, at[None], at[None], volumes)
        np.testing.assert_allclose(none, exact_ones, atol=1e-8 * scale)


def bounds(
    share: CylinderTerm, low: np.ndarray, high: np.ndarray, volume: np.ndarray
) -> np.ndarray:
    """Upper bounds (v,) of a term over a box at swept volumes (v, 2), infinite where not known."""
    e = share.shape.enclose(low[:, :2], high[:, :2])
    scale = Interval(np.maximum(low[:, 2], 1e-3), high[:, 2])
    costs, volumes = share.price[:, None], volume.T[..., None]
    bound = share.enclosed(e, volumes, costs, share.spring(e, scale, volumes, costs))[0]
    return np.nan_to_num(bound[:, 0], nan=np.inf)


@pytest.mark.parametrize("yields", [False, True])
@pytest.mark.parametrize("name", CYLINDERS)
def test_slopes_of_a_term_are_its_derivatives(name: str, yields: bool) -> None:
    """In a box of no width they are |∂/∂b|, by central differences of the value; 1e-6: their
    truncation.
    """
    problem, i, angles, shape = cylinder(name)
    limits, random, n = cylinder_constraints(problem, i), np.random.default_rng(5), len(angles) + 2
    assert limits is not None
    weight, bend = (
        np.concatenate([[0, 0], random.uniform(size=n - 2)]),
        np.concatenate([[0, 0], random.normal(size=n - 2)]),
    )
    dead = problem.vector.areas_today[i] * problem.machine.cylinders[i].stroke * 0.3
    share = CylinderTerm(
        shape=shape, limits=limits, weight=weight, bend=interval(1e-3 * bend), price=np.zeros(2),
        dead=dead,
        hoses=np.zeros(2),
    )  # fmt: skip
    volume = (
        problem.vector.areas_today[i]
        * problem.machine.cylinders[i].stroke
        * random.uniform(0.5, 1.5, (5, 2))
    ).T[..., None]
    spring = CylinderSpring()
    if yields:  # at any tangents, and with the piston further out
        shift, t = interval(np.full((n, 1), 0.01)), random.uniform(size=(n, 1))
        spring = CylinderSpring(shift=shift, oil=(1 - t) ** 2, structure=t**2)
    # off the telescope's axis
    at = coordinates(problem, i, shape, problem.vector.start)[:2] + 0.05 * (shape.high - shape.low)

    def value(b: np.ndarray) -> np.ndarray:
        e, costs = shape.enclose(b[None], b[None]), share.price[:, None]
        return share.enclosed(e, volume, costs, spring)[0][:, 0]

    steps = 1e-5 * (shape.high - shape.low)
    slopes = [(value(at + step) - value(at - step)) / (2 * step.sum()) for step in np.diag(steps)]
    slope_at_point = share.slopes(shape.enclose(at[None], at[None]), volume, spring)[0][..., 0]
    np.testing.assert_allclose(
        slope_at_point, np.abs(slopes), atol=1e-6 * np.abs(slope_at_point).max()
    )
