"""Gain schedules: gains between the poses of a bandwidth map, for a controller that follows q."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arguments import checked
from armdesign.arrays import Array, ReadOnly
from armdesign.control.bandwidth_map import BandwidthMap
from armdesign.control.controller import Controller
from armdesign.errors import ArmDesignError, choose
from armdesign.machine.machine import Machine
from armdesign.machine.poses import joint_positions
from armdesign.short_repr import short_repr

if TYPE_CHECKING:
    from armdesign.plots.canvas import Figure

MOST = 4  # joints between which gains are linear; beyond, gains of the nearest pose


@dataclass(frozen=True, eq=False)
class GainSchedule(ReadOnly):
    """Gains of their own for each loop at any pose; call it with q.

    Attributes:
        machine: the machine.
        poses: at which gains are known (n, nq) [rad, m].
        gains: there (n, nq + nc + 1): position gains [1/s], pressure gains [m/s/bar], corner of
            the filters [rad/s].
        of: gains (m, nq + nc + 1) at positions (m, nq) of joints.
        map: the map from which they come.
    """

    __repr__ = short_repr

    machine: Machine
    poses: Array
    gains: Array
    of: Callable[[Array], Array]
    map: BandwidthMap

    def __call__(self, q: ArrayLike) -> Controller:
        """The controllers at poses q (n, nq): linear between the map's poses.

        Beyond them the gains of the nearest pose.

        Raises:
            PoseError: they are no joint positions.
        """
        gains, nq = self.of(joint_positions(self.machine, q)), len(self.machine.joints)
        return Controller(
            position=gains[:, :nq],
            pressure=gains[:, nq:-1],
            corner=gains[:, -1],
            filter=self.map.options.filter,
        )

    def plot(self) -> Figure:
        """Figure of the position gain of each loop over the joints."""
        from armdesign import plots

        return plots.gain_schedule(self)


@checked
def gain_schedule(
    bandwidths: BandwidthMap, payload: str | None = None, *, feedback: bool = True
) -> GainSchedule:
    """The gains of a bandwidth map, interpolated over the joints.

    They keep the map's margin at its poses, under the load case that is named. Between the poses
    and under other load cases they keep less of it: on the 20 t machine with 20 ms of delay three
    quarters between the poses of 6 × 7 × 8, and half of it, at the least, where no load case is
    named. A controller that knows its load takes the gains of that load case.

    Args:
        bandwidths: the map.
        payload: the load case whose gains are taken; None: at each pose the gains of the load case
            with the smallest position gains.
        feedback: of load pressures, beside position loops; False: of position loops alone.

    Raises:
        ArmDesignError: no such load case, or no pose at which it can be controlled.

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> workspace = ad.Workspace.grid(machine, points=3)
        >>> bandwidths = ad.bandwidth_map(machine, workspace, damping=0.02)
        >>> schedule = ad.gain_schedule(bandwidths)
        >>> print(schedule([[0.0], [0.2]]).position.round(0).tolist())
        [[15.0], [17.0]]
    """
    machine, table = bandwidths.machine, bandwidths.schedule
    cases = list(dict.fromkeys(bandwidths.frame["payload"]))
    if payload is not None:
        if payload not in cases:
            fault = "is no load case of the map"
            raise ArmDesignError(f"payload {payload}", fault, choose(payload, cases))
        table = table[table["payload"] == payload]
    gain = "gain" if feedback else "gain_without_feedback"
    names = [f"{joint}_{gain}_per_s" for joint in machine.joints]
    names += [f"{one.name}_pressure_gain_m_per_s_bar" for one in machine.actuators]
    table = table[table[names[0]] > 0]
    if table.empty:
        fault = "no gains keep the margin at any pose"
        raise ArmDesignError(f"{machine.name}: gains", fault, "ask for a smaller margin")
    least = table[names[: len(machine.joints)]].min(axis=1)
    keys = [table[joint].round(9) for joint in machine.joints]
    table = table.loc[least.groupby(keys).idxmin().to_numpy()]
    poses = table[list(machine.joints)].to_numpy()
    gains = table[[*names, "corner_rad_per_s"]].to_numpy(copy=True)
    if not feedback:
        gains[:, len(machine.joints) : -1] = 0.0
    moving = [j for j in range(len(machine.joints)) if np.ptp(poses[:, j]) > 0]
    of = _interpolated(poses[:, moving], gains, moving)
    return GainSchedule(machine, poses, gains, of, bandwidths)


def _interpolated(poses: Array, gains: Array, moving: list[int]) -> Callable[[Array], Array]:
    """Gains (m, …) as a function of poses (m, nq), of which the ``moving`` joints count."""
    from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator

    if len(moving) == 0:
        return lambda q: np.tile(gains[:1], (len(q), 1))
    if len(moving) == 1:
        order = poses[:, 0].argsort()
        at, known = poses[order, 0], gains[order].T
        return lambda q: np.stack([np.interp(q[:, moving[0]], at, one) for one in known], axis=1)
    nearest = NearestNDInterpolator(poses, gains, rescale=True)
    if len(moving) > MOST or len(poses) <= 2 ** len(moving):
        return lambda q: np.asarray(nearest(q[:, moving]))
    linear = LinearNDInterpolator(poses, gains, rescale=True)

    def both(q: Array) -> Array:
        between = linear(q[:, moving])
        return np.where(np.isfinite(between), between, nearest(q[:, moving]))

    return both
