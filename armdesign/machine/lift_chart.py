"""The lift chart (ISO 10567): what a machine lifts at the points of a grid of reach and height.

A point of the arm stands on the grid by two joints, all others at the middle of their range. Of
several poses that bring it to a place that counts in which the machine lifts most. The hydraulic
capacity is from ``lifting.py``; where the file has ``[stability]``, the lower of it and 75 % of
what tips the machine. With one joint alone the heights are the grid's, and each pose has
its own reach.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arguments import checked
from armdesign.arrays import Array, ReadOnly, mesh
from armdesign.errors import MachineFileError
from armdesign.machine.file.schema import LiftChartSection
from armdesign.machine.lifting import liftable_masses, torque_per_mass
from armdesign.machine.machine import Machine
from armdesign.machine.poses import is_singular
from armdesign.machine.reaching import lattice, place_and_slopes, poses_reaching
from armdesign.machine.tipping import tipping_masses
from armdesign.mechanism.linkage.base import Pin, moment_arms
from armdesign.mechanism.rigid_poses import RigidPoses
from armdesign.mechanism.slews import is_upright
from armdesign.short_repr import short_repr
from armdesign.units import mm

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.plots.canvas import Axes

HYDRAULIC_SHARE, TIPPING_SHARE = 0.87, 0.75  # ISO 10567
TIPPING = "tipping"
STEPS = 6  # in the reach of the tool, about
FEW, FINER = 6, 3  # places below which a default grid is made finer, and how often at most
ROUND = (1.0, 1.5, 2.0, 3.0, 5.0, 10.0)  # times a power of ten
MOST = 2_000  # places of a grid
RANDOM = 64  # poses at which it is looked which joints raise the point


@dataclass(frozen=True, eq=False, kw_only=True)
class ChartPoses(ReadOnly):
    """All m poses that bring the point to one of the n places of its grid.

    Attributes:
        point: that carries the load.
        step: of the grid [m].
        start: least reach of the grid [m].
        others_at: where the joints stand that do not bring it there (nq,) [rad, m].
        places: reach and height (n, 2) [m].
        place: index of the place of each pose (m,), ascending.
        rigid: the poses (m).
        arms: moment arms of the drives (m, nc, k) [m/rad].
        torque: of a kilogram at the point (m, nq) [N m/kg].
    """

    point: Pin
    step: float
    start: float
    others_at: Array
    places: Array
    place: Array
    rigid: RigidPoses
    arms: Array
    torque: Array

    def best(self, least: Array) -> Array:
        """Index of the pose of each place (…, n) at which ``least`` (…, m) is greatest."""
        order = np.lexsort(np.stack([least, np.broadcast_to(self.place, least.shape)]), axis=-1)
        last = np.searchsorted(self.place, np.arange(len(self.places)), side="right") - 1
        return np.asarray(order[..., last])


@dataclass(frozen=True, eq=False, kw_only=True)
class LiftChart(ReadOnly):
    """Lift of a machine at n points (ISO 10567); arrays are read-only.

    Attributes:
        machine: that lifts.
        poses: the grid, and all poses on it.
        reach: of the points from the root's vertical axis (n,) [m].
        height: over the root (n,) [m].
        capacity: lower of both that follow (n,) [kg], 0 where it lifts nothing.
        hydraulic: 87 % of the actuators' force less the arm's own weight (n,) [kg].
        tipping: 75 % of what tips it (n,) [kg]; inf where nothing does.
        limiting: name of the actuator that limits it, or "tipping" (n,).
        q: its poses (n, nq) [rad, m].
    """

    __repr__ = short_repr

    machine: Machine
    poses: ChartPoses
    reach: Array
    height: Array
    capacity: Array
    hydraulic: Array
    tipping: Array
    limiting: tuple[str, ...]
    q: Array

    @property
    def columns(self) -> dict[str, Array]:
        """Of each point by name: place [m], capacities [kg], what limits, joints [rad, m].

        Hydraulic and tipping capacity stand apart where the file has ``[stability]``.
        """
        columns = {"reach_m": self.reach, "height_m": self.height, "capacity_kg": self.capacity}
        if self.machine.section.stability is not None:
            columns |= {"hydraulic_kg": self.hydraulic, "tipping_kg": self.tipping}
        columns |= {"limiting": np.array(self.limiting, dtype=object)}
        return columns | dict(zip(self.machine.joints, self.q.T, strict=True))

    @cached_property
    def frame(self) -> pd.DataFrame:
        """The columns as a frame of pandas, a row for each point."""
        import pandas as pd

        return pd.DataFrame(self.columns)

    def plot(self, ax: Axes | None = None) -> Axes:
        """The chart as a picture; returns the axes."""
        from armdesign import plots

        return plots.lift_chart(self, ax)


@checked
def lift_chart(machine: Machine, like: LiftChart | None = None) -> LiftChart:
    """The lift chart of a machine.

    Args:
        machine: its table ``[lift_chart]`` says which point, joints and grid, where the defaults
            do not serve; the load case at work does not count.
        like: another machine's chart, whose grid and joints at rest it takes where it has them.

    Raises:
        ArmDesignError: no point of the grid is within reach, or a joint that does not move it.

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> chart = ad.lift_chart(machine)
        >>> print(chart.capacity.min().round(), chart.limiting[0])
        412.0 lift
    """
    poses = chart_poses(machine, like)
    masses = liftable_masses(machine, poses.rigid, poses.arms, poses.torque, HYDRAULIC_SHARE)
    at = machine.arm.point(poses.rigid, poses.point.link, np.array(poses.point.at))
    ahead = machine.heading.ahead(poses.rigid.q, at)
    tipping = TIPPING_SHARE * tipping_masses(machine, poses.rigid, ahead)
    least = np.minimum(masses.min(axis=1), tipping)
    best = poses.best(least)
    hydraulic, tipping = masses[best].min(axis=1), tipping[best]
    names = [actuator.name for actuator in machine.actuators]
    weakest = masses[best].argmin(axis=1)
    limiting = np.where(tipping < hydraulic, TIPPING, np.array(names)[weakest])
    return LiftChart(
        machine=machine,
        poses=poses,
        reach=poses.places[:, 0],
        height=poses.places[:, 1],
        capacity=np.maximum(least[best], 0.0),
        hydraulic=np.maximum(hydraulic, 0.0),
        tipping=tipping,
        limiting=tuple(map(str, limiting)),
        q=poses.rigid.q[best],
    )


def lift_chart_if_any(machine: Machine, like: LiftChart | None = None) -> LiftChart | None:
    """As ``lift_chart``; None without a point on the default grid, or on the grid of ``like``.

    Raises:
        MachineFileError: as ``lift_chart``, where the file has the table.
    """
    try:
        return lift_chart(machine, like)
    except MachineFileError:
        if machine.section.lift_chart is not None and like is None:
            raise
        return None


@lru_cache(maxsize=16)
def chart_poses(machine: Machine, like: LiftChart | None = None) -> ChartPoses:
    """The grid of a machine's lift chart and all poses on it; see ``lift_chart``."""
    section = machine.section.lift_chart or LiftChartSection()
    point, joints = _point_and_joints(machine, section)
    steps = (section.step_m,) if section.step_m else _round_steps(machine)
    grids = [(step, 2 * step if section.from_m is None else section.from_m) for step in steps]
    others_at = machine.ranges.mean(axis=1)
    if like is not None:
        grids = [(like.poses.step, like.poses.start)]
        if like.machine.joints == machine.joints:
            others_at = np.clip(like.poses.others_at, *machine.ranges.T)
    for step, start in grids:
        q, which, places = _on_grid(machine, point, joints, others_at, (step, start))
        rigid = machine.rigid_poses(q)
        arms = moment_arms(machine.drives, rigid)
        held = ~is_singular(arms[..., : len(machine.joints)])
        if len(np.unique(which[held])) >= FEW:
            break
    if not held.any():
        raise _out_of_reach(machine, point, (joints, others_at), grids[0])
    used, place = np.unique(which[held], return_inverse=True)
    return ChartPoses(
        point=point,
        step=step,
        start=start,
        others_at=others_at,
        places=places[used],
        place=place,
        rigid=rigid[held],
        arms=arms[held],
        torque=torque_per_mass(machine, rigid[held], point),
    )


def _on_grid(
    machine: Machine,
    point: Pin,
    joints: tuple[int, ...],
    others_at: Array,
    grid: tuple[float, float],
) -> tuple[Array, Array, Array]:
    """Poses (m, nq) on the grid of a step from a reach, index of their place, places (n, 2)."""
    step, start = grid
    image, _ = place_and_slopes(machine, point, joints, lattice(machine, joints, others_at))
    (_, lowest), (furthest, highest) = image.min(axis=0) - step, image.max(axis=0) + step
    heights = step * np.arange(math.ceil(lowest / step), math.floor(highest / step) + 1)
    if len(joints) == 1:
        q, which = poses_reaching(machine, point, joints, others_at, heights[:, None])
        reach = place_and_slopes(machine, point, joints, q)[0][:, 0].round(9)
        q, reached = q[reach >= start], np.column_stack([reach, heights[which]])[reach >= start]
        places, which = np.unique(reached, axis=0, return_inverse=True)
        order = np.argsort(which.ravel(), kind="stable")
        return q[order], which.ravel()[order], places
    reaches = start + step * np.arange(max(math.floor((furthest - start) / step) + 1, 0))
    if len(reaches) * len(heights) > MOST:
        size = f"{len(reaches)} × {len(heights)} places, more than {MOST}"
        raise _fault(machine, "step_m", f"{step:g} m makes {size}", "give a larger step_m")
    places = mesh((reaches, heights))
    return *poses_reaching(machine, point, joints, others_at, places), places


def _point_and_joints(machine: Machine, section: LiftChartSection) -> tuple[Pin, tuple[int, ...]]:
    """The point that carries the load, and the one or two joints that bring it to its place.

    By default the pin that carries the tool's link, if two joints raise it, or the tool; and of
    the joints that raise the point, the first two from the root, slewing apart.
    """
    tool, x = machine.tool, section.at_mm or (0.0, 0.0, 0.0)
    if section.link or section.at_mm:
        point = Pin(link=section.link or tool.link, at=(x[0] * mm, x[1] * mm, x[2] * mm))
    else:
        body = machine.arm.links[tool.link]
        at = -body.rotation.T @ body.translation
        point = Pin(link=tool.link, at=(float(at[0]), float(at[1]), float(at[2])))
        turns = body.joint >= 0 and machine.arm.coordinates[body.joint].revolute
        if not turns or len(_usual(machine, _raising(machine, point))) < 2:
            point = tool
    raising = _raising(machine, point)
    if section.joints is None:
        joints = _usual(machine, raising)[:2]
    else:
        joints = tuple(machine.joints.index(name) for name in section.joints)
    names = ", ".join(machine.joints[j] for j in raising) or "none"
    if len(joints) > 2:
        fault = f"{len(joints)} joints, but two bring a point to a reach and a height"
        remedy = f"others stand at the middle of their range: choose at most two of: {names}"
        raise _fault(machine, "joints", fault, remedy)
    for j in joints:
        if j not in raising:
            fault = f'"{machine.joints[j]}" does not raise the point on the {point.link}'
            raise _fault(machine, "joints", fault, f"choose from: {names}")
    if not joints:
        fault = f"no joint raises the point on the {point.link}"
        raise _fault(machine, "link", fault, "give link and at_mm of a point that joints raise")
    return point, joints


def _raising(machine: Machine, point: Pin) -> tuple[int, ...]:
    """Joints of q that move the height of a point, from the root out."""
    low, high = machine.ranges.T
    q = np.random.default_rng(0).uniform(low, high, (RANDOM, len(low)))
    joints = tuple(j for j in machine.arm.chain(point.link) if j < len(machine.joints))
    slope = place_and_slopes(machine, point, joints, q)[1][:, 1]
    most = np.abs(slope).max(axis=0, initial=0.0)
    return tuple(j for j, size in zip(joints, most, strict=True) if size > 1e-9)


def _usual(machine: Machine, raising: tuple[int, ...]) -> tuple[int, ...]:
    """Of joints that raise a point those that do not slew, or all where there are no others.

    A joint slews about an upright axis, as on a base that is not level.
    """
    axes = machine.arm.kinematics(machine.ranges.mean(axis=1)[None]).axis[0]
    return tuple(j for j in raising if not is_upright(machine.arm.joints[j], axes[j])) or raising


def _round_steps(machine: Machine) -> tuple[float, ...]:
    """A round number [m] near a sixth of the tool's largest reach, each joint in turn; finer ones.

    These are for a range of the tool so narrow that hardly a place of the first lies in it.
    """
    q, joints = machine.ranges.mean(axis=1), range(len(machine.joints))
    for j in (*joints, *joints, *joints):
        poses = lattice(machine, (j,), q)
        place, _ = place_and_slopes(machine, machine.tool, (j,), poses)
        q = poses[place[:, 0].argmax()]
    sixth = float(place[:, 0].max()) / STEPS
    power = 10.0 ** math.floor(math.log10(max(sixth, 1e-3)))
    sizes = [float(f"{scale * n:g}") for scale in (power / 10, power) for n in ROUND]
    sizes = sorted(set(sizes))
    first = min(range(len(sizes)), key=lambda k: abs(sizes[k] - sixth))
    return tuple(sizes[max(first - FINER, 0) : first + 1][::-1])


def _fault(machine: Machine, key: str, fault: str, remedy: str) -> MachineFileError:
    """A fault of the chart's table, or of the machine where it has none."""
    path = f"lift_chart.{key}"
    if machine.section.lift_chart is None:
        return MachineFileError(f"{machine.source.name}: lift_chart", fault, remedy)
    return MachineFileError(f"{machine.source.name}: {path}", fault, remedy, machine.line_of(path))


def _out_of_reach(
    machine: Machine, point: Pin, moved: tuple[tuple[int, ...], Array], grid: tuple[float, float]
) -> MachineFileError:
    """The fault of a grid of which the point reaches no place, at the key that states the grid.

    ``moved`` are the joints that bring it there, and where the others stand.
    """
    (joints, others_at), (step, start) = moved, grid
    image, _ = place_and_slopes(machine, point, joints, lattice(machine, joints, others_at))
    least, most = image[:, 0].min(), image[:, 0].max()
    x, _, z = (round(coordinate / mm, 1) + 0.0 for coordinate in point.at)
    where = f"the point on the {point.link} (x {x:g}, z {z:g} mm)"
    section = machine.section.lift_chart or LiftChartSection()
    stated = [key for key in ("from_m", "step_m") if getattr(section, key) is not None]
    fault = f"steps of {step:g} m from a reach of {start:g} m on: none meets {where}"
    if start > most:
        fault = f"the chart begins at a reach of {start:g} m, beyond that of {where}"
    span = f"{least:.3g} to {most:.3g} m"
    remedy = f"it reaches from {span}: give from_m and step_m within that, or another point"
    if most < 0:
        fault, remedy = f"{where} is behind, at {span}", "give link and at_mm of a point ahead"
    return _fault(machine, (stated or ["link"])[0], fault, remedy)
