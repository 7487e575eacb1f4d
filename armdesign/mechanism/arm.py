"""The arm: rigid links and joints of a URDF. The only door to Pinocchio.

The URDF has been reduced to the joints that are coordinates (``urdf.py``), so nq = nv = n.
Pinocchio says what each joint moves; placements, inertia and gravity (``composite_bodies``) are
batched numpy (axis 0 = pose).

The world is the frame of the URDF's root link: z up, gravity along −z.
"""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement as pairs
from typing import Any

import numpy as np

from armdesign.arrays import Array, read_only, stacked
from armdesign.errors import MachineFileError
from armdesign.mechanism.composite_bodies import Bodies, inertia_and_gravity, model_indices
from armdesign.mechanism.jets import VectorJet, cross
from armdesign.mechanism.parallel_joints import turning_alike
from armdesign.mechanism.rigid_poses import RigidPoses
from armdesign.mechanism.slews import Slews, slews_of
from armdesign.mechanism.spring import Spring
from armdesign.mechanism.urdf import read_urdf, rotated, turned, turning
from armdesign.threads import in_threads, thread_chunks
from armdesign.transaction import undisturbed


class Arm:
    """The moving links of a URDF.

    Args:
        urdf: text of the URDF.
        joints: coordinates, in the order of q.
        frozen: value of other joints [rad or m]; 0 where none is given.
        source: file name for messages.
        springs: passive joints, coordinates after the others.
        of_links: whether the URDF stands for ``[links]``, whose faults have been looked for.
        tool: link of the tool, on the way to which are the slews; default: what the last of the
            joints moves.

    Attributes:
        joints: joints of poses, in the order of q (nq).
        coordinates: all joints that move: joints of poses, then springs (k).

    Raises:
        MachineFileError: XML, link, joint or inertia that cannot be used.
    """

    def __init__(
        self,
        urdf: str,
        joints: Sequence[str],
        frozen: Mapping[str, float],
        source: str,
        springs: Sequence[Spring] = (),
        of_links: bool = False,
        tool: str = "",
    ) -> None:
        self.source, self.of_links, self.tool = source, of_links, tool
        read = read_urdf(urdf, joints, frozen, source, springs, checked=of_links)
        self.xml, self.coordinates, self.links = read
        self.joints = self.coordinates[: len(joints)]
        self._standing = np.array([spring.at for spring in springs])
        self._paths: dict[tuple[str, str], tuple[tuple[int, int], ...]] = {}

    @property
    def names(self) -> tuple[str, ...]:
        """Joint names in the order of q."""
        return tuple(joint.name for joint in self.joints)

    @cached_property
    def all_joints(self) -> list[str]:
        """Names of all joints of the URDF, fixed and frozen ones too."""
        return [str(joint.get("name")) for joint in ET.fromstring(self.xml).findall("joint")]

    @cached_property
    def movable_joints(self) -> list[str]:
        """Names of the joints that are coordinates or could be."""
        frozen = dict.fromkeys(one.name for link in self.links.values() for one in link.frozen)
        return [*(joint.name for joint in self.coordinates), *frozen]

    def moves_like(self, other: Arm) -> bool:
        """Whether another arm has the same links, coordinates, and springs that rest alike."""
        if other is self:
            return True
        names = [[joint.name for joint in arm.coordinates] for arm in (self, other)]
        alike = self.xml == other.xml and names[0] == names[1]
        return alike and np.array_equal(self._standing, other._standing)

    def carried(self, coordinate: int) -> str:
        """Name of the link that a coordinate's joint carries."""
        return next(link.name for link in self.links.values() if link.joint == coordinate)

    def frozen_between(self, links: Iterable[str]) -> set[str]:
        """Names of the joints between some links that could move but do not."""
        frozen = [{one.name for one in self.links[link].frozen} for link in links]
        return frozen[0].union(*frozen) - frozen[0].intersection(*frozen)

    @cached_property
    @read_only
    def limits(self) -> Array:
        """URDF limits (nq, 2) [rad, m]; a continuous joint has one turn."""
        return np.array([[joint.lower, joint.upper] for joint in self.joints])

    def within(self, joint: int, lower: float, upper: float) -> Arm:
        """The same arm with other limits [rad, m] of one joint, to try them."""
        twin, limits = copy.copy(self), self.limits.copy()
        limits[joint] = lower, upper
        twin.limits = limits
        return twin

    @cached_property
    def _chains(self) -> list[tuple[int, ...]]:
        """For each joint, the joints from the root to it."""
        chains: list[tuple[int, ...]] = [()] * len(self.coordinates)
        for index in self.outwards:
            parent = self.coordinates[index].parent
            chains[index] = (*(chains[parent] if parent >= 0 else ()), index)
        return chains

    @cached_property
    def outwards(self) -> list[int]:
        """Coordinates from the root outwards: each comes after its parent."""
        order, parents = list[int](), [joint.parent for joint in self.coordinates]
        while len(order) < len(parents):
            known = {-1, *order}
            order += [k for k, parent in enumerate(parents) if k not in known and parent in known]
        return order

    def chain(self, link: str) -> tuple[int, ...]:
        """Coordinates from the root to a link, root first."""
        joint = self.links[link].joint
        return self._chains[joint] if joint >= 0 else ()

    @cached_property
    def slews(self) -> Slews:
        """Joints that turn all that moves the tool about an upright axis."""
        zero = self.zero
        frames = zero.rotation[0], zero.translation[0], zero.axis[0]
        springs = range(len(self.joints), len(self.coordinates))
        chain = self.chain(self.tool or self.carried(len(self.joints) - 1))
        return slews_of(self.coordinates, chain, frames, [*self.links.values()], springs)

    @property
    def slewing(self) -> dict[int, float]:
        """Joints that turn the arm about the vertical, +1 if up else −1: M and g ignore them."""
        return self.slews.vertical

    def without_effect(self, spanned: Collection[int]) -> frozenset[int]:
        """Joints of q whose position changes no frequency, with ``spanned`` ones between pins.

        They slew the whole arm, and no cylinder spans them: a cylinder across a joint changes
        length and moment arm with it. Slewing that carries an axis beside its own changes the
        inertia that the lower axis feels.
        """
        slewing = list(self.slewing)
        feet = np.array([self.slews.places[j][:2] for j in slewing])
        return frozenset(
            j
            for k, j in enumerate(slewing)
            if j < len(self.joints)
            and j not in spanned
            and np.all(np.hypot(*(feet[:k] - feet[k]).T) < 1e-9)
        )

    def path(self, start: str, end: str) -> tuple[tuple[int, int], ...]:
        """Joints on the way from one link to another, with their sign as seen from ``start``."""
        if (start, end) not in self._paths:
            up, down = self.chain(start), self.chain(end)
            pairs = enumerate(zip(up, down, strict=False))
            shorter = min(len(up), len(down))
            common = next((i for i, (a, b) in pairs if a != b), shorter)
            back = tuple((j, -1) for j in reversed(up[common:]))
            self._paths[start, end] = back + tuple((j, 1) for j in down[common:])
        return self._paths[start, end]

    # ---------------------------------------------------------------------------------- placements

    def with_springs(self, q: Array) -> Array:
        """All coordinates (n, k) at joint positions (n, nq): springs stand where they rest.

        Coordinates that are complete already stay as they are.
        """
        missing = len(self.coordinates) - q.shape[1]
        standing = np.broadcast_to(self._standing[:missing], (len(q), missing))
        return np.concatenate([q, standing], axis=1) if missing else q

    def placements(self, q: Array) -> tuple[Array, Array, Array]:
        """Joint frames in the world at q (n, nq): rotation, translation and axis (n, k, …)."""
        q = self.with_springs(q)
        n, k = q.shape
        # each joint's in one piece of memory
        rotation, translation = np.empty((k, n, 3, 3), q.dtype), np.empty((k, n, 3), q.dtype)
        axis = np.empty((k, n, 3), q.dtype)
        for index in self.outwards:
            joint = self.coordinates[index]
            if index in self._alike:
                signs, parts = self._alike[index]
                rotation[index] = rotated(parts, (q * signs).sum(axis=1))
            elif joint.parent < 0:
                rotation[index] = joint.turned_by(q[:, index])
            else:
                local = joint.turned_by(q[:, index])
                np.matmul(rotation[joint.parent], local, out=rotation[index])
            translation[index] = joint.translation
            if joint.parent >= 0:
                foot = turned(rotation[joint.parent], joint.translation)
                np.add(translation[joint.parent], foot, out=translation[index])
            axis[index] = turned(rotation[index], joint.axis)
            if not joint.revolute:
                translation[index] += q[:, index, None] * axis[index]
        return rotation.swapaxes(0, 1), translation.swapaxes(0, 1), axis.swapaxes(0, 1)

    @cached_property
    def _alike(self) -> dict[int, tuple[Array, Array]]:
        """What turns the coordinates that all before them turn about one direction."""
        return turning_alike(self.coordinates, self._chains)

    def kinematics(self, q: Array) -> RigidPoses:
        """Placements at q (n, nq), with zeros for inertia and gravity: geometry alone."""
        n, k = len(q), len(self.coordinates)
        square = np.zeros((n, k, k))
        return RigidPoses(q, square, np.zeros((n, k)), square, *self.placements(q))

    def placed_alone(self, joint: int, values: Array) -> RigidPoses:
        """Placements of a coordinate at values (n,) [rad, m] and of the one that carries it.

        Those that carry both are at zero; placements of others are not filled in.
        """
        n, k, one = len(values), len(self.coordinates), self.coordinates[joint]
        rotation, translation, axis = (
            np.broadcast_to(rest, (n, *rest.shape[1:]))
            for rest in (self.zero.rotation, self.zero.translation, self.zero.axis)
        )
        if one.revolute:
            of_joints = np.empty((k, n, 3, 3), values.dtype)
            if one.parent >= 0:
                of_joints[one.parent] = rotation[:, one.parent]
            of_joints[joint] = rotated(self._turned_alone[joint], values)
            rotation = of_joints.swapaxes(0, 1)
        else:
            translation = translation.astype(values.dtype)
            translation[:, joint] += values[:, None] * axis[:, joint]
        q = np.zeros((n, len(self.joints)), values.dtype)
        q[:, joint] = values
        square = np.broadcast_to(0.0, (n, k, k))
        return RigidPoses(q, square, square[:, 0], square, rotation, translation, axis)

    @cached_property
    def zero(self) -> RigidPoses:
        """Placements where all joints are at 0, one pose."""
        return self.kinematics(np.zeros((1, len(self.joints))))

    @cached_property
    def _turned_alone(self) -> list[Array]:
        """What turns each coordinate (3, 9) where those before it are at zero."""
        return [
            turning(joint.axis, rotation)
            for joint, rotation in zip(self.coordinates, self.zero.rotation[0], strict=True)
        ]

    def link_rotation(self, poses: RigidPoses, link: str) -> Array:
        """Orientation of a link frame in the world (n, 3, 3)."""
        body = self.links[link]
        if body.joint < 0:
            return np.broadcast_to(body.rotation, (len(poses), 3, 3))
        rotation = poses.rotation[:, body.joint]
        return np.asarray(rotation.reshape(-1, 3) @ body.rotation).reshape(-1, 3, 3)

    def point(self, poses: RigidPoses, link: str, at: Array) -> Array:
        """World position (n, 3) [m] of a point given in a link's frame: (3,), or by row (n, 3)."""
        body = self.links[link]
        local = body.translation + at @ body.rotation.T
        if body.joint < 0:
            return np.broadcast_to(local, (len(poses), 3))
        return poses.translation[:, body.joint] + turned(poses.rotation[:, body.joint], local)

    def in_link(self, poses: RigidPoses, link: str, places: Array) -> Array:
        """Points in the world (n, 3) as places in a link's frame (n, 3) [m], at n poses or one."""
        rotation, lever = self.link_rotation(poses, link), self.point(poses, link, np.zeros(3))
        return turned(np.swapaxes(rotation, 1, 2), places - lever)

    def motion(
        self, poses: RigidPoses, link: str, at: Array, seen_from: str, joints: tuple[int, ...]
    ) -> VectorJet:
        """A point of ``link`` seen from another link, with two derivatives by ``joints``.

        A revolute joint on the way turns all that lies beyond it about its axis, a prismatic one
        shifts it; of two joints the nearer to the observer acts last: ∂²P/∂q_j∂q_k = ω_j ×
        ∂P/∂q_k.
        """
        point, path = self.point(poses, link, at), self.path(seen_from, link)
        return self._seen(poses, point, True, path, joints)

    def direction(
        self, poses: RigidPoses, link: str, local: Array, seen_from: str, joints: tuple[int, ...]
    ) -> VectorJet:
        """A direction fixed in a link, seen from another link, with two derivatives by ``joints``.

        So moves a point of the link when its place in the link changes.
        """
        vector = np.asarray(self.link_rotation(poses, link) @ local)
        return self._seen(poses, vector, False, self.path(seen_from, link), joints)

    def _seen(
        self,
        poses: RigidPoses,
        vector: Array,
        bound: bool,
        path: tuple[tuple[int, int], ...],
        joints: tuple[int, ...],
    ) -> VectorJet:
        """A point (``bound``) or a direction, with derivatives by joints on a path."""
        vector = np.asfortranarray(vector)
        first = np.zeros((len(vector), len(joints), 3), vector.dtype, order="F")
        turns = [joint.revolute for joint in self.coordinates]
        axes = {j: s * poses.axis[:, j] for j, s in path if j in joints and (bound or turns[j])}
        for j, axis in axes.items():
            lever = vector - poses.translation[:, j] if bound else vector
            first[:, joints.index(j)] = cross(axis, lever) if turns[j] else axis

        def second() -> Array:
            both = np.zeros((*first.shape[:2], *first.shape[1:]), vector.dtype, order="F")
            for j, further in pairs(axes, 2):
                a, b = map(joints.index, (j, further))
                both[:, a, b] = both[:, b, a] = cross(axes[j], first[:, b]) if turns[j] else 0.0
            return both

        return VectorJet(vector, first, second)

    # ------------------------------------------------------------------------------ rigid bodies

    @property
    def model_order(self) -> Array:
        """Index of each coordinate in Pinocchio's model (k,)."""
        at = model_indices(self._model, self.coordinates)
        return np.array([self._model.joints[index].idx_v for index in at])

    @cached_property
    def _model(self) -> Any:
        """Pinocchio's model."""
        with undisturbed():
            import pinocchio

        try:
            return pinocchio.buildModelFromXML(self.xml)
        except ValueError as error:
            fault = f"Pinocchio refuses it ({error})"
            raise MachineFileError(self.source, fault, "check it with check_urdf") from None

    @cached_property
    def _bodies(self) -> Bodies:
        """What each joint moves before the next."""
        return Bodies.of(self._model, self.coordinates)

    def load(self) -> None:
        """Load Pinocchio and its model before threads ask: there Ctrl-C might disturb it."""
        _ = self._bodies

    def rigid_poses(self, q: Array) -> RigidPoses:
        """Inertia, gravity, its derivative and placements of the bare links at q (n, nq)."""
        self.load()
        parts = in_threads(
            lambda rows: self._rigid_poses(q[rows]), thread_chunks(len(q), len(self.coordinates))
        )
        return stacked(parts, len(q))

    def _rigid_poses(self, q: Array) -> RigidPoses:
        placements = self.placements(q)
        terms = inertia_and_gravity(self._bodies, self.coordinates, self._chains, placements)
        return RigidPoses(q, *terms, *placements)

    def bodies(self, poses: RigidPoses) -> tuple[Array, Array]:
        """Mass (k,) [kg] that each joint moves before the next, and its centre (n, k, 3) [m]."""
        lever = self._bodies.centre[:, :, None]
        return self._bodies.mass, poses.translation + (poses.rotation @ lever)[..., 0]

    @cached_property
    def bodies_apart(self) -> list[Arm]:
        """The arm with the mass of what one coordinate moves before the next, for each (k).

        M, g and ∂g/∂q are linear in masses and inertias: the arm's are their sums.
        """
        arms = []
        for joint in range(len(self.coordinates)):
            twin = copy.copy(self)
            twin._bodies = self._bodies.alone(joint)
            arms.append(twin)
        return arms

    @property
    def root(self) -> str:
        """Name of the root link: the world."""
        return next(iter(self.links))


@dataclass(frozen=True, eq=False)
class LoadedArm:
    """An arm, point masses [kg] fixed to links at (3,) [m], and point masses for its bars."""

    arm: Arm
    fixed: Sequence[tuple[float, str, Array]]
    points: Callable[[RigidPoses], list[tuple[float, VectorJet]]] | None

    def model(self) -> Any:
        """Pinocchio's model of the links with what is fixed to them; the bars are not in it."""
        import pinocchio

        model = pinocchio.Model(self.arm._model)
        indices = model_indices(model, self.arm.coordinates)
        for mass, link, at in self.fixed:
            body = self.arm.links[link]
            if body.joint >= 0 and mass > 0:
                lever = body.translation + body.rotation @ at
                inertia = pinocchio.Inertia(mass, lever, np.zeros((3, 3)))
                model.appendBodyToJoint(indices[body.joint], inertia, pinocchio.SE3.Identity())
        return model
