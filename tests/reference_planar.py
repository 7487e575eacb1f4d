"""An independent planar reference for `armdesign`: the same physics by other methods, in plain
numpy and scipy.

It reads the machine file (TOML and URDF) itself and imports nothing of `armdesign`. Where
production code uses formulas, this file differentiates the definition:

- inertia from the Jacobians of the links' centres of mass, in the plane;
- gravity torque by complex step of the potential energy;
- moment arm by complex step of the pin-to-pin length;
- stiffness by eighth-order central differences of the net static torque with the oil trapped, so
  that neither the oil
stiffness
  β (A1²/V1 + A2²/V2) nor the geometric stiffness ∂g/∂q − Σ F0 H is ever written down.

Scope: a serial chain of revolute joints about −y (x right, z up, positive counter-clockwise), one
cylinder per joint, pin to pin or through a four-bar; other joints frozen, at 0 unless their axis
is −y too; constant bulk modulus, massless cylinders.
Anything else in the file raises `NotImplementedError`. Arrays have the pose on axis 0, then the
cylinder or joint. SI inside.
"""

import itertools
import tomllib
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import brentq

GRAVITY = 9.81  # [m/s²], as in pinocchio and in the paper's M_eq = F/9.81
STEEL = 210e9  # Young's modulus of the rods [Pa]; cancels in the ratio of two machines
COMPLEX_STEP = 1e-30
# Central difference of order 8: coefficients of f(q + k h) − f(q − k h), k = 1…4; with 4 mrad
# truncation and rounding are both about 1e-11.
DIFFERENCE = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
DIFFERENCE_STEP = 4e-3  # [rad]
PITCH_TOLERANCE = 1e-9  # [rad], so that a pose exactly on the limit of the pitch counts
TOLERANCE = 1e-6  # relative, for "satisfied"
RANGE_TOLERANCE = 20e-6  # [m], the rounding of lengths in a machine file
DEFAULTS = dict(
    end_margin=0.02,
    holding_share=0.87,
    oil_total_share=1.0,
    oil_each_share=1.1,
    thrust_share=1.1,
    moment_arm_share=0.8,
    transmission_deg=20.0,
)


@dataclass(frozen=True)
class Frame:
    """Where a link hangs: on `parent`, at (x, z), turned by `angle`, and by q[joint] if `joint` is
    not None.
    """

    parent: str
    x: float
    z: float
    angle: float
    joint: int | None


@dataclass(frozen=True)
class Body:
    """A rigid mass on a link: centre of mass (x, z) in the link's frame, inertia about it."""

    link: str
    mass: float
    x: float
    z: float
    inertia: float


@dataclass(frozen=True)
class Pin:
    link: str
    x: float
    z: float


@dataclass(frozen=True)
class FourBar:
    pivot: Pin
    lug: Pin
    rocker: float
    coupler: float
    side: int  # +1: the knee lies left of pivot → lug


@dataclass(frozen=True)
class Cylinder:
    name: str
    count: int
    bore: float
    rod: float
    stroke: float
    closed: float
    dead_cap: float
    dead_annulus: float
    base: Pin
    rod_end: Pin | None
    four_bar: FourBar | None

    @property
    def bore_area(self):
        """Bore side of all parallel cylinders together [m²]."""
        return self.count * np.pi / 4 * self.bore**2

    @property
    def annulus_area(self):
        return self.count * np.pi / 4 * (self.bore**2 - self.rod**2)


@dataclass(frozen=True)
class Payload:
    name: str
    body: Body | None  # None: nothing there
    pitch: tuple[float, float] | None  # [rad], of the link's x axis; None: always held


class Reference:
    """One machine, as its file describes it."""

    def __init__(self, data, urdf):
        self.name = data["name"]
        self.joints = list(data["joints"])
        self.links, self.bodies, self.limits = _read_urdf(
            urdf, self.joints, data.get("frozen", {})
        )
        self.cylinders = [_read_cylinder(name, table) for name, table in data["cylinder"].items()]
        self.cases = {
            name: _read_payload(name, table)
            for name, table in data.get("payload", {"empty": {}}).items()
        }
        self.tool = _read_pin(data["tool"])
        fluid, supply = data["fluid"], data["supply"]
        if fluid.get("entrained_air_percent", 0):
            raise NotImplementedError("oil with air")
        self.bulk_modulus = fluid["bulk_modulus_MPa"] * 1e6
        self.supply_pressure = supply["pressure_bar"] * 1e5
        self.return_pressure = supply.get("return_pressure_bar", 0) * 1e5
        self.requirement_table = DEFAULTS | data.get("requirements", {})
        self.bore_areas = np.array([cylinder.bore_area for cylinder in self.cylinders])
        self.annulus_areas = np.array([cylinder.annulus_area for cylinder in self.cylinders])
        self.joint_of = self._joint_of_each_cylinder()
        self.ranges = self.ranges_with(0.0)

    @classmethod
    def load(cls, path):
        path = Path(path)
        data = tomllib.loads(path.read_text(encoding="utf-8"))
        return cls(data, (path.parent / data["urdf"]).read_text(encoding="utf-8"))

    @property
    def payloads(self):
        return list(self.cases)

    # ---- geometry; works for real and for complex q
    # ------------------------------------------------------------------

    def frames(self, q):
        """x, z, angle of every link, (n,) each."""
        zero = np.zeros(len(q), dtype=q.dtype)
        frames = {}

        def place(link):
            if link not in frames:
                if link not in self.links:  # the root
                    frames[link] = zero, zero, zero
                else:
                    here = self.links[link]
                    x, z, angle = place(here.parent)
                    turn = here.angle + (0 if here.joint is None else q[:, here.joint])
                    frames[link] = *_turned(x, z, angle, here.x, here.z), angle + turn
            return frames[link]

        for link in self.links:
            place(link)
        return frames

    def joint_chain(self, link):
        """(joint, link whose origin lies on its axis) for every joint between the root and
        `link`.
        """
        chain = []
        while link in self.links:
            here = self.links[link]
            if here.joint is not None:
                chain.append((here.joint, link))
            link = here.parent
        return chain

    def lengths(self, q):
        """Pin-to-pin length of every cylinder (n, nc) [m]; nan where a four-bar does not close."""
        q = _poses(q)
        frames = self.frames(q)
        lengths = []
        for cylinder in self.cylinders:
            x, z = self._rod_end(frames, cylinder)
            base_x, base_z = _at(frames, cylinder.base)
            lengths.append(np.sqrt((x - base_x) ** 2 + (z - base_z) ** 2))
        return np.stack(lengths, axis=1)

    def _rod_end(self, frames, cylinder):
        if cylinder.four_bar is None:
            return _at(frames, cylinder.rod_end)
        bar = cylinder.four_bar
        pivot_x, pivot_z = _at(frames, bar.pivot)
        lug_x, lug_z = _at(frames, bar.lug)
        distance = np.sqrt((lug_x - pivot_x) ** 2 + (lug_z - pivot_z) ** 2)
        along_x, along_z = (lug_x - pivot_x) / distance, (lug_z - pivot_z) / distance
        along = (bar.rocker**2 - bar.coupler**2 + distance**2) / (2 * distance)
        square = bar.rocker**2 - along**2
        aside = bar.side * np.sqrt(np.where(square.real < 0, np.nan, square))
        return (
            pivot_x + along * along_x - aside * along_z,
            pivot_z + along * along_z + aside * along_x,
        )

    def transmission_angles(self, q, cylinder):
        """Angle between the lines of rocker and coupler (n,) [rad], 0 at a dead centre."""
        frames = self.frames(_poses(q))
        knee, bar = self._rod_end(frames, cylinder), cylinder.four_bar
        (ax, az), (bx, bz) = (np.subtract(_at(frames, pin), knee) for pin in (bar.pivot, bar.lug))
        return np.arcsin(np.clip(abs(ax * bz - az * bx) / (bar.rocker * bar.coupler), 0, 1))

    def moment_arms(self, q):
        """∂ℓ/∂q (n, nc, nq) [m/rad], by complex step."""
        return np.stack(
            [self._complex_step(self.lengths, q, joint) for joint in range(len(self.joints))],
            axis=2,
        )

    def _complex_step(self, function, q, joint):
        stepped = _poses(q).astype(complex)
        stepped[:, joint] += 1j * COMPLEX_STEP
        return function(stepped).imag / COMPLEX_STEP

    def pitch(self, q, link):
        """Angle of the link's x axis, up from forward (n,) [rad], not wrapped."""
        return self.frames(_poses(q))[link][2]

    def tool_distance(self, q, joint):
        """Distance of the tool from the axis of a joint (n,) [m]."""
        frames = self.frames(_poses(q))
        link = next(link for index, link in self.joint_chain(self.tool.link) if index == joint)
        x, z = _at(frames, self.tool)
        return np.hypot(x - frames[link][0], z - frames[link][1])

    # ---- masses
    # ---------------------------------------------------------------------------------------------

    def bodies_with(self, payload):
        body = self.cases[payload].body
        return self.bodies if body is None else [*self.bodies, body]

    def mass_matrix(self, q, payload):
        """Σ m JᵀJ + I over the bodies (n, nq, nq): a joint moves a point at right angles to the
        line from its axis.
        """
        q = _poses(q)
        frames = self.frames(q)
        mass_matrix = np.zeros((len(q), len(self.joints), len(self.joints)))
        for body in self.bodies_with(payload):
            x, z = _at(frames, body)
            arms = {
                joint: (x - frames[link][0], z - frames[link][1])
                for joint, link in self.joint_chain(body.link)
            }
            for (i, (xi, zi)), (j, (xj, zj)) in itertools.product(arms.items(), repeat=2):
                mass_matrix[:, i, j] += body.mass * (xi * xj + zi * zj) + body.inertia
        return mass_matrix

    def potential_energy(self, q, payload):
        """U(q) = Σ m g z (n,) [J]."""
        frames = self.frames(q)
        return sum(
            body.mass * GRAVITY * _at(frames, body)[1] for body in self.bodies_with(payload)
        )

    def gravity_torque(self, q, payload):
        """∂U/∂q (n, nq) [N m], by complex step."""
        return np.stack(
            [
                self._complex_step(lambda at: self.potential_energy(at, payload), q, j)
                for j in range(len(self.joints))
            ],
            axis=1,
        )

    # ---- hydraulics
    # ---------------------------------------------------------------------------------------------

    def forces(self, q, payload):
        """Static force of every cylinder (n, nc) [N], + pushes: g = Rᵀ F."""
        transposed = np.swapaxes(self.moment_arms(q), 1, 2)
        return np.linalg.solve(transposed, self.gravity_torque(q, payload)[:, :, None])[:, :, 0]

    def volumes(self, lengths):
        """Chamber volumes (cap, annulus), (n, nc) [m³]."""
        closed, stroke, dead_cap, dead_annulus = np.array(
            [(c.closed, c.stroke, c.dead_cap, c.dead_annulus) for c in self.cylinders]
        ).T
        extension = lengths - closed
        return (
            self.bore_areas * extension + dead_cap,
            self.annulus_areas * (stroke - extension) + dead_annulus,
        )

    def stiffness_matrix(self, q, payload):
        """−∂/∂q of the net torque Rᵀ F − g with the oil trapped at q (n, nq, nq) [N m/rad].

        In a closed chamber dp = −β dV/V, hence p = p0 + β ln(V0/V), and F = F0 + β (A1 ln(V10/V1)
        − A2 ln(V20/V2)).
        """
        q = _poses(q)
        force = self.forces(q, payload)
        cap, annulus = self.volumes(self.lengths(q))

        def net_torque(moved):
            cap_now, annulus_now = self.volumes(self.lengths(moved))
            rise = self.bore_areas * np.log(cap / cap_now) - self.annulus_areas * np.log(
                annulus / annulus_now
            )
            pushed = np.einsum(
                "nij,ni->nj", self.moment_arms(moved), force + self.bulk_modulus * rise
            )
            return pushed - self.gravity_torque(moved, payload)

        stiffness = np.zeros((len(q), len(self.joints), len(self.joints)))
        for joint, (k, coefficient) in itertools.product(
            range(len(self.joints)), enumerate(DIFFERENCE, start=1)
        ):
            step = np.zeros(len(self.joints))
            step[joint] = k * DIFFERENCE_STEP
            stiffness[:, :, joint] -= (
                coefficient * (net_torque(q + step) - net_torque(q - step)) / DIFFERENCE_STEP
            )
        return stiffness

    def frequencies(self, q, payload):
        """Coupled natural frequencies (n, nq) [Hz], ascending; 0 where the pose is not stable."""
        stiffness = self.stiffness_matrix(q, payload)
        symmetric = (stiffness + np.swapaxes(stiffness, 1, 2)) / 2
        pairs = zip(symmetric, self.mass_matrix(q, payload), strict=True)
        squares = np.array([eigh(k, m, eigvals_only=True, check_finite=False) for k, m in pairs])
        return np.sqrt(np.maximum(squares, 0)) / (2 * np.pi)

    # ---- ranges and workspace
    # ----------------------------------------------------------------------------------------

    def _joint_of_each_cylinder(self):
        """Joint of each cylinder.

        From the tree, because a probing pose need not close the four-bar.
        """
        joints = []
        for cylinder in self.cylinders:
            far = cylinder.rod_end or cylinder.four_bar.lug
            between = {j for j, _ in self.joint_chain(far.link)} ^ {
                j for j, _ in self.joint_chain(cylinder.base.link)
            }
            if len(between) != 1:
                raise NotImplementedError(f"{cylinder.name} cylinder spans {len(between)} joints")
            joints.append(between.pop())
        if sorted(joints) != list(range(len(self.joints))):
            raise NotImplementedError("one cylinder per joint")
        return joints

    def along(self, joint, values):
        """Poses (n, nq) in which one joint takes `values`; the length of its cylinder does not
        feel the others.
        """
        q = np.zeros((len(values), len(self.joints)))
        q[:, joint] = values
        return q

    def ranges_with(self, end_margin):
        """Joint ranges (nq, 2): every cylinder at least `end_margin` from its ends, cut by the
        URDF limits.
        """
        ranges = np.array(self.limits)
        for index, (cylinder, joint) in enumerate(zip(self.cylinders, self.joint_of, strict=True)):

            def room(values, index=index, cylinder=cylinder, joint=joint):
                length = self.lengths(self.along(joint, np.atleast_1d(values)))[:, index]
                inner = length - cylinder.closed - end_margin * cylinder.stroke
                outer = cylinder.closed + (1 - end_margin) * cylinder.stroke - length
                return np.nan_to_num(np.minimum(inner, outer), nan=-1.0)

            values = np.linspace(*self.limits[joint], 4001)
            inside = np.flatnonzero(room(values) >= 0)
            if not len(inside):
                raise ValueError(f"{cylinder.name} cylinder: no pose within its stroke")
            first, last = max(np.split(inside, np.flatnonzero(np.diff(inside) > 1) + 1), key=len)[
                [0, -1]
            ]

            def root(a, b, room=room):
                return brentq(lambda value: room(value)[0], a, b, xtol=1e-14)

            low = values[0] if first == 0 else root(values[first - 1], values[first])
            high = values[-1] if last == len(values) - 1 else root(values[last], values[last + 1])
            ranges[joint] = low, high
        return ranges

    def holds(self, q, payload):
        """Whether the payload exists at these poses (n,): the pitch of its link is in the range
        the file gives.
        """
        q, case = _poses(q), self.cases[payload]
        if case.pitch is None:
            return np.ones(len(q), dtype=bool)
        low, high = case.pitch
        beyond = (self.pitch(q, case.body.link) - low + PITCH_TOLERANCE) % (2 * np.pi)
        return beyond <= high - low + 2 * PITCH_TOLERANCE

    def onto_pitch_limits(self, q, payload, joint):
        """Copies of the poses with one joint moved so that the payload stands exactly on a limit
        of its pitch.
        """
        case = self.cases[payload]
        if case.pitch is None or joint not in dict(self.joint_chain(case.body.link)):
            return q[:0]
        copies = []
        for limit, turn in itertools.product(case.pitch, (-2 * np.pi, 0, 2 * np.pi)):
            moved = q.copy()
            moved[:, joint] += limit + turn - self.pitch(q, case.body.link)
            copies.append(moved)
        return np.concatenate(copies)

    def workspace(self, payload, end_margin=0.02, points=(21, 21, 121)):
        """Joint grid with its edges (n, nq): ends of the ranges and poses exactly at the payload's
        pitch limits.
        """
        ranges = self.ranges_with(end_margin)
        axes = [
            np.linspace(*bounds, number) for bounds, number in zip(ranges, points, strict=True)
        ]
        grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
        edges = [  # this joint solved for the limit, the others on the grid
            self.onto_pitch_limits(grid[grid[:, joint] == axes[joint][0]], payload, joint)
            for joint in range(len(axes))
        ]
        return self._inside(np.concatenate([grid, *edges]), ranges, payload)

    def _inside(self, q, ranges, payload):
        q = q[((q >= ranges[:, 0] - 1e-12) & (q <= ranges[:, 1] + 1e-12)).all(axis=1)]
        return q[self.holds(q, payload)]

    def smallest(self, function, end_margin, points, payload, starts=6):
        """(value, q) of the smallest `function(q)` over this machine's workspace, refined off the
        grid by zooming.

        Infinite, with q None, where no pose of the workspace holds the payload.
        """
        q = self.workspace(payload, end_margin, points)
        if not len(q):
            return np.inf, None
        values = function(q)
        ranges = self.ranges_with(end_margin)
        spacing = (ranges[:, 1] - ranges[:, 0]) / (np.array(points) - 1)
        found = []
        for _ in range(starts):
            if not np.isfinite(values).any():
                break
            best = np.nanargmin(values)
            found.append(self._zoom(function, values[best], q[best], spacing, ranges, payload))
            # next start: elsewhere
            values = np.where((abs(q - q[best]) <= 3 * spacing).all(axis=1), np.inf, values)
        return min(found, key=lambda pair: pair[0])

    def _zoom(self, function, value, best, spacing, ranges, payload):
        offsets = np.array(list(itertools.product(np.linspace(-1, 1, 5), repeat=len(best))))
        for _ in range(24):
            around = np.clip(best + offsets * spacing, ranges[:, 0], ranges[:, 1])
            edges = [self.onto_pitch_limits(around, payload, joint) for joint in range(len(best))]
            q = self._inside(np.concatenate([around, *edges]), ranges, payload)
            values = function(q)
            if values.min() < value:
                value, best = values.min(), q[values.argmin()]
            spacing = spacing * 0.55
        return value, best

    def worst(self, end_margin=0.02, points=(21, 21, 121), workspace_of=None):
        """(frequency [Hz], q, payload) of the lowest coupled frequency over the workspace and the
        payload cases.

        `points`: of the grid, one number per joint.

        The workspace is this machine's own, or that of `workspace_of`: a new design is judged on
        today's workspace.
        """
        machine = workspace_of or self
        found = []
        for payload in self.payloads:

            def lowest(q: np.ndarray, payload: str = payload) -> np.ndarray:
                return self.frequencies(q, payload)[:, 0]

            value, q = machine.smallest(lowest, end_margin, points, payload)
            found.append((float(value), q, payload))
        return min(found, key=lambda triple: triple[0])

    # ---- requirements
    # ---------------------------------------------------------------------------------------------

    def joint_scan(self, cylinder, ranges):
        """Lengths and moment arms of a cylinder over the whole range of its joint, and the
        poses.
        """
        index = self.cylinders.index(cylinder)
        q = self.along(self.joint_of[index], np.linspace(*ranges[self.joint_of[index]], 20001))
        return q, self.lengths(q)[:, index], self.moment_arms(q)[:, index, self.joint_of[index]]

    def digging_force(self, cylinder, ranges, at=None):
        """ISO 6015 force at the tool [N]: supply pressure on the bore, best angle of the driven
        joint.

        `at`: angles of the joints beyond the driven one. For the stick: the bucket where its own
        digging force is largest.
        """
        q, _, arm = self.joint_scan(cylinder, ranges)
        if at is not None:
            q = np.where(np.isnan(at), q, at)
        joint = self.joint_of[self.cylinders.index(cylinder)]
        force = self.supply_pressure * cylinder.bore_area * abs(arm) / self.tool_distance(q, joint)
        return force.max(), q[force.argmax(), joint]

    def digging(self, names, ranges):
        """{cylinder: (digging force [N], bore area × largest moment arm [m³])}, outermost joint
        first.
        """
        result, at = {}, np.full(len(self.joints), np.nan)
        for cylinder in sorted(
            self.cylinders, key=lambda c: -self.joint_of[self.cylinders.index(c)]
        ):
            if cylinder.name in names:
                force, angle = self.digging_force(cylinder, ranges, at)
                at[self.joint_of[self.cylinders.index(cylinder)]] = angle
                result[cylinder.name] = (
                    force,
                    cylinder.bore_area * abs(self.joint_scan(cylinder, ranges)[2]).max(),
                )
        return result

    def buckling_safety(self, cylinder):
        """Euler load of the rod, pinned at both ends of the open cylinder, over the largest thrust
        of one cylinder.
        """
        euler = (
            np.pi**2
            * STEEL
            * np.pi
            / 64
            * cylinder.rod**4
            / (cylinder.closed + cylinder.stroke) ** 2
        )
        return euler / (self.supply_pressure * np.pi / 4 * cylinder.bore**2)

    def holding_shares(self, original, end_margin, points):
        """{(direction, cylinder): largest static force / what supply against return pressure
        gives}, today's poses.
        """
        push = self.supply_pressure * self.bore_areas - self.return_pressure * self.annulus_areas
        pull = self.supply_pressure * self.annulus_areas - self.return_pressure * self.bore_areas
        shares = {}
        for i, cylinder in enumerate(self.cylinders):
            for direction, signed_capacity in (("push", push[i]), ("pull", -pull[i])):
                shares[direction, cylinder.name] = max(
                    -original.smallest(
                        lambda q, i=i, c=signed_capacity, p=p: -self.forces(q, p)[:, i] / c,
                        end_margin, points, p, starts=2,
                    )[0]
                    for p in self.payloads
                )  # fmt: skip
        return shares

    def requirements(self, original, points=(21, 21, 41)):
        """{name: (value, limit, satisfied)} of the default requirements 1…8, relative to
        `original`, today's machine.

        Shares are relative to today's, lengths [m], angles [deg]. Names end with the cylinder.
        """
        table, ranges, checks = original.requirement_table, original.ranges, {}

        def at_most(name, value, limit, slack=TOLERANCE):
            checks[name] = (
                float(value),
                float(limit),
                bool(value <= limit + slack * max(abs(limit), 1)),
            )

        def at_least(name, value, limit, slack=TOLERANCE):
            checks[name] = (
                float(value),
                float(limit),
                bool(value >= limit - slack * max(abs(limit), 1)),
            )

        today = {cylinder.name: cylinder for cylinder in original.cylinders}
        for cylinder in self.cylinders:
            name, old = cylinder.name, today[cylinder.name]
            q, length, arm = self.joint_scan(cylinder, ranges)
            short = max(
                cylinder.closed - length.min(), length.max() - cylinder.closed - cylinder.stroke
            )
            at_most(f"range {name}", short, 0.0, RANGE_TOLERANCE)
            at_least(
                f"dead_length {name}",
                cylinder.closed - cylinder.stroke,
                old.closed - old.stroke,
                RANGE_TOLERANCE,
            )
            for side in ("bore_area", "annulus_area"):
                swept = (
                    getattr(cylinder, side) * cylinder.stroke / (getattr(old, side) * old.stroke)
                )
                at_most(f"oil_each {side} {name}", swept, table["oil_each_share"])
            thrust = (
                self.supply_pressure
                * cylinder.bore_area
                / (original.supply_pressure * old.bore_area)
            )
            at_most(f"thrust {name}", thrust, table["thrust_share"])
            at_least(
                f"moment_arm {name}",
                _smallest_arm(arm) / _smallest_arm(original.joint_scan(old, ranges)[2]),
                table["moment_arm_share"],
            )
            if cylinder.four_bar:
                angle, old_angle = (
                    np.degrees(machine.transmission_angles(q, part).min())
                    for machine, part in ((self, cylinder), (original, old))
                )
                at_least(f"transmission {name}", angle, min(table["transmission_deg"], old_angle))
            at_least(
                f"buckling {name}", self.buckling_safety(cylinder), original.buckling_safety(old)
            )
            box = table.get("pin_box_mm", original.default_pin_box_mm()) / 1000
            at_most(
                f"pin_box {name}",
                max(abs(a - b) for a, b in zip(_pins(cylinder), _pins(old), strict=True)),
                box,
            )
        for side in ("bore_area", "annulus_area"):
            swept, before = (
                sum(getattr(c, side) * c.stroke for c in m.cylinders) for m in (self, original)
            )
            at_most(f"oil_total {side}", swept / before, table["oil_total_share"])
        for (direction, name), share in self.holding_shares(
            original, table["end_margin"], points
        ).items():
            at_most(f"holding {direction} {name}", share, table["holding_share"])
        if digging := table.get("digging"):
            now, before = (m.digging(digging["cylinders"], ranges) for m in (self, original))
            for name in digging["cylinders"]:
                at_least(f"digging {name}", now[name][0] / before[name][0], digging["share"])
                at_least(
                    f"digging_torque {name}", now[name][1] / before[name][1], digging["share"]
                )
        return checks

    def default_pin_box_mm(self):
        """2.5 % of the largest distance from the first joint to the tool over the joint ranges
        [mm].
        """
        axes = [np.linspace(*bounds, 41) for bounds in self.ranges]
        q = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
        return 25 * self.tool_distance(q, 0).max()


def _poses(q):
    return np.atleast_2d(np.asarray(q))


def _turned(x, z, angle, along, across):
    """The point `along`, `across` of a frame at x, z turned by `angle`, counter-clockwise with x
    right and z up.
    """
    cos, sin = np.cos(angle), np.sin(angle)
    return x + cos * along - sin * across, z + sin * along + cos * across


def _at(frames, point):
    return _turned(*frames[point.link], point.x, point.z)


def _smallest_arm(arm):
    return 0.0 if arm.min() < 0 < arm.max() else abs(arm).min()


def _pins(cylinder):
    pins = [cylinder.base, cylinder.rod_end]
    if cylinder.four_bar:
        pins += [cylinder.four_bar.pivot, cylinder.four_bar.lug]
    return [value for pin in pins if pin for value in (pin.x, pin.z)]


# ---- reading
# -------------------------------------------------------------------------------------------------


def _read_pin(table):
    x, _, z = table["at_mm"]
    return Pin(table["link"], x / 1000, z / 1000)


def _read_payload(name, table):
    mass = table.get("mass_kg", 0)
    pitch = table.get("pitch_deg")
    body = None
    if "link" in table:
        pin = _read_pin({"at_mm": (0, 0, 0)} | table)
        body = Body(pin.link, mass, pin.x, pin.z, 0.0)
    elif mass or pitch:
        raise ValueError(f"payload {name} needs a link")
    return Payload(name, body, None if pitch is None else tuple(np.radians(pitch)))


def _read_cylinder(name, table):
    bar = table.get("four_bar")
    odd = {
        key: table.get(key)
        for key in ("barrel_kg", "rod_kg", "compliance_m_per_N")
        if table.get(key)
    }
    odd |= {key: bar.get(key) for key in ("rocker_kg", "coupler_kg") if bar and bar.get(key)}
    if any(table.get("hose", {}).get(key) for key in ("cap_l", "annulus_l")):
        odd["hose"] = table["hose"]
    if odd:
        raise NotImplementedError(f"{name} cylinder: {odd}")
    dead = table.get("dead_volume_l", {})
    return Cylinder(
        name=name,
        count=table.get("count", 1),
        bore=table["bore_mm"] / 1000,
        rod=table["rod_mm"] / 1000,
        stroke=table["stroke_mm"] / 1000,
        closed=table["closed_length_mm"] / 1000,
        dead_cap=dead.get("cap", 0) / 1000,
        dead_annulus=dead.get("annulus", 0) / 1000,
        base=_read_pin(table["base"]),
        rod_end=None if bar else _read_pin(table["rod_end"]),
        four_bar=bar
        and FourBar(
            pivot=_read_pin(bar["pivot"]),
            lug=_read_pin(bar["lug"]),
            rocker=bar["rocker_mm"] / 1000,
            coupler=bar["coupler_mm"] / 1000,
            side={"left": 1, "right": -1}[bar["knee"]],
        ),
    )


def _read_urdf(text, joints, frozen):
    """Links by name, bodies, and the limits of `joints`, from a URDF whose moving joints turn
    about −y.
    """
    root = ElementTree.fromstring(text)
    links, limits = {}, [None] * len(joints)
    for joint in root.iter("joint"):
        if joint.find("parent") is None:  # e.g. inside a <transmission>
            continue
        name, kind = joint.get("name"), joint.get("type")
        x, z, angle = _planar_origin(joint)
        planar = kind in ("revolute", "continuous") and _vector(
            joint.find("axis"), "xyz", "1 0 0"
        ) == [0, -1, 0]
        if name in joints:
            if not planar:
                raise NotImplementedError(f"joint {name} does not turn about -y")
            limit = joint.find("limit")
            low, high = (
                (-np.pi, np.pi)
                if kind == "continuous"
                else (limit.get("lower"), limit.get("upper"))
            )
            limits[joints.index(name)] = float(low), float(high)
        elif kind != "fixed":
            value = frozen[name]
            if planar:
                angle += value
            elif value:
                raise NotImplementedError(f"joint {name} frozen at {value}: out of the plane")
        moving = joints.index(name) if name in joints else None
        links[joint.find("child").get("link")] = Frame(
            joint.find("parent").get("link"), x, z, angle, moving
        )
    bodies = []
    for link in root.findall("link"):
        if (inertial := link.find("inertial")) is not None:
            x, z, _ = _planar_origin(inertial)
            mass, inertia = (
                float(inertial.find("mass").get("value")),
                float(inertial.find("inertia").get("iyy")),
            )
            bodies.append(Body(link.get("name"), mass, x, z, inertia))
    return links, bodies, limits


def _planar_origin(element):
    """x, z and the counter-clockwise turn in the plane (minus the URDF's pitch, which is about
    +y).
    """
    origin = element.find("origin")
    x, _, z = _vector(origin, "xyz", "0 0 0")
    roll, pitch, yaw = _vector(origin, "rpy", "0 0 0")
    if roll or yaw:
        raise NotImplementedError("frames turned out of the plane")
    return x, z, -pitch


def _vector(element, key, default):
    return [
        float(value)
        for value in (default if element is None else element.get(key, default)).split()
    ]
