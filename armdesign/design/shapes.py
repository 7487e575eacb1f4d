"""The shape of a cylinder's moment arm, for all pins of a region at once.

Let u = ℓ²/2. Seen from the base's link u, u' = ℓ r and u'' = ℓ H + r² are affine in where the base pin is, but for the
square in u. A direct cylinder on a revolute joint looks the same when its rod pin turns with it: in units of the rod
pin's distance from the joint the rod end runs on a unit circle, and the four pin coordinates make three numbers, the
base's place b in those units and the scale. So in all cases, times scale²,

    u = c0 + s0·b + ½ b·b,   u' = c1 + s1·b,   u'' = c2 + s2·b.

Stiffness needs less still: with swept volumes v = A S in place of areas, only the piston's place σ = s/S, its rate
ρ = r/S and the bend τ = H/r = u''/u' − u'/(2u), none of which knows the scale.

Enclosures are the natural interval extension cut with the mean value form f(c) ± Σ max|∂f/∂b_k| δ_k (Moore, Kearfott and
Cloud, Introduction to Interval Analysis, 2009, ch. 5 and 6), whose excess falls with the square of the box.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armdesign.arm import RigidPoses
from armdesign.arrays import Array
from armdesign.design.intervals import Interval, interval
from armdesign.design.pin_boxes import PinBoxes
from armdesign.design.problem import Problem
from armdesign.linkage import Linkage
from armdesign.ranges import sweep

LEAST = 1e-9  # of stroke and of |ℓ r|, in units of the scale: both are positive for a cylinder that works
STRAIGHT = 1e-9  # how far from plane an arm may be


@dataclass(frozen=True, eq=False, kw_only=True)
class Enclosure:
    """What a shape can be over m boxes at n angles, in units of its scale.

    place σ, rate ρ, bend τ and arm r (m, n); their slopes by b (m, n, 2); lengths (m,), ``stroke_slope`` (m, 2).
    """

    place: Interval
    rate: Interval
    bend: Interval
    arm: Interval
    place_slope: Interval
    rate_slope: Interval
    bend_slope: Interval
    closed: Interval
    open: Interval
    stroke: Interval
    stroke_slope: Interval


@dataclass(frozen=True, eq=False, kw_only=True)
class Shape:
    """A cylinder's coefficients c (n, 3) and s (n, 3, 2) at n angles of its joint, and the region of b and scale.

    The first two angles are those of the closed and of the open cylinder. ``sign`` is that of the moment arm. ``fixed``
    are closed length and stroke where no pin moves: today's, which may exceed what the joint's range needs.
    ``boxes`` say which b and scale belong together; None if all of the region do.
    """

    constant: Array
    slope: Array
    sign: float
    low: Array  # (2,)
    high: Array
    scale: tuple[float, float]
    fixed: tuple[float, float] | None = None
    boxes: PinBoxes | None = None

    def at(self, angles: Array) -> Shape:
        """The same shape at some of its angles, the two ends first."""
        chosen = np.concatenate([[0, 1], angles]).astype(int)
        return replace(self, constant=self.constant[chosen], slope=self.slope[chosen])

    def enclose(self, low: Array, high: Array) -> Enclosure:
        """Over boxes of b with corners ``low`` and ``high`` (m, 2); exact for boxes of no width."""
        reach = (high - low) / 2
        wide, centre = self._natural(Interval(low, high)), self._natural(interval((low + high) / 2))
        pairs = {"place": "place_slope", "rate": "rate_slope", "bend": "bend_slope", "stroke": "stroke_slope"}
        cut = {}
        for name, slope in pairs.items():
            spread = np.einsum("...k,...k->...", getattr(wide, slope).size, reach[:, None] if name != "stroke" else reach)
            middle: Interval = getattr(centre, name)
            cut[name] = getattr(wide, name).within(Interval(middle.low - spread, middle.high + spread))
        return replace(wide, **cut)

    def _natural(self, b: Interval) -> Enclosure:
        lever = b[:, None, :] + self.slope[:, 0]
        flat = self.constant[:, 0] - (self.slope[:, 0] ** 2).sum(axis=1) / 2
        u = (lever.square().sum(axis=2) * 0.5 + flat).above(LEAST)
        first = ((b[:, None, :] * self.slope[:, 1]).sum(axis=2) + self.constant[:, 1]) * self.sign
        first = first.above(LEAST)  # times sign: the arm vanishes nowhere in the range
        second = (b[:, None, :] * self.slope[:, 2]).sum(axis=2) + self.constant[:, 2]
        length = (u * 2).sqrt()
        inverse = length.reciprocal()
        along = (lever * inverse[..., None]).within(Interval(np.array(-1.0), np.array(1.0)))
        arm = first * self.sign * inverse
        arm_slope = (self.slope[:, 1] - along * arm[..., None]) * inverse[..., None]
        closed, opened, stroke, stroke_slope = self._ends(length, along)
        per_stroke = stroke.reciprocal()[:, None]
        start = along[:, :1] if self.fixed is None else 0.0
        place = ((length - closed[:, None]) * per_stroke).above(0.0)
        place = Interval(np.minimum(place.low, 1.0), np.minimum(place.high, 1.0))
        rate = arm * per_stroke
        by_first, by_u = first.reciprocal() * self.sign, u.reciprocal()
        ratio = second * by_first
        return Enclosure(
            place=place,
            rate=rate,
            bend=ratio - first * self.sign * by_u * 0.5,
            arm=arm,
            place_slope=(along - start - place[..., None] * stroke_slope[:, None]) * per_stroke[..., None],
            rate_slope=(arm_slope - rate[..., None] * stroke_slope[:, None]) * per_stroke[..., None],
            bend_slope=(self.slope[:, 2] - ratio[..., None] * self.slope[:, 1]) * by_first[..., None]
            - (self.slope[:, 1] - lever * (first * self.sign * by_u)[..., None]) * by_u[..., None] * 0.5,
            closed=closed,
            open=opened,
            stroke=stroke,
            stroke_slope=stroke_slope,
        )

    def _ends(self, length: Interval, along: Interval) -> tuple[Interval, Interval, Interval, Interval]:
        """Closed and open length, stroke, and the stroke's slope by b."""
        if self.fixed is not None:
            one = np.ones(len(length.low))
            closed, stroke = self.fixed
            none = interval(np.zeros((len(one), 2)))
            return interval(closed * one), interval((closed + stroke) * one), interval(stroke * one), none
        closed, opened = length[:, 0], length[:, 1]
        return closed, opened, (opened - closed).above(LEAST), along[:, 1] - along[:, 0]


def shape_of(problem: Problem, i: int, angles: Array) -> Shape | None:
    """Shape of cylinder ``i`` at angles of its joint (n,), after those of its ends; None where none is known.

    Known are cylinders that move one joint alone and vary at most by base and rod pins: on a revolute joint in the
    plane of the pins, along a slide, or through a four-bar of given bars.
    """
    linkage, cylinder = problem.machine.linkages[i], problem.machine.cylinders[i]
    moves = _moves(problem, i)
    if len(linkage.joints) != 1 or moves is None:
        return None
    joint = linkage.joints[0]
    sign = float(np.sign(problem.arms_today[i][0]))
    ends = problem.machine.ranges[joint][:: int(sign)]
    poses = sweep(problem.machine.arm, joint, np.concatenate([ends, angles]))
    if not moves:
        return replace(
            _about_base(linkage, poses, np.zeros((2, 2)), sign), fixed=(cylinder.closed_length, cylinder.stroke)
        )
    turning = problem.machine.arm.joints[joint].revolute and linkage.four_bar is None and "rod_end" in moves
    return _turned(linkage, poses, moves, sign) if turning else _shifted(linkage, poses, moves, sign)


def _moves(problem: Problem, i: int) -> dict[str, Array] | None:
    """How far each pin of a cylinder may move, down and up (2, 2: x and z) [m]; None if another part varies too."""
    found: dict[str, Array] = {}
    for v in problem.variables:
        if v.cylinder != i or v.pin is None:
            continue
        if v.pin not in ("base", "rod_end") or v.axis not in (0, 2):
            return None
        reach = found.setdefault(v.pin, np.zeros((2, 2)))
        reach[:, v.axis // 2] = np.array([v.lower, v.upper]) * problem.box
    return found


def _about_base(linkage: Linkage, poses: RigidPoses, reach: Array, sign: float) -> Shape:
    """The shape by moves b [m] of the base pin in its link, within ``reach`` (2, 2), the rod end as it is."""
    joint = linkage.joints[0]
    now = linkage.actuation(poses)
    length, arm, curve = now.length, now.moment_arm[:, joint], now.moment_arm_derivative[:, joint, joint]
    slope = np.empty((len(poses), 3, 2))
    for k, by in enumerate(linkage.sensitivities(poses, [("base", 0), ("base", 2)])):
        d_arm, d_curve = by.moment_arm[:, joint], by.moment_arm_derivative[:, joint, joint]
        slope[:, 0, k] = length * by.length
        slope[:, 1, k] = by.length * arm + length * d_arm
        slope[:, 2, k] = by.length * curve + length * d_curve + 2 * arm * d_arm
    constant = np.stack([length**2 / 2, length * arm, length * curve + arm**2], axis=1)
    return Shape(constant=constant, slope=slope, sign=sign, low=reach[0], high=reach[1], scale=(1.0, 1.0))


def _shifted(linkage: Linkage, poses: RigidPoses, moves: dict[str, Array], sign: float) -> Shape | None:
    """The shape of a four-bar, or of a cylinder along a slide: a move of its rod pin is one of its base pin backwards."""
    reach = moves.get("base", np.zeros((2, 2)))
    if "rod_end" in moves:
        turn = _turn(linkage, poses)
        if turn is None or np.ptp(turn, axis=0).max() > STRAIGHT:
            return None
        corners = np.array([[x, z] for x in moves["rod_end"][:, 0] for z in moves["rod_end"][:, 1]]) @ turn[0].T
        reach = reach - np.stack([corners.max(axis=0), corners.min(axis=0)])
    return _about_base(linkage, poses, reach, sign)


def _turned(linkage: Linkage, poses: RigidPoses, moves: dict[str, Array], sign: float) -> Shape | None:
    """The shape of a direct cylinder on a revolute joint, by the base pin in units of the rod pin's distance."""
    turn = _turn(linkage, poses)
    rod_end, arm, joint = linkage.rod_end, linkage.arm, linkage.joints[0]
    if turn is None or rod_end is None:
        return None
    places = _from_joint(linkage, poses)
    if abs(places["base"][1] - places["rod_end"][1]) > STRAIGHT:
        return None
    still = np.zeros((2, 2))
    base, end = (places[pin][[0, 2]] + moves.get(pin, still) for pin in ("base", "rod_end"))
    boxes = PinBoxes(base=base, rod_end=end)
    low, high, scale = boxes.region()
    unit = arm.direction(poses, rod_end.link, np.array([1.0, 0.0, 0.0]), linkage.base.link, (joint,))
    frame = arm.link_rotation(poses, linkage.base.link)[:, :, [0, 2]]
    parts = [np.einsum("ni,nik->nk", p, frame) for p in (unit.value, unit.first[:, 0], unit.second[:, 0, 0])]
    constant = np.tile([0.5, 0.0, 0.0], (len(poses), 1))
    slope = -np.stack(parts, axis=1)
    return Shape(
        constant=constant, slope=slope, sign=sign, low=low, high=high, scale=scale, boxes=boxes
    )


def _from_joint(linkage: Linkage, poses: RigidPoses) -> dict[str, Array]:
    """Base and rod pin (3,) [m] as seen from their joint, each in the axes of its link."""
    arm, found = linkage.arm, {}
    for pin in ("base", "rod_end"):
        place = getattr(linkage, pin)
        lever = arm.point(poses[:1], place.link, np.array(place.at))[0] - poses.translation[0, linkage.joints[0]]
        found[pin] = arm.link_rotation(poses[:1], place.link)[0].T @ lever
    return found


def coordinates(problem: Problem, i: int, shape: Shape, x: Array) -> Array:
    """The base's place b and the scale (3,) of cylinder ``i`` of the design x."""
    linkage, today = problem.linkages(x)[i], problem.machine.linkages[i]
    poses = sweep(linkage.arm, linkage.joints[0], problem.machine.ranges[linkage.joints[0]])
    if shape.boxes is not None:
        places = _from_joint(linkage, poses)
        base, end = (complex(places[pin][0], places[pin][2]) for pin in ("base", "rod_end"))
        return np.array([(base / end).real, (base / end).imag, abs(end)])
    move = np.subtract(linkage.base.at, today.base.at)[[0, 2]]
    turn = _turn(linkage, poses)
    if turn is not None and linkage.rod_end is not None and today.rod_end is not None:
        move = move - turn[0] @ np.subtract(linkage.rod_end.at, today.rod_end.at)[[0, 2]]
    return np.append(move, 1.0)


def _turn(linkage: Linkage, poses: RigidPoses) -> Array | None:
    """How the rod end's link stands in the base's (n, 2, 2), in x and z; None if not in one plane."""
    if linkage.rod_end is None:
        return None
    frames = [linkage.arm.link_rotation(poses, link) for link in (linkage.base.link, linkage.rod_end.link)]
    turn = np.swapaxes(frames[0], 1, 2) @ frames[1]
    if np.abs(turn[:, 1] - [0.0, 1.0, 0.0]).max() > STRAIGHT:
        return None
    return np.asarray(turn[:, [0, 2]][:, :, [0, 2]])
