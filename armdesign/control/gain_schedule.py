"""Gain schedules: gains between the poses of a bandwidth map, for a controller that follows q."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arguments import checked
from armdesign.arrays import Array, ReadOnly
from armdesign.control.bandwidth_map import BandwidthMap, pressure_gain_column
from armdesign.control.controller import Controller
from armdesign.errors import ArmDesignError, choose
from armdesign.machine.machine import Machine
from armdesign.machine.poses import joint_positions
from armdesign.short_repr import short_repr

if TYPE_CHECKING:
    from armdesign.plots.canvas import Figure

MOST = 4  # joints between which gains are linear; of more, gains of the nearest pose
STILL = 1e-8  # [rad, m] by which a joint that stands still differs, as tables are rounded
FLAT = 1e-3  # of the joints' ranges, by which poses are beside a line or plane
CLOSE = 1e-12  # of these ranges, beyond the hull: as near as floats come
NEARER = 10  # times that a way to the hull is sought anew from its end
INSIDE = 1 - 1e-9  # of the way from the middle of the poses to their hull, so that it is inside


@dataclass(frozen=True, eq=False)
class GainSchedule(ReadOnly):
    """Gains of their own for each loop at any pose; call it with q.

    Attributes:
        machine: the machine.
        poses: at which gains are known (n, nq) [rad, m].
        gains: there (n, nq + nc + 1): position gains [1/s], pressure gains [m/s/bar, of a
            motor rad/s/bar], corner of the filters [rad/s].
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
        """The controllers at poses q (n, nq): linear between the map's poses, up to four joints.

        Beyond their hull those of its nearest place; of more joints, those of the nearest pose.

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
    names += [pressure_gain_column(one) for one in machine.actuators]
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
    return GainSchedule(machine, poses, gains, _Between.of(poses, gains), bandwidths)


@dataclass(frozen=True, eq=False)
class _Between:
    """Gains at any pose from those at some: linear between these, at their nearest place beyond.

    That place is on the hull of the poses, distances by shares of their ranges, so that gains leap
    nowhere. Where the poses are on a line or plane of joint space, others have the gains of their
    foot on it.
    """

    moving: Array  # indices of the joints that differ
    low: Array  # their lowest positions,
    span: Array  # and the ranges between these and the highest
    middle: Array  # of all poses, in shares of these ranges
    along: Array  # directions in which they differ (joints, k)
    linear: Callable[[Array], Array]  # gains at places (m, k) along these
    nearest: Callable[[Array], Array]
    planes: Array  # of the hull, normals and offsets (p, k + 1)

    @classmethod
    def of(cls, poses: Array, gains: Array) -> _Between:
        from scipy.interpolate import LinearNDInterpolator, NearestNDInterpolator
        from scipy.spatial import ConvexHull

        moving = np.flatnonzero(np.ptp(poses, axis=0) > STILL)
        low, span = poses[:, moving].min(axis=0), np.ptp(poses[:, moving], axis=0)
        shares = (poses[:, moving] - low) / span
        middle = shares.mean(axis=0)
        _, sizes, along = np.linalg.svd(shares - middle, full_matrices=False)
        differ = sizes > FLAT * np.sqrt(len(poses))
        along = np.eye(len(moving)) if differ.sum() == len(moving) else along[differ].T
        places = (shares - middle) @ along
        nearest: Callable[[Array], Array]
        k = along.shape[1]
        if k == 0:
            nearest = partial(_first, gains)
        elif k == 1:
            order = places[:, 0].argsort()
            nearest = partial(_on_line, places[order, 0], gains[order])
        else:
            nearest = NearestNDInterpolator(places, gains)
        linear, planes = nearest, np.empty((0, k + 1))
        if 1 < k <= MOST:
            linear = LinearNDInterpolator(places, gains)
            planes = np.unique(ConvexHull(places).equations.round(12), axis=0)
        return cls(moving, low, span, middle, along, linear, nearest, planes)

    def __call__(self, q: Array) -> Array:
        """Gains (m, …) at joint positions (m, nq)."""
        places = ((q[:, self.moving] - self.low) / self.span - self.middle) @ self.along
        beyond = np.flatnonzero((self._above(places) > 0).any(axis=1))
        for row in beyond:
            places[row] = INSIDE * self._on_hull(places[row])
        gains = self.linear(places)
        unknown = np.isnan(gains).any(axis=1)
        gains[unknown] = self.nearest(places[unknown])
        return gains

    def _above(self, places: Array) -> Array:
        """How far places (…, k) are above each plane (…, p); inside the hull below all."""
        return np.asarray(places @ self.planes[:, :-1].T + self.planes[:, -1])

    def _on_hull(self, place: Array) -> Array:
        """The place (k,) on the hull nearest to one beyond it.

        By least distance programming (Lawson and Hanson 1974), in units of the way, so that it is
        as exact from afar.
        """
        from scipy.optimize import nnls

        for _ in range(NEARER):
            above = self._above(place)
            if (size := above.max()) <= CLOSE:
                break
            rows = np.column_stack([-self.planes[:, :-1], above / size]).T
            goal = np.eye(len(rows))[-1]
            left = rows @ nnls(rows, goal)[0] - goal
            place = place - size * left[:-1] / left[-1]
        return place


def _first(gains: Array, places: Array) -> Array:
    return np.tile(gains[:1], (len(places), 1))


def _on_line(known: Array, gains: Array, places: Array) -> Array:
    return np.stack([np.interp(places[:, 0], known, one) for one in gains.T], axis=1)
