"""Requirements as constraints c(x) ≥ 0 of the design problem, with exact derivatives.

The same requirements as in ``requirements.py``, but relative to today's machine, differentiable, and at few poses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array
from armdesign.cylinder import STEEL_MODULUS, estimated_mass, euler_safety
from armdesign.design.problem import STEP, Problem
from armdesign.errors import InfeasibleError
from armdesign.poses import static_forces

HOLDING_POSES = 6  # per cylinder, load case and direction
ROUNDING_LENGTH = 3e-4  # [m] what rounding to 0.1 mm may cost the dead length


@dataclass(frozen=True, eq=False)
class Limits:
    """Constraints c(x) ≥ 0 at one x: names, values, Jacobian, and what each gains from relaxing its limit by 1 %."""

    names: list[str]
    values: Array  # (m,)
    jacobian: Array  # (m, nx)
    relaxation: Array  # (m,)


class _Stack:
    """Collects constraints; each value is complex-stepped along every entry of x: (nx,) or (nx, k)."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.values: list[Array] = []
        self.relaxation: list[float] = []

    def add(self, name: str, value: Array, relaxation: float) -> None:
        value = value[:, None] if value.ndim == 1 else value
        self.names += [name] * value.shape[1]
        self.relaxation += [relaxation] * value.shape[1]
        self.values.append(value)

    def limits(self) -> Limits:
        stacked = np.concatenate(self.values, axis=1)
        return Limits(self.names, stacked[0].real, stacked.imag.T / STEP, np.array(self.relaxation))


def limits(problem: Problem, x: Array, holding: Array | None = None) -> Limits:
    """Every requirement at x; holding at the rows given, or at ``holding_rows``."""
    stack = _Stack()
    areas, (closed, stroke) = problem.stepped_areas(x), problem.stepped_strokes(x)
    _oil(problem, areas, stroke, stack)
    _sizes(problem, areas, closed, stroke, stack)
    if problem.requirements.cylinder_mass is not None:
        _mass(problem, areas, stroke, problem.requirements.cylinder_mass, stack)
    _moment_arms(problem, x, areas, stack)
    _holding(problem, x, areas, holding_rows(problem, x) if holding is None else holding, stack)
    return stack.limits()


def _oil(problem: Problem, areas: Array, stroke: Array, stack: _Stack) -> None:
    """Swept volumes of both sides, summed and of each cylinder."""
    r, tight, cylinders = problem.requirements, problem.tightening, problem.machine.cylinders
    for side, label in enumerate(("cap", "annulus")):
        volume = areas[:, :, side] * stroke
        today = problem.areas_today[:, side] * np.array([c.stroke for c in cylinders])
        share = r.oil_total_share * (1 - tight)
        stack.add(f"oil.{label}.total", share - volume.sum(axis=1) / today.sum(), 0.01 * share)
        share = r.oil_each_share * (1 - tight)
        for i, cylinder in enumerate(cylinders):
            stack.add(f"oil.{label}.{cylinder.name}", share - volume[:, i] / today[i], 0.01 * share)


def _sizes(problem: Problem, areas: Array, closed: Array, stroke: Array, stack: _Stack) -> None:
    """Thrust, dead length and buckling of each cylinder."""
    tight = problem.tightening
    share = problem.requirements.thrust_share * (1 - tight)
    moving = {v.cylinder for v in problem.variables if v.pin is not None}
    for i, cylinder in enumerate(problem.machine.cylinders):
        today = problem.areas_today[i, 0]
        stack.add(f"thrust.{cylinder.name}", share - areas[:, i, 0] / today, 0.01 * share)
        room = ROUNDING_LENGTH if tight and i in moving else 0.0
        dead = closed[:, i] - stroke[:, i] - cylinder.dead_length - room
        relaxation = 0.01 * abs(cylinder.dead_length) / cylinder.stroke
        stack.add(f"dead_length.{cylinder.name}", dead / cylinder.stroke, relaxation)
        open_length = closed[:, i] + stroke[:, i]
        needed = open_length * np.sqrt(buckling_factor(problem, i) * (1 + 4 * tight) * areas[:, i, 0])
        rod_area = areas[:, i, 0] - areas[:, i, 1]
        stack.add(f"buckling.{cylinder.name}", (rod_area - needed) / today, 0.005 * float(needed[0].real) / today)


def _mass(problem: Problem, areas: Array, stroke: Array, limit: float, stack: _Stack) -> None:
    """Estimated mass of all cylinders together."""
    counts = np.array([c.count for c in problem.machine.cylinders]) * math.pi / 4
    bores, rods = np.sqrt(areas[:, :, 0] / counts), np.sqrt((areas[:, :, 0] - areas[:, :, 1]) / counts)
    each = estimated_mass(bores, rods, stroke, problem.machine.supply.pressure)
    mass = (each * counts * 4 / math.pi).sum(axis=1)
    stack.add("cylinder_mass", 1 - problem.tightening - mass / limit, 0.01)


def buckling_factor(problem: Problem, i: int) -> float:
    """C in rod area ≥ L √(c A1), which keeps today's Euler safety: π E (A1 − A2)²/(4 n L² p A1) of all n cylinders."""
    cylinder, pressure = problem.machine.cylinders[i], problem.machine.supply.pressure
    safety = euler_safety(cylinder.bore, cylinder.rod, cylinder.open_length, pressure)
    return float(safety * 4 * cylinder.count * pressure / (math.pi * STEEL_MODULUS))


def _moment_arms(problem: Problem, x: Array, areas: Array, stack: _Stack) -> None:
    """Smallest moment arm over the joint range; digging torque at the best pose."""
    r, tight = problem.requirements, problem.tightening
    linkages = problem.linkages(x)
    for i, (cylinder, poses) in enumerate(zip(problem.machine.cylinders, problem.ranges, strict=True)):
        if poses is None:
            continue
        joint, sign = linkages[i].joints[0], np.sign(problem.arms_today[i][0])
        today = np.abs(problem.arms_today[i])
        arm = np.tile(linkages[i].actuation(poses).moment_arm[:, joint].astype(complex), (len(x), 1))
        for index, moved in problem.sensitivities(i, linkages[i], poses):
            arm[index] += 1j * STEP * moved.moment_arm[:, joint] * problem.box
        least = r.moment_arm_share * (1 + tight)
        stack.add(f"moment_arm.{cylinder.name}", sign * arm / today.min() - least, 0.01 * least)
        if cylinder.name in r.digging:
            best = int((sign * arm[0].real).argmax())
            torque = areas[:, i, 0] * sign * arm[:, best] / (problem.areas_today[i, 0] * today.max())
            least = r.digging_share * (1 + tight)
            stack.add(f"digging.{cylinder.name}", torque - least, 0.01 * least)


def _holding(problem: Problem, x: Array, areas: Array, rows: Array, stack: _Stack) -> None:
    """Static force within a share of what the supply holds, at some rows."""
    supply = problem.machine.supply
    least = problem.requirements.holding_share * (1 - problem.tightening)
    arm = problem.geometry(x, problem.workspace.rigid[problem.rows.pose[rows]], derivatives=True).stepped()[1]
    gravity = problem.rows.gravity[rows]
    forces = np.stack([static_forces(arm[v], gravity, areas[v, :, 0]) for v in range(len(x))])
    for i, cylinder in enumerate(problem.machine.cylinders):
        pushes = forces[0, :, i].real > 0
        a1, a2 = areas[:, i, None, 0], areas[:, i, None, 1]
        held = np.where(
            pushes,
            supply.pressure * a1 - supply.return_pressure * a2,
            supply.pressure * a2 - supply.return_pressure * a1,
        )
        scale = supply.pressure * problem.areas_today[i, 0]
        used = forces[:, :, i] * np.where(pushes, 1.0, -1.0)
        relaxation = float(0.01 * least * held[0].real.max() / scale)
        stack.add(f"holding.{cylinder.name}", (least * held - used) / scale, relaxation)


def holding_rows(problem: Problem, x: Array, forces: Array | None = None) -> Array:
    """Rows at which some cylinder carries most, a few per cylinder, load case and direction.

    ``forces`` (rows, nc) are the static forces of all rows at x, if known.
    """
    forces = problem.look(x)[1] if forces is None else forces
    chosen: list[Array] = []
    for k in range(len(problem.machine.payloads)):
        mine = np.flatnonzero(problem.rows.payload == k)
        for i in range(forces.shape[1]):
            few = min(HOLDING_POSES, len(mine))
            if few == 0:
                continue
            ends = [few - 1, len(mine) - few]
            order = mine[np.argpartition(forces[mine, i], ends)]
            chosen += [order[:few], order[-few:]]
    return np.unique(np.concatenate(chosen))


# ------------------------------------------------------------------------------------------- relaxation, areas only


def relaxation(problem: Problem) -> tuple[Limits, Array, Array] | None:
    """Linear constraints that every allowed choice of areas meets, and the box of areas that they leave.

    Constraints are given at the box's lower end. Buckling, A1 − A2 ≥ L √(c A1), is reverse-convex: the root is replaced
    by its chord over the box, which lies below it. None where stiffness is not a sum of convex functions of one area
    each (air, compliance, more cylinders than joints) or pins vary.
    """
    plain = problem.machine.fluid.air == 0 and all(c.compliance == 0 for c in problem.machine.cylinders)
    if not plain or "pins" in problem.vary or len(problem.machine.cylinders) != len(problem.machine.joints):
        return None
    x = problem.start
    exact = limits(problem, x)
    linear = np.array([not name.startswith("buckling") for name in exact.names])
    names = [name for name, keep in zip(exact.names, linear, strict=True) if keep]
    names += [f"buckling.{cylinder.name}" for cylinder in problem.machine.cylinders]
    low, high = problem.bounds
    for _ in range(4):
        chords = [_buckling_chord(problem, i, low[2 * i], high[2 * i]) for i in range(len(problem.machine.cylinders))]
        values = np.concatenate([exact.values[linear] - exact.jacobian[linear] @ x, [c for c, _ in chords]])
        jacobian = np.concatenate([exact.jacobian[linear], [slope for _, slope in chords]])
        low, high = _box_of(values, jacobian, low, high)
    return Limits(names, values + jacobian @ low, jacobian, np.zeros(len(values))), low, high


def _buckling_chord(problem: Problem, i: int, low: float, high: float) -> tuple[float, Array]:
    """Constant and slopes by x of A1 − A2 − L·chord(√(c A1)) ≥ 0 over the box, relative to today's bore area."""
    cylinder, (a1, a2) = problem.machine.cylinders[i], problem.areas_today[i]
    factor = cylinder.open_length * math.sqrt(buckling_factor(problem, i) / a1)
    slope = (math.sqrt(high) - math.sqrt(low)) / (high - low) if high > low else 0.5 / math.sqrt(low)
    row = np.zeros(len(problem.start))
    row[2 * i], row[2 * i + 1] = 1 - factor * slope, -a2 / a1
    return -factor * (math.sqrt(low) - slope * low), row


def _box_of(values: Array, jacobian: Array, low: Array, high: Array) -> tuple[Array, Array]:
    """The smallest box around {low ≤ x ≤ high, values + jacobian x ≥ 0}, by a linear programme per side."""
    from scipy.optimize import linprog

    ends = [low.copy(), high.copy()]
    for v in range(len(low)):
        for end, sign in enumerate((1.0, -1.0)):
            cost = np.zeros(len(low))
            cost[v] = sign
            answer = linprog(cost, A_ub=-jacobian, b_ub=values, bounds=list(zip(low, high, strict=True)))
            if answer.status != 0:
                raise InfeasibleError("areas", "no sizes meet the requirements", "loosen them")
            ends[end][v] = min(max(answer.x[v] - sign * 1e-9, low[v]), high[v])
    return ends[0], ends[1]
