"""The largest share of one cylinder as a nonconvex programme for SCIP: pins in place of shapes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyscipopt

from armdesign.design.bound.cylinder_term import CylinderTerm


class Share:
    """Base pin, rod pin and swept volumes of a direct cylinder on a revolute joint, in its plane.

    Everything is stated in pins: lengths by their squares, moment arms r by ℓ r = ∂(ℓ²/2)/∂q, and
    H by ∂²(ℓ²/2)/∂q² = ℓ H + r². Quotients are products of what is sought.
    """

    def __init__(self, term: CylinderTerm) -> None:
        assert term.shape.pin_boxes is not None
        self.term, self.limits, self.model = term, term.limits, pyscipopt.Model()
        self.model.hideOutput()
        boxes, (low, high) = term.shape.pin_boxes, self.limits.volume
        self.base, self.rod_end = (
            [self.number(*box[:, axis]) for axis in (0, 1)] for box in (boxes.base, boxes.rod_end)
        )
        self.most = high  # volumes are sought as shares of the largest
        self.volume = [self.number(low[i] / high[i], 1.0) for i in (0, 1)]
        size = [float(np.hypot(*np.abs(box).max(axis=0))) for box in (boxes.base, boxes.rod_end)]
        self.longest, self.arms = sum(size), (self.limits.arm, min(size))
        slope = self.limits.shape.slope
        turn = float(np.arccos(np.clip(slope[0, 0] @ slope[1, 0], -1.0, 1.0)))
        self.strokes = 0.9 * self.limits.arm * turn, min(size) * turn  # ∫ r dq
        self.shortest = self.strokes[0] + max(self.limits.dead_length, 0.0)
        self.lengths: dict[bytes, Any] = {}
        self.known_arms: dict[bytes, Any] = {}
        self.closed, self.opened = (self.length(slope[end]) for end in (0, 1))
        self.stroke = self.equal_to(self.opened - self.closed, *self.strokes)

    def number(self, low: float | None, high: float | None) -> Any:
        return self.model.addVar(lb=low, ub=high)

    def equal_to(
        self, expression: Any, low: float | None = None, high: float | None = None
    ) -> Any:
        number = self.number(low, high)
        self.model.addCons(number == expression)
        return number

    def ratio(self, above: Any, below: Any, low: float | None, high: float | None) -> Any:
        number = self.number(low, high)
        self.model.addCons(number * below == above)
        return number

    def turned(self, axis: np.ndarray) -> tuple[Any, Any]:
        """The rod pin where its link's x axis is this one, as the base's link sees it."""
        (x, z), (c, s) = self.rod_end, axis
        return c * x - s * z, s * x + c * z

    def length(self, slope: np.ndarray) -> Any:
        key = slope[0].tobytes()
        if key not in self.lengths:
            end = self.turned(-slope[0])
            length = self.number(self.shortest, self.longest)
            square = sum((b - e) * (b - e) for b, e in zip(self.base, end, strict=True))
            self.model.addCons(length * length == square)
            self.lengths[key] = length
        return self.lengths[key]

    def arm(self, slope: np.ndarray) -> Any:
        """The moment arm's size."""
        key = slope[0].tobytes()
        if key not in self.known_arms:
            step = self.turned(-slope[1])
            product = sum(b * e for b, e in zip(self.base, step, strict=True))
            self.known_arms[key] = self.ratio(
                -self.term.shape.sign * product, self.length(slope), *self.arms
            )
        return self.known_arms[key]

    def rate(self, slope: np.ndarray) -> Any:
        """The moment arm over the stroke."""
        low, high = self.arms[0] / self.strokes[1], self.arms[1] / self.strokes[0]
        return self.ratio(self.arm(slope), self.stroke, low, high)

    def required(self) -> None:
        """Areas, dead length, buckling, moment arms and loads."""
        limits, (cap, annulus) = self.limits, self.volume
        for side, volume in enumerate(self.volume):
            low, high = limits.areas.ends[:, side] / self.most[side]
            self.model.addCons(volume >= low * self.stroke)
            if np.isfinite(high):
                self.model.addCons(volume <= high * self.stroke)
        self.model.addCons(self.closed - self.stroke >= limits.dead_length)
        rod = self.equal_to(cap - self.most[1] / self.most[0] * annulus, 0.0, 1.0)
        bent = self.equal_to(self.opened * self.opened * self.stroke)
        self.model.addCons(rod * rod >= limits.buckling / self.most[0] * bent * cap)
        slopes = limits.shape.slope
        for slope in slopes[: limits.ranged]:
            self.arm(slope)
        loads = limits.loads
        assert len(np.unique(loads.place)) == len(loads.place)
        for slope, held in zip(
            slopes[len(slopes) - len(loads.angle) :], loads.held.T, strict=True
        ):
            rate = self.rate(slope)
            for own, other, torque in ((0, 1, held[0]), (1, 0, held[1])):
                if torque > 0:
                    pressed = limits.supply * self.most[own] * self.volume[own]
                    back = limits.back * self.most[other] * self.volume[other]
                    self.model.addCons((pressed - back) / torque * rate >= 1.0)

    def share(self) -> Any:
        """Σ w k r² − G τ − μ·v."""
        term, total = self.term, 0.0
        cap, annulus = (m * v for m, v in zip(self.most, self.volume, strict=True))
        for slope, weight, bend in zip(
            term.shape.slope[2:], term.weight[2:], term.bend.low[2:], strict=True
        ):
            length, arm = self.length(slope), self.arm(slope)
            place = self.ratio(length - self.closed, self.stroke, 0.0, 1.0)
            rate = self.rate(slope)
            filled = (cap * place + term.dead[0], annulus * (1 - place) + term.dead[1])
            square = self.equal_to(rate * rate, 0.0, None)
            for volume, most, oil in zip(self.volume, self.most, filled, strict=True):
                # v²/(v σ + D) in shares of the largest, at most v/σ and v²/D
                spring = self.ratio(volume * volume, oil / most, 0.0, most / term.dead.min())
                total = total + weight * most * self.equal_to(square * spring, 0.0, None)
            step, curve = self.turned(-slope[1]), self.turned(-slope[2])
            end = self.turned(-slope[0])
            second = sum(
                e * e - (b - p) * c for e, b, p, c in zip(step, self.base, end, curve, strict=True)
            )
            sign = term.shape.sign
            most = 2 * self.longest**2 / self.arms[0]
            by_arm = self.ratio(second, sign * arm, -most, most)
            most = 2 * most / self.shortest
            total = total - bend * self.ratio(by_arm - sign * arm, length, -most, most)
        return total - term.price[0] * cap - term.price[1] * annulus


def largest_share(term: CylinderTerm, gap: float, seconds: float) -> tuple[float, float]:
    """SCIP's value and bound of the largest share."""
    share = Share(term)
    share.required()
    value = share.equal_to(share.share())
    model = share.model
    model.setObjective(value, "maximize")
    model.setParam("limits/absgap", gap)
    model.setParam("timing/clocktype", 1)  # of the processor
    model.setParam("limits/time", seconds)
    model.setParam("numerics/feastol", 1e-7)
    model.optimize()
    return model.getObjVal(), model.getDualbound()
