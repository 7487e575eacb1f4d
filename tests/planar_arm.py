"""A planar arm by definitions that are differentiated: see `reference_planar`."""

import itertools
import tomllib
from pathlib import Path

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import brentq

from tests.planar_file import DEFAULTS, read_cylinder, read_payload, read_pin, read_urdf

GRAVITY = 9.81  # [m/s²], as in pinocchio and in the paper's M_eq = F/9.81
COMPLEX_STEP = 1e-30
# Central difference of order 8: coefficients of f(q + k h) − f(q − k h), k = 1…4; with 4 mrad
# truncation and rounding are both about 1e-11.
DIFFERENCE = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
DIFFERENCE_STEP = 4e-3  # [rad]
NEWTON_STEPS = 6  # for the force on oil behind what yields: quadratic, few are enough
PITCH_TOLERANCE = 1e-9  # [rad], so that a pose exactly on the limit of the pitch counts


class PlanarArm:
    """Geometry, inertia, stiffness and joint ranges of a machine, as its file describes it."""

    def __init__(self, data, urdf):
        self.name = data["name"]
        self.joints = list(data["joints"])
        self.links, self.bodies, self.limits = read_urdf(urdf, self.joints, data.get("frozen", {}))
        self.cylinders = [read_cylinder(name, table) for name, table in data["cylinder"].items()]
        self.cases = {
            name: read_payload(name, table)
            for name, table in data.get("payload", {"empty": {}}).items()
        }
        self.tool = read_pin(data["tool"])
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
                    body = self.links[link]
                    x, z, angle = place(body.parent)
                    turn = body.angle + (0 if body.joint is None else q[:, body.joint])
                    frames[link] = *turned(x, z, angle, body.x, body.z), angle + turn
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
            body = self.links[link]
            if body.joint is not None:
                chain.append((body.joint, link))
            link = body.parent
        return chain

    def lengths(self, q):
        """Pin-to-pin length of every cylinder (n, nc) [m]; nan where a four-bar does not close."""
        q = poses(q)
        frames = self.frames(q)
        lengths = []
        for cylinder in self.cylinders:
            x, z = self._rod_end(frames, cylinder)
            base_x, base_z = at(frames, cylinder.base)
            lengths.append(np.sqrt((x - base_x) ** 2 + (z - base_z) ** 2))
        return np.stack(lengths, axis=1)

    def _rod_end(self, frames, cylinder):
        if cylinder.four_bar is None:
            return at(frames, cylinder.rod_end)
        bar = cylinder.four_bar
        pivot_x, pivot_z = at(frames, bar.pivot)
        lug_x, lug_z = at(frames, bar.lug)
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
        frames = self.frames(poses(q))
        knee, bar = self._rod_end(frames, cylinder), cylinder.four_bar
        (ax, az), (bx, bz) = (np.subtract(at(frames, pin), knee) for pin in (bar.pivot, bar.lug))
        return np.arcsin(np.clip(abs(ax * bz - az * bx) / (bar.rocker * bar.coupler), 0, 1))

    def moment_arms(self, q):
        """∂ℓ/∂q (n, nc, nq) [m/rad], by complex step."""
        return np.stack(
            [self._complex_step(self.lengths, q, joint) for joint in range(len(self.joints))],
            axis=2,
        )

    def _complex_step(self, function, q, joint):
        stepped = poses(q).astype(complex)
        stepped[:, joint] += 1j * COMPLEX_STEP
        return function(stepped).imag / COMPLEX_STEP

    def pitch(self, q, link):
        """Angle of the link's x axis, up from forward (n,) [rad], not wrapped."""
        return self.frames(poses(q))[link][2]

    def tool_distance(self, q, joint):
        """Distance of the tool from the axis of a joint (n,) [m]."""
        frames = self.frames(poses(q))
        link = next(link for index, link in self.joint_chain(self.tool.link) if index == joint)
        x, z = at(frames, self.tool)
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
        q = poses(q)
        frames = self.frames(q)
        mass_matrix = np.zeros((len(q), len(self.joints), len(self.joints)))
        for body in self.bodies_with(payload):
            x, z = at(frames, body)
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
        return sum(body.mass * GRAVITY * at(frames, body)[1] for body in self.bodies_with(payload))

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

    def volumes(self, lengths, force):
        """Chamber volumes (cap, annulus), (n, nc) [m³].

        What lies in series gives way under the force, so that the piston stands further out.
        """
        compliance = np.array([c.compliance for c in self.cylinders])
        closed, stroke, dead_cap, dead_annulus = np.array(
            [(c.closed, c.stroke, c.dead_cap, c.dead_annulus) for c in self.cylinders]
        ).T
        extension = lengths - closed + compliance * force
        return (
            self.bore_areas * extension + dead_cap,
            self.annulus_areas * (stroke - extension) + dead_annulus,
        )

    def stiffness_matrix(self, q, payload):
        """−∂/∂q of the net torque Rᵀ F − g with the oil trapped at q (n, nq, nq) [N m/rad].

        In a closed chamber dp = −β dV/V, hence p = p0 + β ln(V0/V), and F = F0 + β (A1 ln(V10/V1)
        − A2 ln(V20/V2)), with volumes that depend on F where something yields in series.
        """
        q = poses(q)
        force = self.forces(q, payload)
        trapped = self.volumes(self.lengths(q), force)

        def net_torque(moved):
            now = self._force_on_trapped_oil(self.lengths(moved), force, trapped)
            pushed = np.einsum("nij,ni->nj", self.moment_arms(moved), now)
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

    def _force_on_trapped_oil(self, lengths, before, trapped):
        """Force (n, nc) [N] at other lengths, from that before and the volumes trapped then.

        By Newton's rule, which ends after one step where nothing yields in series.
        """
        force, (cap, annulus) = before, trapped
        for _ in range(NEWTON_STEPS):
            cap_now, annulus_now = self.volumes(lengths, force)
            rise = self.bore_areas * np.log(cap / cap_now) - self.annulus_areas * np.log(
                annulus / annulus_now
            )
            oil = self.bore_areas**2 / cap_now + self.annulus_areas**2 / annulus_now
            compliance = np.array([c.compliance for c in self.cylinders])
            slope = 1 + self.bulk_modulus * oil * compliance
            force = force - (force - before - self.bulk_modulus * rise) / slope
        return force

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
        q, case = poses(q), self.cases[payload]
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


def poses(q):
    return np.atleast_2d(np.asarray(q))


def turned(x, z, angle, along, across):
    """The point `along`, `across` of a frame at x, z turned by `angle`, counter-clockwise with x
    right and z up.
    """
    cos, sin = np.cos(angle), np.sin(angle)
    return x + cos * along - sin * across, z + sin * along + cos * across


def at(frames, point):
    return turned(*frames[point.link], point.x, point.z)
