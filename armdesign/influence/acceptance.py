"""Acceptance: which requirements of the file the machines of one drawing meet.

Machines are judged one by one, as ``design/requirements/check.py`` judges a new design, but with
the drawing in the place of today's machine: a share is one of what the drawing has. Static loads
are those at the poses where the drawing's are largest. A limit that the drawing has exactly, as
that of a share of 1, does not count where machines miss it: every other one would. Pin boxes and
strokes that keep today's ranges bound the search for a design, not a machine, and are left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array, Flags, ReadOnly, read_only
from armdesign.design.requirements.candidate import (
    CHECKED_POSES,
    MachineCandidate,
    Reference,
    reference_of,
)
from armdesign.design.requirements.record import Check, Evaluation
from armdesign.design.requirements.settings import Requirements, evaluations
from armdesign.frequency.cases import load_cases
from armdesign.frequency.workspace import Workspace
from armdesign.influence.family import Family
from armdesign.influence.widths import Width, family_of
from armdesign.machine.lifting import unloaded
from armdesign.machine.machine import Machine
from armdesign.mechanism.arm import Arm
from armdesign.mechanism.rigid_poses import RigidPoses
from armdesign.report.sheet import Sheet
from armdesign.units import Units, share_text

if TYPE_CHECKING:
    import pandas as pd

JUDGED = 256  # machines
SHOWN = 5  # requirements in the printed table


@dataclass(frozen=True, eq=False)
class Acceptance(ReadOnly):
    """Requirements of the file, judged on n machines of one drawing.

    Attributes:
        drawn: the requirements (m), judged on the drawing.
        slacks: of the machines (n, m), ≥ 0 where met; −1 where a linkage opens, of the frequency
            where no pose is in stroke.
    """

    drawn: tuple[Check, ...]
    slacks: Array

    @cached_property
    @read_only
    def counted(self) -> Flags:
        """Whether each requirement counts (m,).

        Not where the drawing itself lies exactly on a limit that machines miss.
        """
        exact = np.array([check.slack == 0.0 for check in self.drawn])
        return np.asarray(~(exact & (self.missed > 0)))

    @cached_property
    @read_only
    def missed(self) -> Array:
        """Share of machines that miss each requirement (m,)."""
        return np.asarray(np.mean(self.slacks < 0, axis=0))

    @cached_property
    def share(self) -> float:
        """Share of machines that meet every requirement that counts."""
        return float(np.mean(np.all(self.slacks[:, self.counted] >= 0, axis=1)))

    @property
    def standard_error(self) -> float:
        """Standard error of that share, of independent machines (Agresti and Coull 1998)."""
        count = len(self.slacks)
        share = (self.share * count + 2) / (count + 4)
        return float(np.sqrt(share * (1 - share) / (count + 4)))

    @property
    def frame(self) -> pd.DataFrame:
        """A row for each requirement, those that count first, the most often missed before others.

        ``drawn``: value of the drawing in the SI ``unit``; ``least_slack``: of the machines.
        """
        import pandas as pd

        columns = ("name", "words", "setting", "unit", "limit", "at_least")
        frame = pd.DataFrame(
            [{column: getattr(check, column) for column in columns} for check in self.drawn]
        )
        frame = frame.assign(
            drawn=[check.value for check in self.drawn],
            drawn_slack=[check.slack for check in self.drawn],
            least_slack=self.slacks.min(axis=0),
            missed=self.missed,
            counted=self.counted,
        )
        order = ["counted", "missed", "least_slack"]
        return frame.sort_values(order, ascending=[False, False, True], ignore_index=True)


@dataclass(frozen=True, eq=False)
class MadeMachine(MachineCandidate):
    """A machine as it is made: what each coordinate moves weighs ``shares`` (k,) of the drawing.

    Its static loads are given.
    """

    shares: Array

    def bare_gravity(self, rigid: RigidPoses) -> Array:
        """Gravity torque (1, n, nq) of links, cylinders and four-bars without a load [N m]."""
        torque = np.tensordot(self.shares, _gravity_apart(self.machine.arm, rigid), axes=1)
        return unloaded(self.machine, replace(rigid, gravity_torque=torque))[None]


@lru_cache(maxsize=8)
def _gravity_apart(arm: Arm, rigid: RigidPoses) -> Array:
    """Gravity torque (k, n, k) [N m] of what each coordinate moves before the next."""
    return np.array([body.rigid_poses(rigid.q).gravity_torque for body in arm.bodies_apart])


def acceptance(
    machine: Machine,
    workspace: Workspace,
    widths: Sequence[Width],
    values: Array,
    frequency: tuple[Check, Array],
) -> Acceptance:
    """Acceptance of machines with ``values`` (n, w) of the numbers with widths.

    ``frequency`` is the requirement of the worst frequency, judged on the drawing, and its slacks
    (n,).

    Raises:
        ArmDesignError: a requirement that names what the machine does not have, or asks what
            cannot be.
    """
    reference = reference_of(machine, Requirements.of(machine), CHECKED_POSES)
    as_drawn = np.array([[width.value for width in widths]])
    rows = np.concatenate([as_drawn, values])
    loads = _static_loads(machine, workspace, family_of(machine, tuple(widths), rows))
    judged = [
        list(_evaluated(_made(reference, widths, row), reference, load))
        for row, load in zip(rows, loads, strict=True)
    ]
    slacks = [{each.name: _least(each) for each in one} for one in judged[1:]]
    drawn = tuple(map(Check.of, judged[0]))
    table = [[one.get(check.name, np.inf) for check in drawn] for one in slacks]
    least, of_least = frequency
    return Acceptance((least, *drawn), np.column_stack([of_least, table]))


def _least(evaluation: Evaluation) -> float:
    least = float(evaluation.slack.min())
    return -1.0 if np.isnan(least) else least


def _made(reference: Reference, widths: Sequence[Width], row: Array) -> MadeMachine:
    machine, shares = reference.today, np.ones(len(reference.today.arm.coordinates))
    numbers = {}
    for width, value in zip(widths, row.tolist(), strict=True):
        if width.number is None:
            shares[width.body] = value
        else:
            numbers[width.number.location] = value
    return MadeMachine(Family.of(machine, numbers, 1).members, reference, shares)


def _evaluated(made: MadeMachine, reference: Reference, loads: Array) -> Iterator[Evaluation]:
    return evaluations(made, reference, lambda: loads[None])


def _static_loads(machine: Machine, workspace: Workspace, family: Family) -> Array:
    """Largest push and least force (n, 2, nc) [N, N m] that actuators of a family must hold.

    At the poses where those of the machine itself are largest.
    """
    push = pull = np.zeros((family.count, len(machine.actuators)))
    for case in load_cases(machine, workspace):
        if not case.exists.any():
            continue
        forces, poses = case.evaluate().cylinder_forces, case.workspace.q[case.exists]
        for row in {*forces.argmax(axis=0).tolist(), *forces.argmin(axis=0).tolist()}:
            own = family.at(poses[row], case.machine.payload.name).cylinder_forces
            push, pull = np.fmax(push, own), np.fmin(pull, own)
    return np.stack([push, pull], axis=1)


def acceptance_sheet(judged: Acceptance, units: Units) -> Sheet:
    """Share of machines that meet every requirement, and those missed most often."""
    frame = judged.frame
    counted = frame[frame["counted"]]
    differing = counted[counted["least_slack"] != counted["drawn_slack"]]
    alike, left_out = len(counted) - len(differing), ", ".join(frame["words"][~frame["counted"]])
    rows = []
    for row in differing.head(SHOWN).to_dict("records"):
        values = (_text(row[key], row["unit"], units) for key in ("drawn", "limit"))
        shares = f"{100 * row['missed']:.1f} %", share_text(row["least_slack"])
        rows.append((row["words"], *values, *shares))
    share, error = (f"{100 * part:.1f} %" for part in (judged.share, judged.standard_error))
    exact = f"; not counted, the drawing is exactly at the limit: {left_out}" if left_out else ""
    return Sheet(
        title=(
            "Every requirement that counts is met by"
            f" {share} ± {error} of the first {len(judged.slacks)} machines"
        ),
        columns=("requirement", "as drawn", "limit", "missed by", "least margin"),
        rows=tuple(rows) or (("none differs", "", "", "", ""),),
        note=(
            f"{len(counted)} counted, {alike} of them alike in all machines; shares are of what"
            " the drawing has; least margin: over the limit, of pins within an outline over its"
            " longer side, of clearances, dead lengths and ranges over the stroke; ±: standard"
            " error; static loads at the drawing's"
            f" poses of largest load{exact}; all are in requirements.csv"
        ),
    )


def _text(value: float, unit: str, units: Units) -> str:
    return units.short(value, unit) if unit in units.table else f"{value:.4g} {unit}"
