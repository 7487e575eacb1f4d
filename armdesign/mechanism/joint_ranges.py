"""Joint ranges: what the strokes allow, cut by the URDF's limits."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from armdesign.arrays import Array, Flags
from armdesign.errors import MachineFileError
from armdesign.hydraulics.actuator import Cylinder
from armdesign.mechanism.arm import Arm, RigidPoses
from armdesign.mechanism.linkage.base import Linkage

SAMPLES = 721


def joint_ranges(
    arm: Arm,
    linkages: tuple[Linkage, ...],
    cylinders: tuple[Cylinder, ...],
    end_margin: float,
    source: str,
) -> Array:
    """Ranges (nq, 2) [rad, m] in which every cylinder that moves one joint alone keeps ``end_margin`` of its stroke.

    A cylinder across several joints couples their ranges: it is left to ``Machine.margins``. Ends
    are exact.

    Raises:
        MachineFileError: no such range, or within it a dead centre or a four-bar that opens.
    """
    ranges = arm.limits.copy()
    for j in range(len(arm.joints)):
        own = [(k, c) for k, c in zip(linkages, cylinders, strict=True) if k.joints == (j,)]
        if own:
            ranges[j] = _range_of(arm, j, own, end_margin, source)
    return ranges


def over(ends: Array, count: int) -> Array:
    """``count`` even values from one end of a range to the other, both included."""
    return np.linspace(float(ends[0]), float(ends[1]), count)


def sweep(arm: Arm, joint: int, values: Array) -> RigidPoses:
    """Placements with one joint at ``values`` (n,), the others at the middle of their limits."""
    q = np.tile(arm.limits.mean(axis=1), (len(values), 1))
    q[:, joint] = values
    return arm.kinematics(q)


def _range_of(
    arm: Arm, joint: int, own: list[tuple[Linkage, Cylinder]], end_margin: float, source: str
) -> tuple[float, float]:
    values = _samples(arm, joint, own)
    poses = sweep(arm, joint, values)
    name = arm.joints[joint].name

    def slack(x: Array) -> Array:
        """Distance [m] to the nearest end that any of the cylinders may reach.

        NaN with an open four-bar.
        """
        at = sweep(arm, joint, x)
        rows = []
        for linkage, cylinder in own:
            length, margin = linkage.length(at), end_margin * cylinder.stroke
            rows += [
                length - cylinder.closed_length - margin,
                cylinder.open_length - margin - length,
            ]
        return np.asarray(np.min(rows, axis=0))

    with np.errstate(invalid="ignore"):
        inside = slack(values) >= 0
        each = [linkage.closes(poses) for linkage, _ in own]
    unit = "rad" if arm.joints[joint].revolute else "m"
    for closes, (linkage, cylinder) in zip(each, own, strict=True):
        if not closes.any():
            raise MachineFileError(
                f"{source}: cylinder.{cylinder.name}.{linkage.key}",
                f'does not close at any "{name}" in [{values[0]:.4f}, {values[-1]:.4f}] {unit}',
                linkage.closing_words,
            )
    if not inside.any():
        raise _never_in_stroke(own, poses, end_margin, name, source)
    first, last = _longest_run(inside, values)
    for beyond in (first - 1, last + 1):
        opened = [
            pair
            for closes, pair in zip(each, own, strict=True)
            if not closes[beyond % len(values)]
        ]
        if 0 <= beyond < len(values) and opened:
            linkage, cylinder = opened[0]
            bars = ", ".join(f"{bar}_mm" for bar in linkage.bar_names)
            raise MachineFileError(
                f"{source}: cylinder.{cylinder.name}.{linkage.key}",
                f'opens at "{name}" = {values[beyond]:.4f} {unit}, before stroke or joint limit'
                " ends the motion",
                f"change {bars} or the pins, or tighten the joint's limits in the URDF",
            )
    low = values[first] if first == 0 else _root(slack, values[first - 1], values[first])
    high = (
        values[last] if last == len(values) - 1 else _root(slack, values[last + 1], values[last])
    )
    _refuse_dead_centre(arm, joint, own, (low, high), source)
    return float(low), float(high)


def _never_in_stroke(
    own: list[tuple[Linkage, Cylinder]],
    poses: RigidPoses,
    end_margin: float,
    joint: str,
    source: str,
) -> MachineFileError:
    """What to say when no position of a joint suits its cylinders."""
    for linkage, cylinder in own:
        length, margin = linkage.length(poses), end_margin * cylinder.stroke
        low, high = cylinder.closed_length + margin, cylinder.open_length - margin
        if not np.any((length >= low) & (length <= high)):
            kept = (
                f" ({100 * end_margin:g} % of the stroke kept free at both ends)"
                if end_margin
                else ""
            )
            margin_too = " or end_margin" if end_margin else ""
            return MachineFileError(
                f"{source}: cylinder.{cylinder.name}.stroke_mm",
                f'over joint "{joint}" the pins are {np.nanmin(length):.4f} to'
                f" {np.nanmax(length):.4f} m apart, never within [{low:.4f}, {high:.4f}] m{kept}",
                f"change closed_length_mm, stroke_mm, the pins{margin_too}",
            )
    names = ", ".join(cylinder.name for _, cylinder in own)
    return MachineFileError(
        f"{source}: cylinder.{own[0][1].name}.stroke_mm",
        f'at no "{joint}" are the cylinders {names} in stroke together',
        "change closed_length_mm, stroke_mm or the pins of one of them",
    )


def _samples(arm: Arm, joint: int, own: list[tuple[Linkage, Cylinder]]) -> Array:
    """Where a joint's limits are searched: evenly, and at the middle of each stroke, however short that is."""
    values = over(arm.limits[joint], SAMPLES)
    poses = sweep(arm, joint, values)
    for linkage, cylinder in own:
        middle = cylinder.closed_length + cylinder.stroke / 2

        def beyond(x: float, linkage: Linkage = linkage, middle: float = middle) -> float:
            return float(linkage.length(sweep(arm, joint, np.array([x])))[0]) - middle

        sides = np.sign(linkage.length(poses) - middle)
        for k in np.flatnonzero(sides[:-1] * sides[1:] < 0):
            values = np.append(values, _zero(beyond, values[k], values[k + 1]))
    return np.unique(values)


def _zero(function: Callable[[float], float], a: float, b: float) -> float:
    from scipy.optimize import brentq

    return float(brentq(function, a, b, xtol=1e-14))


def _longest_run(mask: Flags, values: Array) -> tuple[int, int]:
    """First and last of the longest run of true.

    Of runs as long but for a sample, the one nearest to zero.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    starts, ends = edges[::2], edges[1::2] - 1
    long = np.flatnonzero(ends - starts >= (ends - starts).max() - 1)
    distance = [np.abs(values[starts[k] : ends[k] + 1]).min() for k in long]
    chosen = long[int(np.argmin(distance))]
    return int(starts[chosen]), int(ends[chosen])


def _root(slack: Callable[[Array], Array], outside: float, inside: float) -> float:
    """Where the slack vanishes between a value outside and one inside, on the inner side, by bisection.

    Zero stays zero: the number next to it is 5e-324, which moves no pin.
    """
    root = _zero(lambda x: float(slack(np.array([x]))[0]), outside, inside)
    return (
        root if root == 0 or slack(np.array([root]))[0] >= 0 else float(np.nextafter(root, inside))
    )


def _refuse_dead_centre(
    arm: Arm,
    joint: int,
    own: list[tuple[Linkage, Cylinder]],
    limits: tuple[float, float],
    source: str,
) -> None:
    values = over(np.array(limits), SAMPLES)
    for linkage, cylinder in own:
        moment_arm = linkage.actuation(sweep(arm, joint, values)).moment_arm[:, joint]
        if np.abs(moment_arm).min() < 1e-6 or np.any(
            np.sign(moment_arm) != np.sign(moment_arm[0])
        ):
            at = values[int(np.argmin(np.abs(moment_arm)))]
            raise MachineFileError(
                f"{source}: cylinder.{cylinder.name}",
                f'is at its dead centre at "{arm.joints[joint].name}" = {at:.4f}: no moment arm'
                " (singular pose)",
                "move its pins or tighten the joint's limits so that the range stays on one side",
            )
