"""The paper's mechanism, one cylinder on one joint, by the law of cosines: all of its pins and
areas by brute force.
"""

from __future__ import annotations

import numpy as np

from armdesign.design.program.problem import Problem
from armdesign.frequency.modes import hertz
from tests.design.brute_force import zoomed_best

# base x, z; rod pin x, z from the joint (the machine's file)
PINS_TODAY = np.array([-0.5, 0.0, 0.0, 0.15])


def geometry(pins: np.ndarray, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Length, moment arm and its derivative, each (pins, angles)."""
    d, a = np.hypot(pins[:, 0], pins[:, 1])[:, None], np.hypot(pins[:, 2], pins[:, 3])[:, None]
    between = np.arctan2(pins[:, 1], pins[:, 0]) - np.arctan2(pins[:, 3], pins[:, 2])
    psi = between[:, None] - angles  # q turns the boom's x axis up
    length = np.sqrt(a**2 + d**2 - 2 * a * d * np.cos(psi))
    arm = -a * d * np.sin(psi) / length
    return length, arm, (a * d * np.cos(psi) - arm**2) / length


class OneCylinder:
    """ω² = (β (A1²/V1 + A2²/V2) r² + g' − g h/r)/J grows with both areas, so these are as large as
    oil, thrust and Euler's rod allow, each on its own (A2 ≤ A1 − L √(c A1) grows with A1). J, g
    and g' do not depend on the cylinder. Areas may also be given.
    """

    def __init__(self, problem: Problem, given: tuple[float, float] | None = None) -> None:
        self.given = given
        self.machine, self.requirements = problem.machine, problem.requirements
        self.q, self.pin_box = problem.workspace.q[:, 0], problem.vector.pin_box
        case = self.machine.with_payload("load").at(problem.workspace.q)
        self.inertia, self.gravity = case.mass_matrix[:, 0, 0], case.gravity_torque[:, 0]
        self.slope = case.gravity_stiffness[:, 0, 0]
        self.ends = np.linspace(*self.machine.ranges[0], 61)
        today = geometry(PINS_TODAY[None], self.ends)[1]
        self.sign = np.sign(today[0, 0])
        self.least_arm = self.requirements.moment_arm_share * np.abs(today).min()

    def areas(self, closed: np.ndarray, stroke: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The largest that the requirements allow [m²]."""
        (c,), r = self.machine.cylinders, self.requirements
        a1 = c.bore_area * np.minimum(self.oil(stroke), r.thrust_share)
        return a1, self.most_annulus(a1, closed, stroke)

    def oil(self, stroke: np.ndarray) -> np.ndarray:
        """The largest area that the oil allows, over today's."""
        most = min(self.requirements.oil_each_share, self.requirements.oil_total_share)
        return np.asarray(self.machine.cylinders[0].stroke / stroke * most)

    def most_annulus(self, a1: np.ndarray, closed: np.ndarray, stroke: np.ndarray) -> np.ndarray:
        """The largest annulus area beside a bore area, by oil and buckling [m²]."""
        (c,) = self.machine.cylinders
        factor = ((c.bore_area - c.annulus_area) / c.open_length) ** 2 / c.bore_area
        slender = a1 - (closed + stroke) * np.sqrt(factor * a1)
        return np.minimum(c.annulus_area * self.oil(stroke), slender)

    def held(self, force: np.ndarray, a1: np.ndarray, a2: np.ndarray) -> np.ndarray:
        """Whether the supply holds the static load at every pose."""
        supply, share = self.machine.supply, self.requirements.holding_share
        push = supply.pressure * a1 - supply.return_pressure * a2
        pull = supply.pressure * a2 - supply.return_pressure * a1
        return np.asarray(
            (force.max(axis=1) <= share * push) & (-force.min(axis=1) <= share * pull)
        )

    def worst(self, pins: np.ndarray) -> np.ndarray:
        """Least ω² [1/s²] over the poses, for each row of pins; −∞ where it is not allowed."""
        (c,) = self.machine.cylinders
        over, arms, _ = geometry(pins, self.ends)
        closed, stroke = over.min(axis=1), np.ptp(over, axis=1)
        a1, a2 = most = self.areas(closed, stroke)
        if self.given:
            a1, a2 = (np.full(len(pins), area) for area in self.given)
        length, arm, curve = geometry(pins, self.q)
        s = length - closed[:, None]
        oil = a1[:, None] ** 2 / (a1[:, None] * s + c.cap_dead_volume)
        oil += a2[:, None] ** 2 / (a2[:, None] * (stroke[:, None] - s) + c.annulus_dead_volume)
        force = self.gravity / arm
        allowed = self.held(force, a1, a2) & (closed - stroke >= c.dead_length)
        allowed &= (a1 <= most[0]) & (a2 <= self.most_annulus(a1, closed, stroke))
        allowed &= (self.sign * arms).min(axis=1) >= self.least_arm
        stiffness = self.machine.fluid.bulk_modulus * oil * arm**2 + self.slope - force * curve
        return np.where(allowed, (stiffness / self.inertia).min(axis=1), -np.inf)

    def best(self, points: int = 13) -> float:
        """Best worst frequency [Hz] over pins on a grid that zooms in."""
        low, high = PINS_TODAY - self.pin_box, PINS_TODAY + self.pin_box
        return hertz(zoomed_best(self.worst, low, high, points=points, levels=12, shrink=0.6)[0])
