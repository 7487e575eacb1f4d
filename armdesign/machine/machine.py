"""The machine: an arm, its cylinders, oil, supply and load cases, as one immutable value.

A machine is made from its file's text and knows it: ``replace`` edits the text at key paths and
reads it again, ``save`` writes it. So whatever a machine answers, its file answers too.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arguments import checked, with_options
from armdesign.arrays import Array, Flags, side_by_side, stacked
from armdesign.errors import MachineFileError
from armdesign.hydraulics.actuator import Actuator, Cylinder, Motor
from armdesign.hydraulics.fluid import Fluid, Supply
from armdesign.machine import from_urdf, parts
from armdesign.machine.assembly_faults import assembly_faults
from armdesign.machine.carried_masses import bar_points, loaded
from armdesign.machine.changed_parts import refuse_changed_parts
from armdesign.machine.file import machine_file, saving, toml_writing
from armdesign.machine.file.contradictions import unknown_joints, unknown_links
from armdesign.machine.file.schema import MachineSection
from armdesign.machine.file.toml_reading import KeyLines, lines_of
from armdesign.machine.heading import Heading, heading_of
from armdesign.machine.links import urdf_of
from armdesign.machine.load_case import LoadCase, case_named, case_of_mass, place_of, placed_again
from armdesign.machine.poses import Poses, joint_positions, poses_of, reachable_poses
from armdesign.mechanism.arm import Arm, LoadedArm
from armdesign.mechanism.joint_ranges import joint_ranges
from armdesign.mechanism.linkage.base import Drive, Linkage, Pin
from armdesign.mechanism.linkage.gear import Gear
from armdesign.mechanism.point_masses import fixed_points
from armdesign.mechanism.rigid_poses import RigidPoses
from armdesign.mechanism.spring import Spring
from armdesign.progress import with_bar
from armdesign.short_repr import machine_repr
from armdesign.threads import in_threads, thread_chunks

if TYPE_CHECKING:
    from armdesign.plots.canvas import Axes


@dataclass(frozen=True, eq=False, kw_only=True)
class Machine:
    """A hydraulic boom machine.

    Attributes:
        name: short name, also of files written about it.
        arm: rigid links and joints.
        cylinders: those that move a joint, in the order of the file.
        linkages: the pins of each cylinder, same order.
        idle_cylinders: those whose joints are all frozen, each with its linkage: bodies of a link.
        motors: those whose joint is a coordinate, in the order of the file.
        springs: passive joints, coordinates after the joints, in the order of the file.
        payloads: all load cases, in the order of the file.
        payload: the load case at work.
        fluid: the oil.
        supply: the pump.
        tool: the point whose position is reported.
        section: the machine file as read.
        text: its text.
        urdf_text: text of its URDF, or of the one that stands for its ``[links]``.
        source: where it came from, for messages.
    """

    name: str
    arm: Arm
    cylinders: tuple[Cylinder, ...]
    linkages: tuple[Linkage, ...]
    idle_cylinders: tuple[tuple[Cylinder, Linkage], ...]
    motors: tuple[Motor, ...]
    springs: tuple[Spring, ...]
    payloads: tuple[LoadCase, ...]
    payload: LoadCase
    fluid: Fluid
    supply: Supply
    tool: Pin
    section: MachineSection
    text: str
    urdf_text: str
    source: Path

    __repr__ = machine_repr

    @classmethod
    def from_text(cls, text: str, urdf_text: str, source: Path, **known: Any) -> Machine:
        """The machine that the texts describe, as ``unchecked``, and that can be used.

        Raises:
            MachineFileError: anything in them that no machine can have.
        """
        with lines_of(text, source.name):
            machine = cls.unchecked(text, urdf_text, source, **known)
            for fault in assembly_faults(machine):
                raise fault
        return machine

    @classmethod
    def unchecked(
        cls,
        text: str,
        urdf_text: str,
        source: Path,
        *,
        arm: Arm | None = None,
        section: MachineSection | None = None,
    ) -> Machine:
        """The machine of both texts, which may still have ``assembly_faults``.

        Args:
            text: of the machine file, TOML.
            urdf_text: of the URDF; not read where the file has ``[links]``.
            source: path of the machine file, for messages and the URDF's place.
            arm: the arm if it has been read already.
            section: the data in the text if it has been read already.
        """
        section = section or machine_file.parse(text, source.name)
        urdf_text = urdf_of(section.links) if section.links else urdf_text
        arm = arm or parts.arm(section, urdf_text, source.name)
        faults = unknown_links(section, arm.links, source.name)
        faults += unknown_joints(section, arm.all_joints, arm.movable_joints, source.name)
        for fault in faults:
            raise fault
        load_cases = parts.load_cases(section)
        moving, idle = parts.cylinders_with_linkages(section, arm)
        return cls(
            name=section.name,
            arm=arm,
            cylinders=tuple(cylinder for cylinder, _ in moving),
            linkages=tuple(linkage for _, linkage in moving),
            idle_cylinders=idle,
            motors=parts.motors(section),
            springs=parts.springs_of(section),
            payloads=load_cases,
            payload=load_cases[0],
            fluid=parts.fluid(section.fluid),
            supply=parts.supply(section.supply),
            tool=parts.pin(section.tool),
            section=section,
            text=text,
            urdf_text=urdf_text,
            source=source,
        )

    @classmethod
    @checked
    @with_options(from_urdf.Tables, from_urdf.NO_TABLES)
    def from_urdf(
        cls,
        urdf: str | Path,
        cylinders: Mapping[str, Any],
        *,
        name: str | None = None,
        joints: Iterable[str] | None = None,
        **tables: Unpack[from_urdf.Tables],
    ) -> Machine:
        """A machine from a URDF that already exists; tables as in a machine file, in its units.

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
            springs: tables by name: joint, stiffness_N_m_per_rad or stiffness_N_per_m ….
            bands: default: structure from rigid to as soft as the oil.

        Raises:
            MachineFileError: what is wrong, such as a planar, floating or mimicking joint.
        """
        urdf_text, path = from_urdf.read(urdf)
        given = {"cylinders": cylinders, **tables}
        text = from_urdf.machine_text(urdf_text, path, name, joints, given)
        source = path.with_suffix(".toml")
        with lines_of("", source.name):  # the text is not the caller's
            return cls.from_text(text, urdf_text, source)

    # ------------------------------------------------------------------------------------ variants

    def with_payload(self, payload: str | float) -> Machine:
        """The machine under another load case, by its name, or with another mass [kg].

        A mass sits where the case at work has its own, else the first that has one, as the file
        has it then, and is held in its pitch range, 0 kg at any. Maps and designs count it beside
        the file's, which stays; ``save`` does not write it.

        Raises:
            ArmDesignError: no such load case, no mass ≥ 0, or no load case that says where it is.
        """
        if isinstance(payload, str):
            return replace(self, payload=case_named(payload, self.payloads, self.name))
        at_work = place_of(self.payload, self._cases_of_file)
        case = case_of_mass(payload, (at_work, *self.payloads), self.name)
        return replace(self, payload=case, payloads=(*self._cases_of_file, case))

    def plot(self, q: ArrayLike | None = None, ax: Axes | None = None) -> Axes:
        """Side view to scale at q (nq,) [rad, m], by default mid ranges; returns the axes."""
        from armdesign.plots.machines import machine_drawing

        return machine_drawing(self, q, ax)

    def _repr_html_(self) -> str:
        from armdesign.report import notebook

        return notebook.of_machine(self)

    @property
    def _cases_of_file(self) -> tuple[LoadCase, ...]:
        return tuple(case for case in self.payloads if case.name in self.section.payload)

    def loaded_like(self, other: Machine) -> Machine:
        """This machine with the load case at work of another, without those that it leaves out.

        Parts of the other that its file has not would be lost: they are refused.
        """
        refuse_changed_parts(other)
        of_file, cases = other.section.payload, self._cases_of_file
        left_out = of_file.keys() - {case.name for case in other.payloads}
        kept = (case for case in cases if case.name not in left_out)
        own = (placed_again(case, cases) for case in other.payloads if case.name not in of_file)
        return replace(self, payloads=(*kept, *own)).with_payload(other.payload.name)

    def replace(self, changes: Mapping[str, Any]) -> Machine:
        """The machine with other numbers at key paths of its file, in the file's units.

        Example: ``machine.replace({"cylinder.boom.bore_mm": 130.0})``.

        Raises:
            MachineFileError: a path or value that the file cannot have; a part changed in memory.
        """
        source = self.source.name
        if not isinstance(changes, Mapping):
            raise MachineFileError(source, f"{changes!r}: expected {{key path: value}}")
        text = toml_writing.edit(self.text, changes, source)
        with lines_of(self.text, source):
            section = machine_file.parse(text, source)
            before, after = map(parts.coordinates, (self.section, section))
            known = {"arm": self.arm if before == after else None, "section": section}
            machine = Machine.from_text(text, self.urdf_text, self.source, **known)
        return machine.loaded_like(self)

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write machine file and URDF if it has one, both or none; the comments stay.

        A URDF from outside the machine file's folder is copied beside the new file, and so is the
        JSON Schema that a ``#:schema`` line names.

        Args:
            path: of the machine file, which is returned.
            overwrite: whether files may be replaced that this package did not make.

        Raises:
            ArmDesignError: a place not writable or of a foreign file, a part changed in memory.
        """
        refuse_changed_parts(self)
        return saving.save(self, path, overwrite)

    def files(self, path: str | Path) -> dict[Path, str]:
        """Paths and texts that ``save`` writes: machine file, URDF if any, missing JSON Schema.

        Raises:
            ArmDesignError: a path that no machine file can have, or a part changed in memory.
        """
        refuse_changed_parts(self)
        return saving.files(self, path)

    def line_of(self, path: str) -> int | None:
        """Line of a key path in its file, or of the nearest table above it that the file has."""
        return KeyLines(self.text).line_of(path)

    @property
    def identity(self) -> list[str]:
        """Everything in which two machines can differ: texts, and parts changed since."""
        parts = (getattr(self, of.name) for of in fields(self) if of.name not in ("arm", "source"))
        return [self.arm.xml, repr(self.arm.limits.tolist()), *map(repr, parts)]

    @property
    def joints(self) -> tuple[str, ...]:
        """Joint names in the order of q."""
        return self.arm.names

    @cached_property
    def actuators(self) -> tuple[Actuator, ...]:
        """Cylinders, and motors after them: the order of all arrays."""
        return (*self.cylinders, *self.motors)

    @property
    def yielding(self) -> tuple[Actuator | Spring, ...]:
        """Actuators, and springs after them: what stores the energy of a mode."""
        return (*self.actuators, *self.springs)

    @cached_property
    def idle(self) -> dict[str, list[str]]:
        """Cylinders and motors that stand still, each with the frozen joints that hold it."""
        motors, at_work = self.section.motor, {motor.name for motor in self.motors}
        cylinders = {one.name: parts.frozen_joints(k) for one, k in self.idle_cylinders}
        return cylinders | {k: [one.joint or k] for k, one in motors.items() if k not in at_work}

    @cached_property
    def drives(self) -> tuple[Drive, ...]:
        """Linkages and gears by which the actuators move the joints."""
        gears = (Gear(joint=self.joints.index(motor.joint)) for motor in self.motors)
        return (*self.linkages, *gears)

    @cached_property
    def ranges(self) -> Array:
        """Joint ranges (nq, 2) [rad, m] by strokes and URDF limits; raises as ``range_within``."""
        return self.range_within(0.0)

    @property
    def known_ranges(self) -> Array:
        """The ``ranges``; the URDF's limits of a machine that cannot be assembled."""
        try:
            return self.ranges
        except MachineFileError:
            return self.arm.limits

    def range_within(self, end_margin: float) -> Array:
        """Joint ranges (nq, 2) that leave a share of every stroke free at both ends.

        Raises:
            MachineFileError: no such range, or within it a dead centre or a linkage that opens.
        """
        with lines_of(self.text, source := self.source.name):
            return joint_ranges(self.arm, self.linkages, self.cylinders, end_margin, source)

    @cached_property
    def heading(self) -> Heading:
        """Where the arm points: reach, and what is ahead."""
        return heading_of(self)

    @cached_property
    def joints_without_effect(self) -> frozenset[int]:
        """Joints whose position changes no frequency."""
        return self.arm.without_effect({j for k in self.linkages for j in k.joints})

    def rigid_poses(self, q: ArrayLike) -> RigidPoses:
        """Inertia and gravity of the bare links at q (n, nq), for any cylinders and loads."""
        return self.arm.rigid_poses(joint_positions(self, q))

    def margins(self, q: ArrayLike | RigidPoses) -> Array:
        """Share of its stroke that each actuator has left to its nearer end (n, nc).

        Negative out of stroke, −inf where a four-bar does not close; inf for a motor, which has
        no ends. Never raises for a pose.
        """
        rigid = self._placed(q)
        with np.errstate(invalid="ignore"):
            lengths = np.stack([drive.length(rigid) for drive in self.drives], axis=1)
        extension = (lengths - self.closed_lengths) / self.strokes
        margins = np.where(np.isinf(self.strokes), np.inf, np.minimum(extension, 1 - extension))
        return np.where(np.isnan(margins), -np.inf, margins)

    def pitch_excess(self, rigid: RigidPoses, payload: LoadCase) -> Array:
        """Angle by which the load case's link is tipped out of its pitch range (n,) [rad]."""
        return payload.pitch_excess(self.heading, rigid)

    def holds(self, q: ArrayLike | RigidPoses, payload: LoadCase | None = None) -> Flags:
        """Whether the load case exists at each pose (n,): its link's pitch lies in its range."""
        return (payload or self.payload).exists(self.heading, self._placed(q))

    def _placed(self, q: ArrayLike | RigidPoses) -> RigidPoses:
        """Placements at q (n, nq), if they are not known already."""
        return q if isinstance(q, RigidPoses) else self.arm.kinematics(joint_positions(self, q))

    def at(self, q: ArrayLike | RigidPoses) -> Poses:
        """Everything at q (n, nq) [rad, m], or one pose (nq,), under the load case at work.

        Raises:
            PoseError: q is no such array; a pose out of stroke, at which a four-bar does not
                close, singular, or on springs that are too soft.

        Example:
            >>> import armdesign as ad
            >>> machine = ad.load("paper_1dof")
            >>> poses = machine.at([[-0.5], [0.0], [0.5]])
            >>> print(poses.moment_arms.shape, poses.lengths[:, 0].round(3))
            (3, 1, 1) [0.587 0.522 0.448]
        """
        q = q if isinstance(q, RigidPoses) else joint_positions(self, q)
        self.arm.load()
        slices = with_bar(thread_chunks(len(q), len(self.arm.coordinates)), len(q), "poses")
        return stacked(in_threads(lambda rows: self._reachable(q[rows]), slices), len(q))

    def _reachable(self, q: RigidPoses | Array) -> Poses:
        return reachable_poses(self, q if isinstance(q, RigidPoses) else self.arm.rigid_poses(q))

    def evaluate(self, rigid: RigidPoses) -> Poses:
        """Everything at the poses, not checked as by ``at``: impossible values are inf or NaN."""
        return poses_of(self, rigid)

    def loaded(self, rigid: RigidPoses) -> tuple[Array, Array, Array]:
        """M, g and ∂g/∂q of links, payload at work, cylinders and four-bars, idle ones too."""
        return loaded(self, rigid)

    @property
    def loaded_arm(self) -> LoadedArm:
        """Links, payload at work and bars: what moves in a simulation."""
        load, fixed = self.payload, self.idle_points
        if load.link is not None:
            fixed = [(load.mass, load.link, np.array(load.at)), *fixed]
        return LoadedArm(self.arm, fixed, partial(bar_points, self) if self.has_bars else None)

    @property
    def has_bars(self) -> bool:
        """Whether a cylinder or four-bar that moves has mass of its own."""
        return any(cylinder.moving_masses for cylinder in self.cylinders)

    @cached_property
    def idle_points(self) -> list[tuple[float, str, Array]]:
        """Point masses [kg] in place of bars of idle cylinders, each in a link at (3,) [m]."""
        return [point for pair in self.idle_cylinders for point in fixed_points(*pair)]

    @cached_property
    def spring_stiffness(self) -> Array:
        """Stiffness κ of the springs (ns,) [N m/rad, N/m]."""
        return side_by_side(spring.stiffness for spring in self.springs)

    @cached_property
    def closed_lengths(self) -> Array:
        """Closed length of each actuator (nc,) [m]; 0 for a motor."""
        return side_by_side(actuator.closed_length for actuator in self.actuators)

    @cached_property
    def strokes(self) -> Array:
        """Stroke of each actuator (nc,) [m]; inf for a motor."""
        return side_by_side(actuator.stroke for actuator in self.actuators)

    @cached_property
    def bore_areas(self) -> Array:
        """Bore area of each actuator (nc,) [m², of a motor m³/rad]."""
        return side_by_side(actuator.bore_area for actuator in self.actuators)
