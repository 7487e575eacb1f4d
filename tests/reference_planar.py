"""An independent planar reference for `armdesign`: the same physics by other methods, in plain
numpy and scipy.

It reads the machine file (TOML and URDF) itself and imports nothing of `armdesign`. Where
production code uses formulas, this file differentiates the definition:

- inertia from the Jacobians of the links' centres of mass, in the plane;
- gravity torque by complex step of the potential energy;
- moment arm by complex step of the pin-to-pin length;
- stiffness by eighth-order central differences of the net static torque with the oil trapped, so
  that neither the oil stiffness β (A1²/V1 + A2²/V2) nor the geometric stiffness ∂g/∂q − Σ F0 H is
  ever written down.

Scope: a serial chain of revolute joints about −y (x right, z up, positive counter-clockwise), one
cylinder per joint, pin to pin or through a four-bar; other joints frozen, at 0 unless their axis
is −y too; constant bulk modulus, massless cylinders. Anything else in the file raises
`NotImplementedError`. Arrays have the pose on axis 0, then the cylinder or joint. SI inside.
"""

import itertools

import numpy as np

from tests.planar_arm import PlanarArm

STEEL = 210e9  # Young's modulus of the rods [Pa]; cancels in the ratio of two machines
TOLERANCE = 1e-6  # relative, for "satisfied"
RANGE_TOLERANCE = 20e-6  # [m], the rounding of lengths in a machine file


class Checks(dict):
    """{name: (value, limit, satisfied)} of requirements, within a tolerance of their limits."""

    def at_most(self, name, value, limit, slack=TOLERANCE):
        satisfied = value <= limit + slack * max(abs(limit), 1)
        self[name] = (float(value), float(limit), bool(satisfied))

    def at_least(self, name, value, limit, slack=TOLERANCE):
        satisfied = value >= limit - slack * max(abs(limit), 1)
        self[name] = (float(value), float(limit), bool(satisfied))


class Reference(PlanarArm):
    """One machine: its worst frequencies, and its requirements against an original machine."""

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
        lowest = []
        for _ in range(starts):
            if not np.isfinite(values).any():
                break
            best = np.nanargmin(values)
            lowest.append(self._zoom(function, values[best], q[best], spacing, ranges, payload))
            # next start: elsewhere
            values = np.where((abs(q - q[best]) <= 3 * spacing).all(axis=1), np.inf, values)
        return min(lowest, key=lambda pair: pair[0])

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

        The workspace is this machine's own, or `workspace_of`'s: a new design is judged on
        today's workspace.
        """
        machine = workspace_of or self
        lowest_of_cases = []
        for payload in self.payloads:

            def lowest(q: np.ndarray, payload: str = payload) -> np.ndarray:
                return self.frequencies(q, payload)[:, 0]

            value, q = machine.smallest(lowest, end_margin, points, payload)
            lowest_of_cases.append((float(value), q, payload))
        return min(lowest_of_cases, key=lambda triple: triple[0])

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
        table, ranges, checks = original.requirement_table, original.ranges, Checks()
        for cylinder in self.cylinders:
            self._sizes_and_buckling(checks, original, cylinder)
            self._linkage(checks, original, cylinder)
        for side in ("bore_area", "annulus_area"):
            swept, before = (
                sum(getattr(c, side) * c.stroke for c in m.cylinders) for m in (self, original)
            )
            checks.at_most(f"oil_total {side}", swept / before, table["oil_total_share"])
        shares = self.holding_shares(original, table["end_margin"], points)
        for (direction, name), share in shares.items():
            checks.at_most(f"holding {direction} {name}", share, table["holding_share"])
        if digging := table.get("digging"):
            now, before = (m.digging(digging["cylinders"], ranges) for m in (self, original))
            for name in digging["cylinders"]:
                force, torque = (now[name][k] / before[name][k] for k in range(2))
                checks.at_least(f"digging {name}", force, digging["share"])
                checks.at_least(f"digging_torque {name}", torque, digging["share"])
        return checks

    def _sizes_and_buckling(self, checks, original, cylinder):
        """Of one cylinder: its dead length, oil of both sides, thrust and safety from buckling."""
        name, table = cylinder.name, original.requirement_table
        old = next(c for c in original.cylinders if c.name == name)
        dead, dead_today = (c.closed - c.stroke for c in (cylinder, old))
        checks.at_least(f"dead_length {name}", dead, dead_today, RANGE_TOLERANCE)
        for side in ("bore_area", "annulus_area"):
            swept, swept_today = (getattr(c, side) * c.stroke for c in (cylinder, old))
            checks.at_most(f"oil_each {side} {name}", swept / swept_today, table["oil_each_share"])
        thrust = self.supply_pressure * cylinder.bore_area
        thrust_today = original.supply_pressure * old.bore_area
        checks.at_most(f"thrust {name}", thrust / thrust_today, table["thrust_share"])
        safety, safety_today = self.buckling_safety(cylinder), original.buckling_safety(old)
        checks.at_least(f"buckling {name}", safety, safety_today)

    def _linkage(self, checks, original, cylinder):
        """Of one cylinder: lengths within its stroke, moment arms, four-bar and pins."""
        name, table, ranges = cylinder.name, original.requirement_table, original.ranges
        old = next(c for c in original.cylinders if c.name == name)
        q, length, arm = self.joint_scan(cylinder, ranges)
        beyond = length.max() - cylinder.closed - cylinder.stroke
        checks.at_most(
            f"range {name}", max(cylinder.closed - length.min(), beyond), 0.0, RANGE_TOLERANCE
        )
        arm_share = _smallest_arm(arm) / _smallest_arm(original.joint_scan(old, ranges)[2])
        checks.at_least(f"moment_arm {name}", arm_share, table["moment_arm_share"])
        if cylinder.four_bar:
            angle, old_angle = (
                np.degrees(machine.transmission_angles(q, part).min())
                for machine, part in ((self, cylinder), (original, old))
            )
            least = min(table["transmission_deg"], old_angle)
            checks.at_least(f"transmission {name}", angle, least)
        box = table.get("pin_box_mm", original.default_pin_box_mm()) / 1000
        moved = max(abs(a - b) for a, b in zip(_pins(cylinder), _pins(old), strict=True))
        checks.at_most(f"pin_box {name}", moved, box)

    def default_pin_box_mm(self):
        """2.5 % of the largest distance from the first joint to the tool over the joint ranges
        [mm].
        """
        axes = [np.linspace(*bounds, 41) for bounds in self.ranges]
        q = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
        return 25 * self.tool_distance(q, 0).max()


def _smallest_arm(arm):
    return 0.0 if arm.min() < 0 < arm.max() else abs(arm).min()


def _pins(cylinder):
    pins = [cylinder.base, cylinder.rod_end]
    if cylinder.four_bar:
        pins += [cylinder.four_bar.pivot, cylinder.four_bar.lug]
    return [value for pin in pins if pin for value in (pin.x, pin.z)]
