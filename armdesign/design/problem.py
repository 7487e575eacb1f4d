"""The design problem in arrays: stiffness, requirements and their exact derivatives at a vector of design variables.

The vector x holds for every cylinder its bore and annulus area (relative to today's) and the moves of its pins (relative
to the pin box), 1 and 0 for today's machine. Rigid bodies do not depend on x. Derivatives are exact: pins by the
analytic sensitivities of the linkage, everything after them (oil, statics, sums) by a complex step.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armdesign.arm import RigidPoses
from armdesign.arrays import Array
from armdesign.cylinder import STEEL_MODULUS, euler_safety, stiffness
from armdesign.design.requirements import Requirements
from armdesign.errors import InfeasibleError
from armdesign.linkage import Actuation, Linkage, Pin
from armdesign.machine import Machine
from armdesign.poses import static_forces
from armdesign.ranges import sweep
from armdesign.workspace import Workspace

STEP = 1e-30  # complex step: no subtraction, so no cancellation
RANGE_POSES = 61  # over a joint range, where strokes and moment arms are constrained
HOLDING_POSES = 6  # per cylinder, load case and direction


@dataclass(frozen=True, kw_only=True)
class Variable:
    """One entry of x: an area of a cylinder (``pin`` None; axis 0 bore, 1 annulus) or a coordinate of a pin."""

    cylinder: int
    pin: str | None
    axis: int
    lower: float
    upper: float


@dataclass(frozen=True, eq=False)
class Limits:
    """Constraints c(x) ≥ 0 at one x: names, values, Jacobian, and what each value gains from relaxing its limit by 1 %."""

    names: list[str]
    values: Array  # (m,)
    jacobian: Array  # (m, nx)
    relaxation: Array  # (m,)


@dataclass(frozen=True, eq=False)
class Geometry:
    """Lengths, moment arms and their derivatives over some poses, with their derivatives by x.

    length (n, nc), arm (n, nc, nq), curve (n, nc, nq, nq); the d-arrays have x in front: (nx, n, nc, …), or are None.
    """

    length: Array
    arm: Array
    curve: Array
    d_length: Array | None = None
    d_arm: Array | None = None
    d_curve: Array | None = None

    def stepped(self) -> tuple[Array, Array, Array]:
        """The three arrays with a complex step along each entry of x (nx, n, nc, …)."""
        assert self.d_length is not None and self.d_arm is not None and self.d_curve is not None
        return (
            self.length + 1j * STEP * self.d_length,
            self.arm + 1j * STEP * self.d_arm,
            self.curve + 1j * STEP * self.d_curve,
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Problem:
    """Cylinders and pins of ``machine`` over ``workspace`` under ``requirements``; ``vary`` some of "areas" and "pins".

    Rows are pairs of a pose and a load case that exists there.
    """

    machine: Machine
    workspace: Workspace
    requirements: Requirements
    vary: tuple[str, ...]
    tightening: float = 0.0  # share by which limits are drawn in, to leave room for rounding
    proportional: bool = False  # dead volumes grow with the areas

    # ------------------------------------------------------------------------------------------------ variables

    @cached_property
    def box(self) -> float:
        """How far a pin coordinate may move [m]."""
        return self.requirements.box(self.machine, self.workspace)

    @cached_property
    def variables(self) -> list[Variable]:
        """Entries of x: all areas (fixed unless they vary), then the pins that move."""
        made = []
        for i in range(len(self.machine.cylinders)):
            for axis in (0, 1):
                low, high = (0.2, 2.0) if "areas" in self.vary else (1.0, 1.0)
                made.append(Variable(cylinder=i, pin=None, axis=axis, lower=low, upper=high))
        if "pins" in self.vary and self.box > 0:
            for i, linkage in enumerate(self.machine.linkages):
                if len(linkage.joints) != 1:
                    continue  # its range hangs on other cylinders too: strokes would not follow from its pins alone
                for pin in ("base", "rod_end"):
                    if getattr(linkage, pin) is not None:
                        made += [Variable(cylinder=i, pin=pin, axis=a, lower=-1.0, upper=1.0) for a in (0, 2)]
        return made

    @cached_property
    def start(self) -> Array:
        """Today's machine as x."""
        return np.array([1.0 if v.pin is None else 0.0 for v in self.variables])

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper end of every entry of x."""
        return np.array([v.lower for v in self.variables]), np.array([v.upper for v in self.variables])

    def areas(self, x: Array) -> Array:
        """Bore and annulus areas of all parallel cylinders together (nc, 2) [m²]."""
        return np.asarray(x[: 2 * len(self.machine.cylinders)].reshape(-1, 2) * self._areas)

    def linkages(self, x: Array) -> list[Linkage]:
        """Every cylinder's pins at x."""
        made = list(self.machine.linkages)
        for value, v in zip(x, self.variables, strict=True):
            if v.pin is not None:
                old: Pin = getattr(made[v.cylinder], v.pin)
                at = list(old.at)
                at[v.axis] += float(value) * self.box
                moved = Pin(link=old.link, at=(at[0], at[1], at[2]))
                made[v.cylinder] = dataclasses.replace(made[v.cylinder], **{v.pin: moved})
        return made

    @cached_property
    def _areas(self) -> Array:
        return np.array([[c.bore_area, c.annulus_area] for c in self.machine.cylinders])

    # ----------------------------------------------------------------------------------------------------- rows

    @cached_property
    def _rows(self) -> tuple[Array, Array, Array, Array, Array]:
        """Pose index, load case, M, g and ∂g/∂q of every row."""
        parts = []
        for k, payload in enumerate(self.machine.payloads):
            case = self.machine.with_payload(payload.name)
            pose = np.flatnonzero(case.holds(self.workspace.rigid))
            parts.append((pose, np.full(len(pose), k), *case.loaded(self.workspace.rigid[pose])))
        pose, payload_index, mass, gravity, slope = (np.concatenate(p) for p in zip(*parts, strict=True))
        return pose, payload_index, mass, gravity, slope

    @cached_property
    def _inverse_cholesky(self) -> Array:
        """L⁻¹ of M = L Lᵀ for every row: scales each matrix inequality."""
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self._rows[2])))

    def __len__(self) -> int:
        return len(self._rows[0])

    def pose_of(self, rows: Array) -> Array:
        """Joint positions of rows, each joint scaled to its range, the load case in front (for telling rows apart)."""
        low, high = self.workspace.ranges.T
        scaled = (self.workspace.q[self._rows[0][rows]] - low) / (high - low)
        return np.concatenate([self._rows[1][rows, None].astype(float), scaled], axis=1)

    # ------------------------------------------------------------------------------------------------ stiffness

    def geometry(self, x: Array, poses: RigidPoses, derivatives: bool = False) -> Geometry:
        """Every linkage at some poses, with derivatives by x when asked."""
        linkages = self.linkages(x)
        parts = [linkage.actuation(poses) for linkage in linkages]
        length = np.stack([p.length for p in parts], axis=1)
        arm = np.stack([p.moment_arm for p in parts], axis=1)
        curve = np.stack([p.moment_arm_derivative for p in parts], axis=1)
        if not derivatives:
            return Geometry(length, arm, curve)
        changes = [np.zeros((len(x), *value.shape)) for value in (length, arm, curve)]
        for i, linkage in enumerate(linkages):
            for index, moved in self._sensitivities(i, linkage, poses):
                parts_moved = (moved.length, moved.moment_arm, moved.moment_arm_derivative)
                for change, part in zip(changes, parts_moved, strict=True):
                    change[index][:, i] = part * self.box
        return Geometry(length, arm, curve, *changes)

    def _sensitivities(self, i: int, linkage: Linkage, poses: RigidPoses) -> list[tuple[int, Actuation]]:
        """Entries of x that move pins of cylinder ``i``, each with the derivative of its actuation by that pin [1/m]."""
        entries = [(index, v.pin, v.axis) for index, v in enumerate(self.variables) if v.cylinder == i and v.pin]
        moved = linkage.sensitivities(poses, [(pin, axis) for _, pin, axis in entries])
        return [(index, part) for (index, _, _), part in zip(entries, moved, strict=True)]

    def frequencies(self, x: Array, rows: Array | None = None) -> Array:
        """Lowest coupled ω² of rows [rad²/s²] at x (all rows if None)."""
        rows = np.arange(len(self)) if rows is None else rows
        poses, back = np.unique(self._rows[0][rows], return_inverse=True)
        with np.errstate(invalid="ignore", divide="ignore"):
            g = self.geometry(x, self.workspace.rigid[poses])
        strokes = self._strokes(x, self._range_lengths(x)[0])
        matrix = self._stiffness(g.length[back], g.arm[back], g.curve[back], *strokes, self.areas(x), rows)
        lower = self._inverse_cholesky[rows]
        scaled = lower @ matrix @ np.swapaxes(lower, 1, 2)
        bad = ~np.isfinite(scaled).all(axis=(1, 2))
        scaled[bad] = 0.0
        return np.asarray(np.linalg.eigvalsh(scaled)[:, 0])

    def matrices(self, x: Array, rows: Array) -> tuple[Array, Array]:
        """L⁻¹K L⁻ᵀ of rows (n, nq, nq) and its derivatives by x (nx, n, nq, nq)."""
        g = self.geometry(x, self.workspace.rigid[self._rows[0][rows]], derivatives=True)
        length, arm, curve = g.stepped()
        closed, stroke = self._stepped_strokes(x)
        areas = self._stepped_areas(x)
        stepped = np.stack(
            [
                self._stiffness(length[v], arm[v], curve[v], closed[v], stroke[v], areas[v], rows)
                for v in range(len(x))
            ]
        )
        lower = self._inverse_cholesky[rows]
        scaled = lower @ stepped @ np.swapaxes(lower, 1, 2)
        return scaled[0].real, scaled.imag / STEP

    def chord_matrices(self, low: Array, high: Array, rows: Array) -> tuple[Array, Array]:
        """L⁻¹K L⁻ᵀ at areas ``low`` and its slopes by x when each chamber's stiffness is replaced by its chord over the box.

        A²/(A s + V) is convex in A, so the chord lies above it: no areas in the box are stiffer than this says.
        """
        x = self.start
        ends = []
        for v in range(len(x)):
            moved = low.copy()
            moved[v] = high[v]
            ends.append(moved)
        base = self._scaled(low, rows)
        width = np.where(high > low, high - low, 1.0)
        slopes = np.stack([(self._scaled(end, rows) - base) / w for end, w in zip(ends, width, strict=True)])
        return base, slopes

    def _scaled(self, x: Array, rows: Array) -> Array:
        g = self.geometry(x, self.workspace.rigid[self._rows[0][rows]])
        strokes = self._strokes(x, self._range_lengths(x)[0])
        lower = self._inverse_cholesky[rows]
        matrix = self._stiffness(g.length, g.arm, g.curve, *strokes, self.areas(x), rows)
        return np.asarray(lower @ matrix @ np.swapaxes(lower, 1, 2))

    def _stiffness(
        self, length: Array, arm: Array, curve: Array, closed: Array, stroke: Array, areas: Array, rows: Array
    ) -> Array:
        """K of rows: hydraulic + gravity + geometric (n, nq, nq); complex-safe."""
        gravity, slope = self._rows[3][rows], self._rows[4][rows]
        forces = static_forces(arm, gravity, areas[:, 0])
        fluid, return_pressure = self.machine.fluid, self.machine.supply.return_pressure
        oil = []
        for i, cylinder in enumerate(self.machine.cylinders):
            a1, a2 = areas[i]
            if self.proportional:
                old = self._areas[i]
                cylinder = dataclasses.replace(  # noqa: PLW2901
                    cylinder,
                    cap_dead_volume=cylinder.cap_dead_volume * a1 / old[0],
                    annulus_dead_volume=cylinder.annulus_dead_volume * a2 / old[1],
                )
            extension = length[:, i] - closed[i]
            oil.append(stiffness(cylinder, a1, a2, extension, stroke[i], forces[:, i], fluid, return_pressure))
        weighted = arm * np.stack(oil, axis=1)[:, :, None]
        return np.swapaxes(arm, 1, 2) @ weighted + slope - np.einsum("nc,ncij->nij", forces, curve)

    # -------------------------------------------------------------------------------------------------- strokes

    @cached_property
    def ranges(self) -> list[RigidPoses | None]:
        """For every cylinder that moves one joint alone, poses over that joint's range, ends included."""
        arm, ranges = self.machine.arm, self.machine.ranges
        return [
            sweep(arm, k.joints[0], np.linspace(*ranges[k.joints[0]], RANGE_POSES)) if len(k.joints) == 1 else None
            for k in self.machine.linkages
        ]

    def _range_lengths(self, x: Array) -> tuple[list[Array | None], list[Linkage]]:
        linkages = self.linkages(x)
        moving = {v.cylinder for v in self.variables if v.pin is not None}
        found: list[Array | None] = []
        with np.errstate(invalid="ignore"):
            for i, (linkage, poses) in enumerate(zip(linkages, self.ranges, strict=True)):
                found.append(linkage.length(poses) if poses is not None and i in moving else None)
        return found, linkages

    def _strokes(self, x: Array, lengths: list[Array | None]) -> tuple[Array, Array]:
        """Closed length and stroke of each cylinder [m]: least length and span over its joint's range; today's if its
        pins stay.
        """
        closed, stroke = [], []
        for cylinder, length in zip(self.machine.cylinders, lengths, strict=True):
            closed.append(cylinder.closed_length if length is None else length.min())
            stroke.append(cylinder.stroke if length is None else np.ptp(length))
        return np.array(closed), np.array(stroke)

    def _stepped_strokes(self, x: Array) -> tuple[Array, Array]:
        """Closed lengths and strokes with a complex step along each entry of x (nx, nc)."""
        lengths, linkages = self._range_lengths(x)
        closed, stroke = (np.tile(value.astype(complex), (len(x), 1)) for value in self._strokes(x, lengths))
        for i, (poses, length) in enumerate(zip(self.ranges, lengths, strict=True)):
            if poses is None or length is None:
                continue
            ends = [int(length.argmin()), int(length.argmax())]
            for index, moved in self._sensitivities(i, linkages[i], poses[ends]):
                first, last = moved.length * self.box
                closed[index, i] += 1j * STEP * first
                stroke[index, i] += 1j * STEP * (last - first)
        return closed, stroke

    def _stepped_areas(self, x: Array) -> Array:
        areas = np.tile(self.areas(x).astype(complex), (len(x), 1, 1))
        for index, v in enumerate(self.variables):
            if v.pin is None:
                areas[index, v.cylinder, v.axis] += 1j * STEP * self._areas[v.cylinder, v.axis]
        return areas

    # --------------------------------------------------------------------------------------------- requirements

    def limits(self, x: Array, holding: Array | None = None) -> Limits:
        """Every requirement as c(x) ≥ 0, with exact derivatives; holding at the rows given, or at ``holding_rows(x)``."""
        areas, (closed, stroke) = self._stepped_areas(x), self._stepped_strokes(x)
        names: list[str] = []
        values: list[Array] = []  # each (nx, k): complex-stepped along x
        relaxation: list[float] = []

        def add(name: str, value: Array, relax: float) -> None:
            value = value[:, None] if value.ndim == 1 else value
            names.extend([name] * value.shape[1])
            values.append(value)
            relaxation.extend([relax] * value.shape[1])

        r, tight = self.requirements, self.tightening
        nx = len(x)
        for side, label in enumerate(("cap", "annulus")):
            volume = areas[:, :, side] * stroke
            today = np.array([self._areas[i, side] * c.stroke for i, c in enumerate(self.machine.cylinders)])
            share = r.oil_total_share * (1 - tight)
            add(f"oil.{label}.total", share - volume.sum(axis=1) / today.sum(), 0.01 * share)
            for i, cylinder in enumerate(self.machine.cylinders):
                share = r.oil_each_share * (1 - tight)
                add(f"oil.{label}.{cylinder.name}", share - volume[:, i] / today[i], 0.01 * share)
        for i, cylinder in enumerate(self.machine.cylinders):
            share = r.thrust_share * (1 - tight)
            add(f"thrust.{cylinder.name}", share - areas[:, i, 0] / self._areas[i, 0], 0.01 * share)
            dead = closed[:, i] - stroke[:, i] - cylinder.dead_length - 3e-4 * (tight > 0)
            add(f"dead_length.{cylinder.name}", dead / cylinder.stroke, 0.01 * abs(cylinder.dead_length) / cylinder.stroke)
            open_length = closed[:, i] + stroke[:, i]
            needed = open_length * np.sqrt(self._buckling(i) * (1 + 4 * tight) * areas[:, i, 0])
            rod_area = areas[:, i, 0] - areas[:, i, 1]
            add(
                f"buckling.{cylinder.name}",
                (rod_area - needed) / self._areas[i, 0],
                0.005 * float(needed[0].real) / self._areas[i, 0],
            )
        self._arm_limits(x, areas, add)
        self._holding_limits(x, areas, self.holding_rows(x) if holding is None else holding, add)
        stacked = np.concatenate(values, axis=1)
        assert stacked.shape[0] == nx
        return Limits(names, stacked[0].real, stacked.imag.T / STEP, np.array(relaxation))

    def _buckling(self, i: int) -> float:
        """Rod area² ≥ this × bore area × open length² keeps today's Euler safety [m⁻²·m²]."""
        cylinder, pressure = self.machine.cylinders[i], self.machine.supply.pressure
        safety = euler_safety(cylinder.bore, cylinder.rod, cylinder.open_length, pressure)
        return float(safety * 4 * cylinder.count * pressure / (math.pi * STEEL_MODULUS))

    @cached_property
    def _arms_today(self) -> list[Array]:
        """Today's moment arm of each cylinder over its joint's range [m/rad]; empty for a cylinder across several joints."""
        return [
            k.actuation(p).moment_arm[:, k.joints[0]] if p is not None else np.empty(0)
            for k, p in zip(self.machine.linkages, self.ranges, strict=True)
        ]

    def _arm_limits(self, x: Array, areas: Array, add: object) -> None:
        """Smallest moment arm over the joint range; digging torque at the best pose."""
        r, tight = self.requirements, self.tightening
        linkages = self.linkages(x)
        for i, (cylinder, poses) in enumerate(zip(self.machine.cylinders, self.ranges, strict=True)):
            if poses is None:
                continue
            joint = self.machine.linkages[i].joints[0]
            today = self._arms_today[i]
            sign = np.sign(today[0])
            today = np.abs(today)
            arm = linkages[i].actuation(poses).moment_arm[:, joint]
            stepped = np.tile((sign * arm).astype(complex), (len(x), 1))
            for index, moved in self._sensitivities(i, linkages[i], poses):
                stepped[index] += 1j * STEP * sign * moved.moment_arm[:, joint] * self.box
            least = r.moment_arm_share * (1 + tight)
            add(f"moment_arm.{cylinder.name}", stepped / today.min() - least, 0.01 * least)  # type: ignore[operator]
            if cylinder.name in r.digging:
                best = int(stepped[0].real.argmax())
                torque = areas[:, i, 0] * stepped[:, best] / (self._areas[i, 0] * today.max())
                least = r.digging_share * (1 + tight)
                add(f"digging.{cylinder.name}", torque - least, 0.01 * least)  # type: ignore[operator]

    def _holding_limits(self, x: Array, areas: Array, rows: Array, add: object) -> None:
        """Static force within a share of what the supply holds, at the poses where it is nearest to that."""
        share, supply = self.requirements.holding_share, self.machine.supply
        g = self.geometry(x, self.workspace.rigid[self._rows[0][rows]], derivatives=True)
        arm = g.stepped()[1]
        gravity = self._rows[3][rows]
        forces = np.stack([static_forces(arm[v], gravity, areas[v, :, 0]) for v in range(len(x))])
        for i, cylinder in enumerate(self.machine.cylinders):
            pushes = forces[0, :, i].real > 0
            a1, a2 = areas[:, i, None, 0], areas[:, i, None, 1]
            push = supply.pressure * a1 - supply.return_pressure * a2
            pull = supply.pressure * a2 - supply.return_pressure * a1
            held = np.where(pushes, push, pull)
            scale = supply.pressure * self._areas[i, 0]
            used = forces[:, :, i] * np.where(pushes, 1.0, -1.0)
            least = share * (1 - self.tightening)
            relax = float(0.01 * least * held[0].real.max() / scale)
            add(f"holding.{cylinder.name}", (least * held - used) / scale, relax)  # type: ignore[operator]

    def holding_rows(self, x: Array) -> Array:
        """Rows at which some cylinder is nearest to its holding limit, a few per cylinder, load case and direction."""
        g = self.geometry(x, self.workspace.rigid[self.holding_poses])
        back = np.searchsorted(self.holding_poses, self._rows[0])
        known = np.flatnonzero(np.isin(self._rows[0], self.holding_poses))
        forces = static_forces(g.arm[back[known]], self._rows[3][known], self.areas(x)[:, 0])
        chosen: list[Array] = []
        for k in range(len(self.machine.payloads)):
            mine = np.flatnonzero(self._rows[1][known] == k)
            for i in range(forces.shape[1]):
                order = mine[np.argsort(forces[mine, i])]
                chosen += [order[:HOLDING_POSES], order[-HOLDING_POSES:]]
        return np.unique(known[np.concatenate(chosen)])

    @cached_property
    def holding_poses(self) -> Array:
        """Poses at which static forces are watched: a regular share of the workspace."""
        n = len(self.workspace.q)
        return np.arange(0, n, max(1, n // 4000))

    # ------------------------------------------------------------------------------------- relaxation, areas only

    def relaxation(self) -> tuple[Limits, Array, Array] | None:
        """Linear constraints that every allowed choice of areas meets, and the box of areas that they leave.

        Constraints are given at the box's lower end. Buckling, A1 − A2 ≥ L √(c A1), is reverse-convex: the root is replaced
        by its chord over the box, which lies below it. None where stiffness is not a sum of convex functions of one area
        each (air, compliance, more cylinders than joints) or pins vary.
        """
        plain = self.machine.fluid.air == 0 and all(c.compliance == 0 for c in self.machine.cylinders)
        if not plain or "pins" in self.vary or len(self.machine.cylinders) != len(self.machine.joints):
            return None
        x = self.start
        limits = self.limits(x)
        linear = np.array([not name.startswith("buckling") for name in limits.names])
        names = [name for name, keep in zip(limits.names, linear, strict=True) if keep]
        names += [f"buckling.{cylinder.name}" for cylinder in self.machine.cylinders]
        low, high = self.bounds
        for _ in range(4):
            chords = [self._buckling_chord(i, low[2 * i], high[2 * i]) for i in range(len(self.machine.cylinders))]
            values = np.concatenate([limits.values[linear] - limits.jacobian[linear] @ x, [c for c, _ in chords]])
            jacobian = np.concatenate([limits.jacobian[linear], [slope for _, slope in chords]])
            low, high = _box_of(values, jacobian, low, high)
        return Limits(names, values + jacobian @ low, jacobian, np.zeros(len(values))), low, high

    def _buckling_chord(self, i: int, low: float, high: float) -> tuple[float, Array]:
        """Constant and slopes by x of A1 − A2 − L·chord(√(c A1)) ≥ 0 over the box, relative to today's bore area."""
        cylinder, (a1, a2) = self.machine.cylinders[i], self._areas[i]
        factor = cylinder.open_length * math.sqrt(self._buckling(i) / a1)
        slope = (math.sqrt(high) - math.sqrt(low)) / (high - low) if high > low else 0.5 / math.sqrt(low)
        row = np.zeros(len(self.start))
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
