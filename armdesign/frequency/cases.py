"""Every load case over a workspace: the one loop over load cases and the poses of each.

Maps, bands, requirements and designs ask about "all poses and load cases"; all of them loop here.
What a load case is, and at which poses it exists, stands in ``machine.load_case``; what it adds to
inertia and gravity in ``Machine.loaded``. A new kind of load case changes these two and nothing
here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from armdesign.arrays import Array, Flags, ReadOnly
from armdesign.errors import PoseError, TopplingError
from armdesign.frequency.workspace import Workspace
from armdesign.machine.machine import Machine
from armdesign.machine.poses import Poses, refuse_toppling
from armdesign.mechanism.rigid_poses import RigidPoses

T = TypeVar("T")


@dataclass(frozen=True, eq=False, kw_only=True)
class CasePoses(ReadOnly):
    """A load case and the poses of a workspace at which it exists."""

    machine: Machine  # the machine with this load case at work
    workspace: Workspace  # all poses, also those at which the load case does not exist
    exists: Flags  # whether the load case exists at each pose of the workspace (n,)
    link_share: float = 1.0  # factor on all masses and inertias of the bare links

    @property
    def name(self) -> str:
        """Name of the load case."""
        return self.machine.payload.name

    @property
    def indices(self) -> Array:
        """Indices of its poses in the workspace (m,)."""
        return np.flatnonzero(self.exists)

    @property
    def rigid(self) -> RigidPoses:
        """The bare links at its poses (m)."""
        return scaled_links(self.workspace.rigid[self.exists], self.link_share)

    def evaluate(self) -> Poses:
        """Everything at its poses (m), without the checks of ``Machine.at``."""
        return self.machine.evaluate(self.rigid)

    def rigid_at(self, q: Array) -> RigidPoses:
        """The bare links at any poses (n, nq), or one (nq,)."""
        return scaled_links(self.machine.rigid_poses(q), self.link_share)

    def exists_at(self, rigid: RigidPoses) -> Flags:
        """Whether it exists, with all cylinders in stroke, at any poses within the ranges (n,)."""
        return self.machine.holds(rigid) & self.workspace.in_stroke(rigid.q)


def load_cases(
    machine: Machine, workspace: Workspace, payload_share: float = 1.0, link_share: float = 1.0
) -> Iterator[CasePoses]:
    """Every load case of a machine, in the order of its file, with the poses at which it exists.

    ``payload_share`` is a factor on the mass of every load case, ``link_share`` on all masses and
    inertias of the bare links. A workspace of other links has its poses on the machine's.
    """
    workspace = workspace.on(machine)
    for payload in machine.payloads:
        loaded = replace(machine, payload=replace(payload, mass=payload_share * payload.mass))
        exists = workspace.holds(payload)
        yield CasePoses(machine=loaded, workspace=workspace, exists=exists, link_share=link_share)


def refuse_missing(cases: Sequence[CasePoses]) -> None:
    """Raise for a load case that exists at no pose.

    Raises:
        PoseError: names its pitch in the file.
    """
    for case in cases:
        if not case.exists.any():
            payload = case.machine.payload
            path, link = ".".join(payload.limit_location), payload.link
            part, line = f"{case.machine.source.name}: {path}", case.machine.line_of(path)
            fault = f"link {link} has that pitch at no pose of the workspace"
            raise PoseError(part, fault, "widen it, or remove the load case", line)


def groups_by_case(
    machine: Machine, payloads: Sequence[str | float | None]
) -> Iterator[tuple[Machine, Flags]]:
    """The machine under each load case of some poses, and which of the poses it is at (n,).

    ``payloads`` holds the load case of each pose as ``Machine.with_payload`` takes it; None is the
    load case at work.
    """
    for payload in dict.fromkeys(payloads):
        loaded = machine if payload is None else machine.with_payload(payload)
        yield loaded, np.array([one == payload for one in payloads])


def in_chunks(
    cases: Sequence[CasePoses], work: Callable[[CasePoses, RigidPoses], T], what: str
) -> Iterator[tuple[CasePoses, T]]:
    """Results of work on load cases of one workspace and the bare links at a chunk of its poses.

    Chunk by chunk in the order of the workspace, and in each the load cases that exist at any of
    its poses. Bare links are computed once for all load cases, and not kept if there are many.
    Chunks go by threads, see ``in_threads``. ``what`` names the work in the progress bar.
    """

    def at_all(rows: slice, rigid: RigidPoses) -> list[tuple[CasePoses, T]]:
        def at(some: Array) -> RigidPoses:
            return rigid if len(some) == len(rigid) else rigid[some]

        chosen = ((case, np.flatnonzero(case.exists[rows])) for case in cases)
        return [
            (case, work(case, scaled_links(at(some), case.link_share)))
            for case, some in chosen
            if len(some)
        ]

    for results in cases[0].workspace.parts(at_all, what):
        yield from results


def poses_of(cases: Sequence[CasePoses], case: CasePoses, at: RigidPoses | Poses) -> Poses:
    """A load case at a chunk of its poses; springs too soft there are told what all poses need.

    They may be known of a machine that differs in oil, structure and springs alone.

    Raises:
        PoseError: as ``Machine.at`` does.
    """
    try:
        if isinstance(at, RigidPoses):
            return case.machine.at(at)
        poses = at.on(case.machine)
        refuse_toppling(case.machine, poses)
        return poses
    except TopplingError:
        refuse_toppling_anywhere(cases)
        raise


def refuse_toppling_anywhere(cases: Sequence[CasePoses]) -> None:
    """Raise for the pose, of all load cases at all of theirs, that asks most of a spring.

    Raises:
        PoseError: as ``Machine.at`` does.
    """

    def error_at(case: CasePoses, rigid: RigidPoses) -> list[TopplingError]:
        try:
            case.machine.at(rigid)
        except TopplingError as error:
            return [error]
        return []

    found = in_chunks(cases, error_at, f"{cases[0].machine.name}: springs")
    if errors := [error for _, some in found for error in some]:
        raise max(errors, key=lambda error: error.factor)


def scaled_links(rigid: RigidPoses, share: float) -> RigidPoses:
    """The bare links with all masses and inertias times a share: M, g and ∂g/∂q are linear."""
    names = ("mass_matrix", "gravity_torque", "gravity_stiffness") if share != 1.0 else ()
    return (
        replace(rigid, **{name: share * getattr(rigid, name) for name in names})
        if names
        else rigid
    )
