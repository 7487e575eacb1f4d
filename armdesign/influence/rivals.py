"""The worst pose and its rivals: local minima of the frequency that could become the worst."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.errors import ArmDesignError
from armdesign.frequency.cases import CasePoses, in_chunks, load_cases, poses_of, refuse_missing
from armdesign.frequency.modes import lowest_frequency, natural_modes
from armdesign.frequency.population import at_random, lowest_apart
from armdesign.frequency.workspace import Workspace
from armdesign.frequency.worst_frequency import FAR, WorstPose, local_minima, worst_pose
from armdesign.influence.compass_search import lowest_at, lowest_near
from armdesign.influence.ends import REACHED, Ends, all_ends, endless, ends_at
from armdesign.influence.family import Family
from armdesign.machine.machine import Machine
from armdesign.mechanism.rigid_poses import RigidPoses

WITHIN = 0.25  # of the worst frequency: poses so near to it are its rivals
APART = 0.02  # of a joint's range: poses nearer than this are one
MOST = 8  # rivals, the worst pose with them
TRIED, TRIED_APART = 100, 0.2  # poses from which they are sought, over the joints' ranges
STARTS = 16  # of them from which every member of a family seeks
LOWER = 1e-4  # of a frequency, by which another must be lower: as near as searches end
LOOKED_AT = 1000  # poses of a workspace, by chance, and between them, that every member takes


@dataclass(frozen=True, eq=False)
class Rival:
    """A local minimum of the lowest frequency over the poses of one load case.

    Attributes:
        pose: where it is, and how low.
        next_frequency: of the second mode there [Hz]; inf where there is one mode alone.
        ends: end stops, joint limits and pitch limits that hold the pose.
    """

    pose: WorstPose
    next_frequency: float
    ends: Ends

    @property
    def frequency(self) -> float:
        """Lowest natural frequency [Hz]."""
        return self.pose.frequency

    def of(self, other: Machine) -> Rival:
        """The rival with the ends of another machine, which touches the same ones."""
        margins = (one.section.requirements.end_margin for one in (self.ends.machine, other))
        margin = self.ends.end_margin - next(margins) + next(margins)
        loaded = other.with_payload(self.pose.payload)
        return replace(self, ends=replace(self.ends, machine=loaded, end_margin=margin))

    def is_new(self, workspace: Workspace, known: Sequence[Rival]) -> bool:
        """Whether no known rival of its load case is at its pose and follows the same ends."""
        like = [
            one.pose.q
            for one in known
            if (one.pose.payload, one.ends.ends) == (self.pose.payload, self.ends.ends)
        ]
        return not _near(workspace, self.pose.q, np.array(like)).any()

    def frequencies(self, family: Family) -> Array:
        """Lowest frequency (n,) [Hz] of a family's members, at poses that follow their ends."""
        return self._at(family, self._followed(family))

    def within_ends(self, family: Family) -> Array:
        """Lowest frequency (n,) [Hz] at poses that follow their ends, or are sought near them.

        The latter where another end comes before theirs, as a stroke's before a joint's limit;
        inf where no pose in stroke is found.
        """
        every = replace(self.ends, ends=all_ends(self.ends.machine))
        at = self._followed(family)
        values = self._at(family, at)
        with np.errstate(invalid="ignore"):
            room = every.room(family, np.broadcast_to(at, (family.count, at.shape[-1])))
        beyond = np.flatnonzero((room < -REACHED).any(axis=1))
        if len(beyond):
            values[beyond] = np.nan_to_num(self.lowest_near(family.some(beyond)), nan=np.inf)
        return values

    def at(self, q: Array) -> Rival:
        """The rival at another pose (nq,), or each member of its families at its own (n, nq)."""
        return replace(self, pose=replace(self.pose, q=q))

    def _followed(self, family: Family) -> Array:
        """Its pose as it follows its ends (n, nq); the pose itself (nq,) where none holds it."""
        return self.ends.follow(family, self.pose.q) if self.ends.ends else self.pose.q

    def _at(self, family: Family, q: Array) -> Array:
        """Lowest frequency (n,) [Hz] of a family's members at poses (n, nq) or at one (nq,)."""
        return lowest_frequency(family.at(q, self.pose.payload))

    def lowest_near(self, family: Family) -> Array:
        """Lowest frequency (n,) [Hz] of a family's members near its pose, wherever that is.

        NaN where no such pose is in stroke.
        """
        return lowest_near(family, self.ends, self.pose.q)[0]


def rivals(machine: Machine, workspace: Workspace, within: float = WITHIN) -> tuple[Rival, ...]:
    """The worst pose of a machine, and after it its rivals, from the lowest up.

    Args:
        machine: the machine.
        workspace: the poses from which local minima are looked for.
        within: share of the worst frequency by which a rival may lie above it.

    Raises:
        ArmDesignError: a load case exists at no pose, or the machine is unstable at its worst
            pose, where no derivative exists.
    """
    cases = list(load_cases(machine, workspace))
    refuse_missing(cases)
    parts: dict[CasePoses, list[Array]] = {case: [] for case in cases}

    def lowest(case: CasePoses, rigid: RigidPoses) -> Array:
        return lowest_frequency(poses_of(cases, case, rigid))

    for case, frequencies in in_chunks(cases, lowest, f"{machine.name}: worst pose"):
        parts[case].append(frequencies)
    minima = [
        (case, q, value)
        for case, values in parts.items()
        for q, value in _minima(case, np.concatenate(values), within)
    ]
    minima.sort(key=lambda minimum: minimum[2])
    least = minima[0][2]
    if least <= 0:
        raise ArmDesignError(
            machine.name,
            "is unstable at its worst pose: its frequency is 0 there and has no derivative",
            "look at armdesign map first",
        )
    near = [minimum for minimum in minima if minimum[2] <= (1 + within) * least]
    return tuple(_rival(*minimum) for minimum in _apart(workspace, near)[:MOST])


def lowest_anywhere(family: Family, workspace: Workspace) -> Array:
    """Lowest frequency (n,) [Hz] of a family's members over a workspace and all load cases.

    Sought by every member from the lowest of some poses, whatever the rivals of the machine are;
    with air that the machine has not also from those far above, as valleys beside kinks are
    narrow. NaN where none leads into the stroke.
    """
    machine, span = family.machine, np.ptp(workspace.ranges, axis=1)
    random, looks = np.random.default_rng(0), []
    for case in load_cases(machine, workspace):
        q = workspace.q[random.permutation(case.indices)[:LOOKED_AT]]
        shares = at_random(np.zeros(len(span)), span > 0, LOOKED_AT, random)
        q = np.concatenate([q, workspace.ranges[:, 0] + shares * span])
        ends = Ends(case.machine, workspace.end_margin, (), np.zeros(0))
        looks.append((ends, q, lowest_at(family, ends, q)))
    least = np.fmin.reduce(np.concatenate([values for *_, values in looks], axis=1), axis=1)
    kinks = (np.broadcast_to(family.members.fluid.air, family.count) > 0) & (
        machine.fluid.air == 0
    )
    most = np.where(kinks, np.inf, FAR * least)
    lowest = np.full(family.count, np.nan)
    for ends, q, values in looks:
        shares = np.delete(q / _spans(workspace), list(machine.joints_without_effect), axis=1)
        each = zip(values, most, strict=True)
        starts = [_starts(shares, value, top)[:STARTS] for value, top in each]
        members = np.repeat(np.arange(family.count), [len(rows) for rows in starts])
        found, _ = lowest_near(family.some(members), ends, q[np.concatenate(starts)])
        np.fmin.at(lowest, members, found)
    return lowest


def _starts(shares: Array, frequency: Array, most: float) -> Array:
    """Indices of the lowest poses, by shares of the joints' ranges, that are apart."""
    near = np.flatnonzero(frequency <= most)
    return near[lowest_apart(shares[near], frequency[near], TRIED_APART)[:TRIED]]


def _spans(workspace: Workspace) -> Array:
    """Ranges of the joints (nq,) [rad, m]; 1 where there is none."""
    ranges = np.ptp(workspace.ranges, axis=1)
    return np.where(ranges > 0, ranges, 1.0)


def _minima(case: CasePoses, frequency: Array, within: float) -> list[tuple[Array, float]]:
    q = case.workspace.q[case.exists]
    lowest = q[frequency.argmin()], float(frequency.min())
    return [*local_minima(case, frequency, _sought(case, q, frequency, within)), lowest]


def _sought(case: CasePoses, q: Array, frequency: Array, within: float) -> Array:
    """Poses (m, nq) apart at which searches end that start all over the poses near the lowest.

    Kinks are narrow: no pose of a coarse grid need be lowest among its neighbours beside one.
    """
    machine, workspace = case.machine, case.workspace
    starts = q[_starts(q / _spans(workspace), frequency, (1 + within) * frequency.min())]
    ends = Ends(machine, workspace.end_margin, (), np.zeros(0))
    values, at = lowest_near(Family.of(machine, {}, len(starts)), ends, starts)
    order = [k for k in np.argsort(values) if np.isfinite(values[k])]
    found = _apart(workspace, [(case, at[k], float(values[k])) for k in order])
    return np.array([pose for _, pose, _ in found[:MOST]]).reshape(-1, q.shape[1])


def _apart(
    workspace: Workspace, minima: list[tuple[CasePoses, Array, float]]
) -> list[tuple[CasePoses, Array, float]]:
    """Minima of which no two are one, the lower kept."""
    kept: list[tuple[CasePoses, Array, float]] = []
    for case, q, value in minima:
        known = np.array([other for one, other, _ in kept if one is case])
        if not _near(workspace, q, known).any():
            kept.append((case, q, value))
    return kept


def _near(workspace: Workspace, q: Array, others: Array) -> Flags:
    """Whether a pose (nq,) and others (n, nq) are one (n,)."""
    machine = workspace.machine
    unfelt, turns = list(machine.joints_without_effect), 2 * np.pi * endless(machine)
    by = np.abs(q - np.reshape(others, (-1, len(q))))
    away = np.minimum(by, np.abs(turns - by)) / np.ptp(workspace.ranges, axis=1)
    return np.asarray(np.delete(away, unfelt, axis=1).max(axis=1, initial=0.0) <= APART)


def _rival(case: CasePoses, q: Array, value: float) -> Rival:
    machine = case.machine

    def frequency(at: Array) -> Array:
        return lowest_frequency(machine.evaluate(machine.rigid_poses(at)))

    modes = natural_modes(machine.at(q)).frequencies[0]
    return Rival(
        pose=worst_pose(case, q, value),
        next_frequency=float(modes[1]) if len(modes) > 1 else np.inf,
        ends=ends_at(machine, case.workspace, q, frequency),
    )
