"""The machine: an arm, its cylinders, oil, supply and load cases, as one immutable value.

A machine is made from its file's text and knows it: ``replace`` edits the text at key paths and
reads it again, ``save`` writes it. So whatever a machine answers, its file answers too.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from armdesign import transaction
from armdesign.arrays import Array, Flags, chunks, shown, stacked
from armdesign.errors import ArmDesignError, MachineFileError, PoseError, choose
from armdesign.hydraulics.actuator import Actuator, Cylinder, Motor
from armdesign.hydraulics.fluid import Fluid
from armdesign.hydraulics.supply import Supply
from armdesign.machine import from_urdf as foreign
from armdesign.machine import machine_file, parts, saving
from armdesign.machine.key_lines import Places, lines_of
from armdesign.machine.parts import Payload
from armdesign.machine.poses import Poses, is_singular, static_forces
from armdesign.machine.range_causes import Cause, cause_of
from armdesign.machine.schema import MachineSection
from armdesign.machine.schema import schema as schema_text
from armdesign.mechanism.arm import Arm, LoadedArm, RigidPoses, of_points, points_of_bar
from armdesign.mechanism.jets import VectorJet
from armdesign.mechanism.joint_ranges import joint_ranges
from armdesign.mechanism.linkage.base import Drive, Linkage, Pin
from armdesign.mechanism.linkage.gear import Gear
from armdesign.mechanism.urdf_faults import line_of, parse

STROKE_TOLERANCE = 1e-6  # [m] a pose this far beyond an end stop still counts as on it
PITCH_TOLERANCE = 1e-8  # [rad] a link tipped this far beyond its pitch limit still counts as on it


@dataclass(frozen=True, eq=False, kw_only=True)
class Machine:
    """A hydraulic boom machine.

    Attributes:
        name: short name, also of files written about it.
        arm: rigid links and joints.
        cylinders: those that move a joint, in the order of the file.
        linkages: the pins of each cylinder, same order.
        motors: those whose joint is a coordinate, in the order of the file.
        payloads: all load cases, in the order of the file.
        payload: the load case at work.
        fluid: the oil.
        supply: the pump.
        tool: the point whose position is reported.
        section: the machine file as read.
        text: its text.
        urdf_text: text of its URDF.
        source: where it came from, for messages.
    """

    name: str
    arm: Arm
    cylinders: tuple[Cylinder, ...]
    linkages: tuple[Linkage, ...]
    motors: tuple[Motor, ...]
    payloads: tuple[Payload, ...]
    payload: Payload
    fluid: Fluid
    supply: Supply
    tool: Pin
    section: MachineSection
    text: str
    urdf_text: str
    source: Path

    @classmethod
    def from_text(cls, text: str, urdf_text: str, source: Path, arm: Arm | None = None) -> Machine:
        """The machine that a machine file's and a URDF's text describe.

        Args:
            text: TOML.
            urdf_text: URDF.
            source: path of the machine file, for messages and the URDF's place.
            arm: the arm if it has been read already.

        Raises:
            MachineFileError: anything in them that no machine can have.
        """
        with lines_of(text, source.name):
            machine = cls.unchecked(text, urdf_text, source, arm)
            for fault in faults_of(machine):
                raise fault
        return machine

    @classmethod
    def unchecked(cls, text: str, urdf_text: str, source: Path, arm: Arm | None = None) -> Machine:
        """As ``from_text``, but without looking at ranges and linkages: see ``faults_of``."""
        section = machine_file.parse(text, source.name)
        arm = arm or Arm(urdf_text, section.joints, section.frozen, section.urdf)
        return _assemble(section, arm, text=text, urdf_text=urdf_text, source=source)

    @classmethod
    def from_urdf(
        cls,
        urdf: str | Path,
        cylinders: Mapping[str, Any],
        *,
        name: str | None = None,
        joints: Iterable[str] | None = None,
        frozen: Mapping[str, float] | None = None,
        payloads: Mapping[str, Any] | None = None,
        tool: Mapping[str, Any] | None = None,
        fluid: Mapping[str, Any] | None = None,
        supply: Mapping[str, Any] | None = None,
        requirements: Mapping[str, Any] | None = None,
        motors: Mapping[str, Any] | None = None,
    ) -> Machine:
        """A machine from a URDF that already exists.

        Tables are written as in a machine file, in its units.

        Args:
            urdf: path or text.
            cylinders: tables by name: bore_mm, rod_mm, stroke_mm, closed_length_mm, dead_volume_l,
                base, rod_end ….
            name: default: the URDF's file name.
            joints: the coordinates; default: every movable joint between the pins of a cylinder or
                turned by a motor, from the root out.
            frozen: values of the other joints [rad or m]; default 0.
            payloads: load cases by name; default: an empty one.
            tool: a pin; default: the origin of the outermost link that the last joint moves.
            fluid: what differs from oil with a bulk modulus of 1200 MPa without air.
            supply: what differs from 250 bar, 5 bar return pressure, 100 l/min.
            requirements: as in a machine file.
            motors: tables by name: displacement_cm3, gear_ratio, trapped_volume_l ….

        Raises:
            MachineFileError: a joint that cannot be used (planar, floating, mimic), or anything
                else that is wrong.
        """
        urdf_text, path = foreign.read(urdf)
        text = foreign.machine_text(
            urdf_text,
            path,
            cylinders,
            name=name,
            joints=joints,
            frozen=frozen,
            payloads=payloads,
            tool=tool,
            fluid=fluid,
            supply=supply,
            requirements=requirements,
            motors=motors,
        )
        source = path.with_suffix(".toml")
        with lines_of("", source.name):  # the text is not the caller's
            return cls.from_text(text, urdf_text, source)

    # ------------------------------------------------------------------------------------ variants

    def with_payload(self, payload: str | float) -> Machine:
        """The same machine under another load case (its name), or with another mass [kg] in its place.

        A mass sits where the case at work has its own; if that has none, where the first case has
        that has one. It is a load case beside those of the file, and maps and designs count it
        too; the file itself does not change.
        """
        if isinstance(payload, str):
            named = {case.name: case for case in self.payloads}
            if payload not in named:
                raise ArmDesignError(
                    f"{self.name}: payload {payload}", "no such load case", choose(payload, named)
                )
            return dataclasses.replace(self, payload=named[payload])
        if isinstance(payload, bool) or not isinstance(payload, int | float | np.number):
            raise ArmDesignError(
                f"{self.name}: payload",
                f"a {type(payload).__name__} is not allowed",
                "give a name or a mass [kg]",
            )
        if not (math.isfinite(payload) and payload >= 0):
            raise ArmDesignError(
                f"{self.name}: payload",
                f"{payload:g} kg is not allowed",
                "give a mass in [0, ∞) kg",
            )
        placed = next(
            (case for case in (self.payload, *self.payloads) if case.link is not None), None
        )
        if placed is None and payload > 0:
            raise ArmDesignError(
                f"{self.name}: payload",
                "no load case says where a mass sits",
                "add link and at_mm to one",
            )
        case = dataclasses.replace(
            placed or self.payload, name=f"{payload:g} kg", mass=float(payload)
        )
        return dataclasses.replace(self, payload=case, payloads=(*self._cases_of_file, case))

    @property
    def _cases_of_file(self) -> tuple[Payload, ...]:
        return tuple(case for case in self.payloads if case.name in self.section.payload)

    def loaded_like(self, other: Machine) -> Machine:
        """This machine with the load case at work of another, and with its mass beside the file's, if it has one."""
        own = tuple(case for case in other.payloads if case.name not in other.section.payload)
        machine = dataclasses.replace(self, payloads=(*self._cases_of_file, *own))
        return machine.with_payload(other.payload.name)

    def replace(self, changes: Mapping[str, Any]) -> Machine:
        """The machine with other numbers at key paths of its file, in the file's units.

        Example: ``machine.replace({"cylinder.boom.bore_mm": 130.0})``.

        Raises:
            MachineFileError: a path or value that the file cannot have.
        """
        if not isinstance(changes, Mapping):
            raise MachineFileError(
                self.source.name, f"{changes!r} are no changes", "give {key path: value}"
            )
        text = machine_file.write(self.text, dict(changes), self.source.name)
        with lines_of(self.text, self.source.name):
            section = machine_file.parse(text, self.source.name)
            same_arm = (section.joints, section.frozen, section.urdf) == (
                self.section.joints,
                self.section.frozen,
                self.section.urdf,
            )
            machine = Machine.from_text(
                text, self.urdf_text, self.source, self.arm if same_arm else None
            )
        return machine.loaded_like(self)

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write machine file and URDF, both or none; the comments of the original stay.

        A URDF from outside the machine file's folder is copied beside the new file, and so is the
        JSON Schema that a ``#:schema`` line names.

        Args:
            path: of the machine file.
            overwrite: whether files may be replaced that this package did not make.

        Returns:
            The path of the machine file.

        Raises:
            ArmDesignError: a place that cannot be written, or holds a file of somebody else.
        """
        texts = self.files(path)
        target, urdf, *_ = texts
        if not overwrite:
            saving.refuse_foreign(target, texts[target])
            if urdf.is_file() and machine_file.read_text(urdf) != self.urdf_text:
                remedy = "save into another folder, or give overwrite=True"
                raise ArmDesignError(str(urdf), "another URDF of this name exists", remedy)
        saving.write_files(texts)
        return target

    def files(self, path: str | Path) -> dict[Path, str]:
        """What ``save`` would write: paths and texts of machine file, URDF and, where it is missing, the JSON Schema.

        Raises:
            ArmDesignError: a path that is none of a machine file.
        """
        target, text = _path(path), self.text
        if target.suffix != ".toml":
            raise ArmDesignError(str(target), "is not a .toml path", "end the name in .toml")
        urdf = target.parent / self.section.urdf
        if any(
            machine_file.leads_out(file.parent, self.section.urdf)
            for file in (self.source, target)
        ):
            urdf = target.parent / Path(self.section.urdf).name
            text = machine_file.write(text, {"urdf": urdf.name}, self.source.name)
        if urdf == target:
            raise ArmDesignError(
                str(urdf), "is the name of the URDF too", "give machine file and URDF two names"
            )
        text, schema = saving.schema_beside(text)
        place = target.parent / schema
        beside = {place: schema_text()} if schema and not place.exists() else {}
        return {target: text, urdf: self.urdf_text} | beside

    # --------------------------------------------------------------------------------------- poses

    def line_of(self, path: str) -> int | None:
        """Line of its file in which a key path stands, or the nearest table above it that the file has."""
        return Places(self.text).line_of(path)

    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names in the order of q."""
        return self.arm.names

    @cached_property
    def actuators(self) -> tuple[Actuator, ...]:
        """Everything hydraulic, in the order of all arrays: the cylinders, after them the motors."""
        return (*self.cylinders, *self.motors)

    @cached_property
    def idle(self) -> dict[str, list[str]]:
        """Cylinders and motors of the file that stand still, each with the frozen joints that hold it."""
        at_work = {motor.name for motor in self.motors}
        motors = {
            name: [motor.joint or name]
            for name, motor in self.section.motor.items()
            if name not in at_work
        }
        return parts.idle_cylinders(self.section, self.arm) | motors

    @cached_property
    def drives(self) -> tuple[Drive, ...]:
        """How each actuator moves the joints."""
        return (
            *self.linkages,
            *(Gear(joint=self.joints.index(motor.joint)) for motor in self.motors),
        )

    @cached_property
    def ranges(self) -> Array:
        """Joint ranges (nq, 2) [rad, m]: what the strokes allow, cut by the URDF's limits."""
        return self.range_within(0.0)

    def range_within(self, end_margin: float) -> Array:
        """Joint ranges (nq, 2) in which every cylinder keeps a share of its stroke free at both ends."""
        with lines_of(self.text, self.source.name):
            return joint_ranges(
                self.arm, self.linkages, self.cylinders, end_margin, self.source.name
            )

    @cached_property
    def idle_joints(self) -> frozenset[int]:
        """Joints whose position changes no frequency: they slew all there is, and no cylinder spans them.

        A cylinder across a joint changes length and moment arm with it. Slewing that carries an
        axis beside its own changes the inertia that the lower axis feels.
        """
        slewing = list(self.arm.slewing)
        spanned = {j for linkage in self.linkages for j in linkage.joints}
        feet = self.arm.kinematics(np.zeros((1, len(self.joints)))).translation[0, slewing, :2]
        return frozenset(
            j
            for k, j in enumerate(slewing)
            if j not in spanned and np.all(np.hypot(*(feet[:k] - feet[k]).T) < 1e-9)
        )

    def rigid_poses(self, q: ArrayLike) -> RigidPoses:
        """What the bare links contribute at q (n, nq).

        Reuse it for other pins, cylinders and payloads.
        """
        return self.arm.rigid_poses(self._checked(q))

    def margins(self, q: ArrayLike | RigidPoses) -> Array:
        """Share of its stroke that each actuator has left to its nearer end (n, nc).

        Negative when out of stroke.

        −inf where a four-bar does not close; inf for a motor, which has no ends. Never raises for
        a pose.
        """
        rigid = q if isinstance(q, RigidPoses) else self.arm.kinematics(self._checked(q))
        with np.errstate(invalid="ignore"):
            lengths = np.stack([drive.length(rigid) for drive in self.drives], axis=1)
        extension = (lengths - self._closed) / self._strokes
        margins = np.where(np.isinf(self._strokes), np.inf, np.minimum(extension, 1 - extension))
        return np.where(np.isnan(margins), -np.inf, margins)

    def pitch_excess(self, rigid: RigidPoses, payload: Payload) -> Array:
        """How far the load case's link is tipped from the middle of its pitch range, less half the range (n,) [rad].

        Negative where the link holds the load, zero on the limit; −inf for a case without a pitch
        range.
        """
        if payload.pitch is None or payload.link is None:
            return np.full(len(rigid), -np.inf)
        low, high = payload.pitch
        offset = self.arm.pitch(rigid, payload.link) - (low + high) / 2
        return np.abs(np.arctan2(np.sin(offset), np.cos(offset))) - (high - low) / 2

    def holds(self, q: ArrayLike | RigidPoses, payload: Payload | None = None) -> Flags:
        """Whether the load case exists at each pose (n,): the pitch of its link lies in the case's range."""
        rigid = q if isinstance(q, RigidPoses) else self.arm.kinematics(self._checked(q))
        return np.asarray(self.pitch_excess(rigid, payload or self.payload) <= PITCH_TOLERANCE)

    def at(self, q: ArrayLike | RigidPoses) -> Poses:
        """Everything at joint positions q (n, nq) [rad, m] (or one pose (nq,)) under the load case at work.

        Raises:
            PoseError: a pose out of stroke, at which a four-bar does not close, or singular.
        """
        if isinstance(q, RigidPoses):
            rigid = (q[rows] for rows in shown(chunks(len(q)), len(q), "poses"))
        else:
            q = self._checked(q)
            rigid = (
                self.arm.rigid_poses(q[rows]) for rows in shown(chunks(len(q)), len(q), "poses")
            )
        return stacked((self._reachable(part) for part in rigid), len(q))

    def _reachable(self, rigid: RigidPoses) -> Poses:
        poses = self.evaluate(rigid)
        self._refuse_unreachable(poses)
        return poses

    def evaluate(self, rigid: RigidPoses) -> Poses:
        """As ``at``, without its checks: what cannot be is inf or NaN there."""
        with np.errstate(invalid="ignore", divide="ignore"):
            actuation = [drive.actuation(rigid) for drive in self.drives]
        moment_arms = np.stack([a.moment_arm for a in actuation], axis=1)
        lengths = np.stack([a.length for a in actuation], axis=1)
        mass, gravity, gravity_stiffness = self.loaded(rigid)
        forces = static_forces(moment_arms, gravity, self._areas)
        extension = lengths - self._closed
        stiffness = [
            actuator.stiffness(extension[:, i], forces[:, i], self.fluid, self.supply)
            for i, actuator in enumerate(self.actuators)
        ]
        return Poses(
            q=rigid.q,
            mass_matrix=mass,
            gravity_torque=gravity,
            gravity_stiffness=gravity_stiffness,
            lengths=lengths,
            moment_arms=moment_arms,
            moment_arm_derivatives=np.stack([a.moment_arm_derivative for a in actuation], axis=1),
            extensions=extension / self._strokes,
            cylinder_forces=forces,
            oil_stiffness=np.stack(stiffness, axis=1),
            tool=np.array(self.arm.point(rigid, self.tool.link, np.array(self.tool.at))),
        )

    def loaded(self, rigid: RigidPoses) -> tuple[Array, Array, Array]:
        """M, g and ∂g/∂q with the payload at work and the cylinders' and four-bars' own masses."""
        mass, gravity, slope = rigid.mass_matrix, rigid.gravity_torque, rigid.gravity_stiffness
        points = self.bar_points(rigid)
        if self.payload.mass > 0 and self.payload.link is not None:
            joints = tuple(range(len(self.joints)))
            at = np.array(self.payload.at)
            points.append(
                (
                    self.payload.mass,
                    self.arm.motion(rigid, self.payload.link, at, self.arm.root, joints),
                )
            )
        if not points:
            return mass, gravity, slope
        added = of_points(points)
        return mass + added[0], gravity + added[1], slope + added[2]

    @property
    def loaded_arm(self) -> LoadedArm:
        """Links, payload at work and bars: what moves in a simulation."""
        load = self.payload
        points = self.bar_points if self.has_bars else None
        return LoadedArm(self.arm, load.link, load.at, load.mass, points)

    @property
    def has_bars(self) -> bool:
        """Whether a cylinder or four-bar has mass of its own."""
        return any(cylinder.moving_masses for cylinder in self.cylinders)

    def bar_points(self, rigid: RigidPoses) -> list[tuple[float, VectorJet]]:
        """Point masses [kg] that stand for barrels, rods, rockers and couplers: uniform slender bars."""
        points: list[tuple[float, VectorJet]] = []
        for cylinder, linkage in zip(self.cylinders, self.linkages, strict=True):
            masses = cylinder.moving_masses
            bars = linkage.bars(rigid, cylinder.closed_length) if masses else {}
            for name, mass in masses.items():
                points += points_of_bar(mass, bars[name])
        return points

    @cached_property
    def _closed(self) -> Array:
        return np.array([actuator.closed_length for actuator in self.actuators])

    @cached_property
    def _strokes(self) -> Array:
        return np.array([actuator.stroke for actuator in self.actuators])

    @cached_property
    def _areas(self) -> Array:
        return np.array([actuator.bore_area for actuator in self.actuators])

    def _checked(self, q: ArrayLike) -> Array:
        nq = len(self.joints)
        try:
            if np.iscomplexobj(q):
                raise TypeError
            array = np.array(q, dtype=float)
        except (TypeError, ValueError):
            raise PoseError(
                f"{self.name}: q", "is not an array of numbers", f"give shape (n, {nq})"
            ) from None
        array = array[None] if array.ndim == 1 else array
        if array.ndim != 2 or array.shape[1] != nq:
            raise PoseError(
                f"{self.name}: q",
                f"has shape {array.shape}",
                f"give (n, {nq}): {', '.join(self.joints)}",
            )
        if not np.all(np.isfinite(array)):
            raise PoseError(
                f"{self.name}: q",
                "holds a number that is not finite",
                "give finite joint positions",
            )
        return array

    def _refuse_unreachable(self, poses: Poses) -> None:
        for i, (linkage, cylinder) in enumerate(zip(self.linkages, self.cylinders, strict=True)):
            length = poses.lengths[:, i]
            part = f"{self.name}: {cylinder.name} cylinder"
            if np.any(open_ := ~np.isfinite(length)):
                where = self._pose_text(poses.q[open_][0])
                raise PoseError(
                    part,
                    f"its {linkage.title} does not close at {where}",
                    f"stay in the range of {self._range_text(linkage)}",
                )
            out = (length < cylinder.closed_length - STROKE_TOLERANCE) | (
                length > cylinder.open_length + STROKE_TOLERANCE
            )
            if np.any(out):
                raise PoseError(
                    part,
                    f"length {length[out][0]:.4f} m is outside its stroke "
                    f"[{cylinder.closed_length:.4f}, {cylinder.open_length:.4f}] m "
                    f"at {self._pose_text(poses.q[out][0])}",
                    f"stay in the range of {self._range_text(linkage)} or change stroke and pins",
                )
        if np.any(singular := is_singular(poses.moment_arms)):
            where = self._pose_text(poses.q[singular][0])
            raise PoseError(
                f"{self.name}: pose",
                f"singular at {where}: a cylinder is at its dead centre",
                "avoid it",
            )

    def _pose_text(self, q: Array) -> str:
        return ", ".join(
            f"{joint.name} {value:.4f} {'rad' if joint.revolute else 'm'}"
            for joint, value in zip(self.arm.joints, q, strict=True)
        )

    def _range_text(self, linkage: Linkage) -> str:
        words = []
        for j in linkage.joints:
            (low, high), joint = self.ranges[j], self.arm.joints[j]
            words.append(
                f'joint "{joint.name}" [{low:.4f}, {high:.4f}] {"rad" if joint.revolute else "m"}'
            )
        return " and ".join(words)


# ----------------------------------------------------------------------------------- from the file


def load(path_or_name: str | Path, *, allow_outside: bool = False) -> Machine:
    """Machine from a ``.toml`` file, a folder ``<name>/<name>.toml``, or the name of a shipped machine.

    It carries its first load case.

    Args:
        path_or_name: which machine.
        allow_outside: whether the file may name a URDF outside its folder (or behind a symbolic
            link out of it).

    Raises:
        MachineFileError: no such machine, or a fault in its file or URDF.
    """
    path = find(path_or_name)
    text = machine_file.read_text(path)
    with lines_of(text, path.name):
        section = machine_file.parse(text, path.name)
        urdf_text = machine_file.read_urdf(path, section.urdf, allow_outside)
    return Machine.from_text(text, urdf_text, path)


def shipped() -> dict[str, Path]:
    """Machine files that come with the package, by name."""
    here = Path(__file__).resolve().parents[1]
    for folder in (here / "robots", here.parent / "robots"):  # wheel; editable install or checkout
        if folder.is_dir():
            return {p.stem: p for p in sorted(folder.glob("*/*.toml")) if p.stem == p.parent.name}
    return {}


def _path(value: str | Path) -> Path:
    try:
        path = Path(value)
        path.is_dir()  # a name that is too long raises
    except TypeError:
        raise MachineFileError(str(value), "is not a path", "give a path or a name") from None
    except OSError as error:
        raise MachineFileError(
            f"{value!s:.60}…", f"cannot be read ({error.strerror})", "check the path"
        ) from None
    return path


def find(path_or_name: str | Path) -> Path:
    """The machine file that a path, folder or shipped name stands for.

    Raises:
        MachineFileError: no such machine.
    """
    path, names = _path(path_or_name), shipped()
    transaction.mend(path if path.is_dir() else path.parent)
    own = path / f"{path.resolve().name if path.is_dir() else path.name}.toml"
    if own.is_file():
        return own
    if (
        str(path) in names and not path.is_file()
    ):  # a folder of results may have the name of its machine
        return names[str(path)]
    if path.is_dir():
        raise MachineFileError(str(path), f"holds no {own.name}", "name the .toml file itself")
    if path.suffix == ".toml" or path.exists():
        return path
    raise MachineFileError(
        str(path), "no such machine", f"{choose(str(path), names)}, or give a .toml file"
    )


def _assemble(
    section: MachineSection, arm: Arm, *, text: str, urdf_text: str, source: Path
) -> Machine:
    unknown = parts.unknown_links(section, arm.links, source.name)
    for fault in unknown + parts.unknown_joints(
        section, arm.all_joints, arm.movable_joints, source.name
    ):
        raise fault
    payloads = parts.payloads(section)
    idle = parts.idle_cylinders(section, arm)
    cylinders = {name: table for name, table in section.cylinder.items() if name not in idle}
    return Machine(
        name=section.name,
        arm=arm,
        cylinders=tuple(parts.cylinder(name, table) for name, table in cylinders.items()),
        linkages=tuple(parts.linkage(table, arm) for table in cylinders.values()),
        motors=parts.motors(section),
        payloads=payloads,
        payload=payloads[0],
        fluid=parts.fluid(section.fluid),
        supply=parts.supply(section.supply),
        tool=parts.pin(section.tool),
        section=section,
        text=text,
        urdf_text=urdf_text,
        source=source,
    )


def faults_of(machine: Machine) -> Iterator[MachineFileError]:
    """What only the assembled machine can tell: every joint driven, four-bars planar, every joint has a range."""
    source, arm = machine.source.name, machine.arm
    sound = True
    for cylinder, linkage in zip(machine.cylinders, machine.linkages, strict=True):
        where = f"{source}: cylinder.{cylinder.name}"
        if not linkage.joints:
            sound = False
            yield MachineFileError(
                where,
                "no joint lies between its pins",
                "put its pins on links that move to each other",
            )
        elif fault := linkage.fault(where):
            sound = False
            yield fault
    for motor in machine.motors:
        if not arm.joints[arm.names.index(motor.joint)].revolute:
            sound = False
            yield MachineFileError(
                f"{source}: motor.{motor.name}", f'"{motor.joint}" does not turn', "use a cylinder"
            )
    driven = {j for drive in machine.drives for j in drive.joints}
    for j, joint in enumerate(arm.joints):
        if j not in driven:
            sound = False
            yield MachineFileError(
                f"{source}: joints",
                f'no cylinder or motor moves "{joint.name}"',
                "add one or freeze the joint",
            )
    if sound:
        yield from _faults_of_ranges(machine)


def _faults_of_ranges(machine: Machine) -> Iterator[MachineFileError]:
    """Each joint that has no range, then cylinders that leave a motion free at the middle of all of them."""
    source = machine.source.name
    try:
        middle = machine.ranges.mean(axis=1)[None]
    except MachineFileError:
        pairs = list(zip(machine.linkages, machine.cylinders, strict=True))
        for j in range(len(machine.joints)):
            own = [(linkage, cylinder) for linkage, cylinder in pairs if linkage.joints == (j,)]
            try:
                joint_ranges(
                    machine.arm, tuple(k for k, _ in own), tuple(c for _, c in own), 0.0, source
                )
            except MachineFileError as error:
                yield from _with_cause(machine, j, own, error)
        return
    if is_singular(machine.evaluate(machine.rigid_poses(middle)).moment_arms)[0]:
        yield MachineFileError(
            f"{source}: cylinder",
            "cylinders and motors leave a direction of motion free",
            "check the pins",
        )


def _with_cause(
    machine: Machine, j: int, own: list[tuple[Linkage, Cylinder]], error: MachineFileError
) -> Iterator[MachineFileError]:
    """Why a joint has no range: with its likely cause in one, or after that where it is the URDF's."""
    cause = cause_of(machine.arm, j, own, faulty=True)
    if cause is None:
        yield error
    elif cause.in_urdf:
        part, line = place_in_urdf(machine, j, cause)
        yield MachineFileError(part, f"{cause.words}; now {error.problem}", cause.remedy, line)
        yield error
    else:
        part = error.part.removeprefix(f"{machine.source.name}: ")
        problem, remedy = (
            f"{cause.words}: {part}: {error.problem}",
            f"{cause.remedy}, or {error.remedy}",
        )
        yield MachineFileError(f"{machine.source.name}: {cause.path}", problem, remedy)


def place_in_urdf(machine: Machine, j: int, cause: Cause) -> tuple[str, int | None]:
    """Part and line of a cause that lies in the URDF: a joint's axis or limits, or the whole of it."""
    source, name = machine.section.urdf, machine.joints[j]
    if cause.path == "urdf":
        return source, None
    joint = next(
        at for at in parse(machine.urdf_text, source).findall("joint") if at.get("name") == name
    )
    element = joint.find({"axis": "axis", "limits": "limit"}[cause.path])
    return f"{source}: joint {name}", line_of(joint if element is None else element)
