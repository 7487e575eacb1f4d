"""The worst frequency over all poses and load cases, at the poses of a workspace and between them.

``worst_frequency`` compares only the poses of the workspace; ``refined`` searches from the lowest
of them too, by descents and in oil with air by a population, so it may return a worse pose off the
grid; ``worst_anywhere`` does so for all load cases.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

import numpy as np

from armdesign.arrays import Array, ReadOnly
from armdesign.frequency.cases import CasePoses, in_chunks, load_cases, poses_of
from armdesign.frequency.modes import (
    energy_shares,
    lowest_frequencies,
    lowest_frequency,
    natural_modes,
)
from armdesign.frequency.population import lowest_by_population
from armdesign.frequency.spread import onto_pitch_limit, tipping_joints
from armdesign.frequency.workspace import Workspace
from armdesign.machine.dead_centres import DeadCentre, dead_centre
from armdesign.machine.machine import Machine
from armdesign.machine.room import across, room
from armdesign.mechanism.rigid_poses import RigidPoses
from armdesign.threads import one_blas_thread

STARTS = 4  # local searches per load case
FAR = 1.15  # times the lowest frequency: no search from poses above ends lower (trials: 1.02)
OPEN = 1e3  # [Hz] above all frequencies: where a four-bar is open
Starts: TypeAlias = dict[str, tuple[Array, Array]]


class Worst(NamedTuple):
    """The lowest coupled natural frequency [Hz] of many poses, its load case and pose (nq,)."""

    frequency: float
    payload: str
    q: Array


class Lowest(NamedTuple):
    """The lowest coupled natural frequencies at a workspace's poses, not between them.

    Attributes:
        frequency: at each pose over its load cases (n,) [Hz], inf where none exists.
        worst: the lowest of them.
        starts: of every load case that exists anywhere, poses (m, nq) from which lower ones are
            sought, and their frequencies (m,) [Hz], the first the lowest of all its poses.
    """

    frequency: Array
    worst: Worst
    starts: Starts


@dataclass(frozen=True, eq=False)
class WorstPose(ReadOnly):
    """The pose with the lowest coupled natural frequency [Hz] of a map, on the grid or off it.

    Attributes:
        q: joint positions (nq,) [rad, m].
        payload: name of the load case.
        frequency: lowest coupled natural frequency there [Hz].
        cylinder: the actuator or spring with the largest share of that mode's elastic energy; of
            an unstable pose the cylinder at its ``dead_centre``, if there is one.
        tool: position of the tool (3,) [m].
        joints: names of the coordinates.
        dead_centre: that an unstable pose is next to; None: no such.
    """

    q: Array
    payload: str
    frequency: float
    cylinder: str
    tool: Array
    joints: tuple[str, ...]
    dead_centre: DeadCentre | None = field(default=None, repr=False)


def worst_frequency(
    machine: Machine, workspace: Workspace, payload_share: float = 1.0, link_share: float = 1.0
) -> Worst:
    """The worst frequency among a workspace's poses, not between them, and all load cases.

    Shares of masses as in ``load_cases``.

    Raises:
        PoseError: a pose that this machine cannot take.
    """
    return lowest_of_poses([machine], workspace, payload_share, link_share)[0].worst


def lowest_of_poses(
    machines: Sequence[Machine],
    workspace: Workspace,
    payload_share: float = 1.0,
    link_share: float = 1.0,
) -> list[Lowest]:
    """The lowest frequencies of machines that differ in oil, structure and springs alone.

    What these do not change is computed once. Arguments and errors as of ``worst_frequency``.
    """
    shares = payload_share, link_share
    of_machines = [list(load_cases(machine, workspace, *shares)) for machine in machines]
    first = of_machines[0]
    found: list[list[Array]] = [[] for _ in first]

    def lowest(case: CasePoses, rigid: RigidPoses) -> tuple[int, Array]:
        k = first.index(case)
        poses = poses_of(first, case, rigid)
        others = (poses_of(cases, cases[k], poses) for cases in of_machines[1:])
        return k, lowest_frequencies([poses, *others])

    for _, (k, frequencies) in in_chunks(first, lowest, f"{machines[0].name}: worst frequency"):
        found[k].append(frequencies)
    exist = [k for k, parts in enumerate(found) if parts]
    known = {k: np.concatenate(found[k], axis=1) for k in exist}
    return [_lowest(first, {k: known[k][i] for k in exist}) for i in range(len(machines))]


def _lowest(cases: Sequence[CasePoses], known: Mapping[int, Array]) -> Lowest:
    """Of the frequencies of load cases at their poses, by the index of the load case."""
    workspace = cases[0].workspace
    lowest, whose = np.full(len(workspace), np.inf), np.zeros(len(workspace), dtype=int)
    for k, frequency in known.items():
        indices = cases[k].indices
        lower = frequency < lowest[indices]
        lowest[indices[lower]], whose[indices[lower]] = frequency[lower], k
    worst = int(lowest.argmin())
    at_worst = float(lowest[worst]), cases[whose[worst]].name, workspace.q[worst]
    starts = {cases[k].name: _starts(cases[k], frequency) for k, frequency in known.items()}
    return Lowest(lowest, Worst(*at_worst), starts)


def worst_anywhere(
    machine: Machine,
    workspace: Workspace,
    payload_share: float = 1.0,
    link_share: float = 1.0,
    starts: Starts | None = None,
) -> WorstPose:
    """The worst pose over all load cases, on a workspace's poses and between them.

    Arguments and errors as of ``worst_frequency``; ``starts``: if known, as in ``Lowest``.
    """
    shares = payload_share, link_share
    starts = starts or lowest_of_poses([machine], workspace, *shares)[0].starts
    most = FAR * min(frequencies[0] for _, frequencies in starts.values())
    cases = (case for case in load_cases(machine, workspace, *shares) if case.name in starts)
    near = (case for case in cases if starts[case.name][1][0] <= most)
    worst = (_from_starts(case, *starts[case.name], most) for case in near)
    return min(worst, key=lambda pose: pose.frequency)


def refined(case: CasePoses, frequency: Array) -> WorstPose:
    """The worst pose of a load case, on its poses and between.

    Local searches start from the poses of the lowest ``frequency`` (m,) [Hz].
    """
    return _from_starts(case, *_starts(case, frequency), FAR * float(frequency.min()))


def local_minima(case: CasePoses, frequency: Array, more: Array) -> Iterator[tuple[Array, float]]:
    """Poses (nq,) at which the frequency has a local minimum, with it [Hz].

    Local searches start from the poses of the lowest ``frequency`` (m,) [Hz], and descents from
    ``more`` poses (k, nq).
    """
    yield from _minima(case, _starts(case, frequency)[0])
    yield from _descents(case, more)


def _from_starts(case: CasePoses, starts: Array, frequencies: Array, most: float) -> WorstPose:
    """The worst pose of a load case, sought from starts, the first the lowest known pose.

    But for those whose frequencies (m,) [Hz] are above ``most``.
    """
    known, near = (starts[0], float(frequencies[0])), starts[frequencies <= most]
    return worst_pose(case, *min((known, *_minima(case, near)), key=lambda at: at[1]))


def _minima(case: CasePoses, starts: Array) -> Iterator[tuple[Array, float]]:
    """Local minima by descents from starts; with kinks, also from the lowest of a population."""
    if case.machine.fluid.aerated:
        lowest, frequency = lowest_by_population(case, starts)
        if frequency < np.inf:
            yield lowest, float(lowest_frequency(case.machine.at(case.rigid_at(lowest)))[0])
            starts = np.concatenate([starts, lowest[None]])
    yield from _descents(case, starts)


def _descents(case: CasePoses, starts: Array) -> Iterator[tuple[Array, float]]:
    for start in starts:
        minimum = _descend(case, start)
        if minimum is not None:
            poses = case.machine.at(case.rigid_at(minimum))
            yield minimum, float(lowest_frequency(poses)[0])


def worst_pose(case: CasePoses, q: Array, frequency: float) -> WorstPose:
    """Record of a pose (nq,) with a lowest frequency [Hz]."""
    machine = case.machine
    poses = machine.at(case.rigid_at(q))
    share = energy_shares(poses, natural_modes(poses))[0, 0]
    dead = dead_centre(machine, q) if frequency == 0 else None
    return WorstPose(
        q=q,
        payload=machine.payload.name,
        frequency=frequency,
        cylinder=dead.cylinder if dead else machine.yielding[int(share.argmax())].name,
        tool=poses.tool[0],
        joints=machine.joints,
        dead_centre=dead,
    )


def _starts(case: CasePoses, frequency: Array) -> tuple[Array, Array]:
    """Up to ``STARTS`` of the lowest poses, a fifth of a joint range or more apart.

    Not by joints that change no frequency: such poses are one. And their frequencies [Hz], of
    those of all its poses (m,).
    """
    some, span = lowest_rows(frequency), np.ptp(case.workspace.ranges, axis=1)
    q = case.workspace.q[np.flatnonzero(case.exists)[some]]
    at = np.delete(q / span, list(case.machine.joints_without_effect), axis=1)
    left, chosen = np.arange(len(some)), list[int]()
    while len(left) > 0 and len(chosen) < STARTS:
        chosen.append(int(left[0]))
        left = left[np.abs(at[left] - at[left[0]]).max(axis=1, initial=0.0) > 0.2]
    return q[chosen], frequency[some[chosen]]


def lowest_rows(frequency: Array) -> Array:
    """Rows of the lowest twentieth of frequencies (m,), 200 at least; the lowest first.

    Of equal ones the first comes first, whatever sorts them.
    """
    count = min(max(200, len(frequency) // 20), len(frequency))
    rows = np.flatnonzero(frequency <= np.partition(frequency, count - 1)[count - 1])
    return np.asarray(rows[np.argsort(frequency[rows], kind="stable")[:count]])


@one_blas_thread()
def _descend(case: CasePoses, start: Array) -> Array | None:
    """Local minimum of the lowest frequency (SLSQP); None if it lies outside the workspace.

    Then, or where the search ended higher, the lowest pose within that it came by.
    """
    from scipy.optimize import minimize

    machine, workspace, search = case.machine, case.workspace, _Search(case)
    low, high = workspace.ranges.T
    result = minimize(
        search.value_and_gradient,
        (start - low) / (high - low),
        jac=True,
        bounds=[(0.0, 1.0)] * len(low),
        constraints=[{"type": "ineq", "fun": search.room}] if search.constrained else [],
        method="SLSQP",
        options={"maxiter": 60, "ftol": 1e-10},
    )
    q = _in_workspace(machine, workspace, search.pose(result.x))
    for frequency, x in sorted(search.tried, key=lambda at: at[0]):
        if q is not None and result.fun <= frequency * (1 + 1e-9):
            break
        if search.room(x).min(initial=0.0) >= 0:
            return _in_workspace(machine, workspace, search.pose(x))
    return q


class _Search:
    """The lowest frequency by shares x of the joint ranges, and the room that a pose leaves."""

    def __init__(self, case: CasePoses) -> None:
        self.case, self.machine, self.workspace = case, case.machine, case.workspace
        self.tried = list[tuple[float, Array]]()
        self.constrained = bool(case.machine.payload.limits or across(case.machine))

    def pose(self, x: Array) -> Array:
        """Joint positions (…, nq)."""
        low, high = self.workspace.ranges.T
        return np.asarray(np.clip(low + x * (high - low), low, high))

    def value_and_gradient(self, x: Array) -> tuple[float, Array]:
        """Frequency [Hz], ``OPEN`` where a four-bar is open; no slope beside such poses."""
        nq = len(x)
        ends = np.clip(x + 1e-6 * np.concatenate([np.eye(nq), -np.eye(nq)]), 0.0, 1.0)
        at = self.pose(np.concatenate([x[None], ends]))
        f = lowest_frequency(self.machine.evaluate(self.case.rigid_at(at)))
        slopes = (f[1 : nq + 1] - f[nq + 1 :]) / (ends[:nq] - ends[nq:]).diagonal()
        value = float(np.nan_to_num(f[0], nan=OPEN))
        self.tried.append((value, x.copy()))
        return value, np.nan_to_num(slopes)

    def room(self, x: Array) -> Array:
        """Numbers that are ≥ 0 within strokes and pitch limits."""
        rigid = self.machine.arm.kinematics(self.pose(x)[None])
        left = room(self.workspace.machine, rigid, self.workspace.end_margin)[0]
        if not self.machine.payload.limits:
            return left
        return np.append(left, -self.machine.pitch_excess(rigid, self.machine.payload))


def _in_workspace(machine: Machine, workspace: Workspace, q: Array) -> Array | None:
    """The pose if it lies in the workspace, else None.

    A pose slightly beyond a pitch limit is first moved exactly onto it.
    """
    rigid = machine.arm.kinematics(q[None])
    payload = machine.payload
    if not machine.holds(rigid)[0] and machine.pitch_excess(rigid, payload)[0] < 1e-3:
        moved = [
            onto_pitch_limit(machine, payload, q[None], joint, limit)[1]
            for joint in tipping_joints(machine, payload)
            for limit in payload.limits
        ]
        close = (p for p in np.concatenate(moved) if np.abs(p - q).max() < 2e-3)
        q = next((p for p in close if _in_box(p, workspace)), q)
    if not _in_box(q, workspace) or not machine.holds(q)[0]:
        return None
    # end stops belong to the machine of the workspace, not to this one
    return q if workspace.machine.margins(q).min() >= workspace.end_margin - 1e-9 else None


def _in_box(q: Array, workspace: Workspace) -> bool:
    low, high = workspace.ranges.T
    return bool(np.all((q >= low) & (q <= high)))
