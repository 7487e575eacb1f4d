"""Every load case over a workspace: the one loop over load cases and the poses of each.

Maps, bands, requirements and designs ask about "all poses and load cases"; all of them loop here.
What a load case is, and at which poses it exists, stands in ``machine.load_case``; what it adds to
inertia and gravity in ``Machine.loaded``. A new kind of load case changes these two and nothing
here.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.errors import TopplingError
from armdesign.frequency.workspace import Workspace
from armdesign.machine.machine import Machine
from armdesign.machine.poses import Poses, refuse_toppling
from armdesign.mechanism.arm import RigidPoses


@dataclass(frozen=True, eq=False, kw_only=True)
class CasePoses:
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
    inertias of the bare links.
    """
    for payload in machine.payloads:
        loaded = replace(machine, payload=replace(payload, mass=payload_share * payload.mass))
        exists = workspace.holds(payload)
        yield CasePoses(machine=loaded, workspace=workspace, exists=exists, link_share=link_share)


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
    cases: Sequence[CasePoses], what: str
) -> Iterator[tuple[CasePoses, Array, RigidPoses]]:
    """The load cases of one workspace at their poses, chunk by chunk: case, indices, bare links.

    Each chunk of the workspace is computed once for all load cases; none of a large workspace is
    kept in memory. ``what`` names the work in the progress bar.
    """
    for rows, rigid in cases[0].workspace.parts(what):
        for case in cases:
            chosen = np.flatnonzero(case.exists[rows])
            yield case, rows.start + chosen, scaled_links(rigid[chosen], case.link_share)


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
    errors = []
    for case, _, rigid in in_chunks(cases, f"{cases[0].machine.name}: springs"):
        try:
            case.machine.at(rigid)
        except TopplingError as error:
            errors.append(error)
    if errors:
        raise max(errors, key=lambda error: error.factor)


def scaled_links(rigid: RigidPoses, share: float) -> RigidPoses:
    """The bare links with all masses and inertias times a share: M, g and ∂g/∂q are linear."""
    names = ("mass_matrix", "gravity_torque", "gravity_stiffness") if share != 1.0 else ()
    return (
        replace(rigid, **{name: share * getattr(rigid, name) for name in names})
        if names
        else rigid
    )
