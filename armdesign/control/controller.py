"""The controller: position loops with velocity feed-forward, and feedback of the load pressures.

    q̇_d = K (q_r − q) + q̇_r           joint speeds demanded: a gain per joint, feed-forward
    v   = R q̇_d − c H(s) p_L           piston speeds: moment arms, a pressure gain per actuator
    u   = v / (static gain of the valve)

H is a high-pass with its corner at ω_c, s/(s + ω_c), or a band-pass around the mode,
2ζ_f ω_c s/(s² + 2ζ_f ω_c s + ω_c²): no pressure that merely holds the load asks for motion.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from itertools import pairwise
from typing import Literal

import numpy as np

from armdesign.arrays import Array, ReadOnly
from armdesign.control.loop_plant import LoopPlant
from armdesign.short_repr import short_repr

Filter = Literal["high-pass", "band-pass"]
BAND_WIDTH = 1.0  # ζ_f of the band-pass
LEAST_DEGREES, PER_TURN = 3, 0.65  # states of a delay, of them for each rad
CORNER = {"high-pass": 1 / 3, "band-pass": 1.0}  # ω_c by the lowest natural frequency


@dataclass(frozen=True, eq=False, kw_only=True)
class Controller(ReadOnly):
    """Gains of the controllers of n poses.

    Attributes:
        position: K of each joint (n, nq) [1/s].
        pressure: c of each actuator (n, nc) [m/s/bar, of a motor rad/s/bar].
        corner: ω_c of the filters (n,) [rad/s].
        filter: their kind.
    """

    __repr__ = short_repr

    position: Array
    pressure: Array
    corner: Array
    filter: Filter = "high-pass"

    def __getitem__(self, rows: slice | Array) -> Controller:
        """The controllers of some of the poses (slice, mask or indices)."""
        arrays = {name: getattr(self, name)[rows] for name in ("position", "pressure", "corner")}
        return Controller(**arrays, filter=self.filter)

    @classmethod
    def joined(cls, parts: list[Controller]) -> Controller:
        """The controllers of several sets of poses as one."""
        names = [field.name for field in fields(cls) if field.name != "filter"]
        arrays = {name: np.concatenate([getattr(one, name) for one in parts]) for name in names}
        return cls(**arrays, filter=parts[0].filter)

    def filtered(self, omega: Array) -> Array:
        """H(jω) of each pose (n, f) at frequencies (n, f) [rad/s]."""
        s, corner = 1j * omega, self.corner[:, None]
        if self.filter == "high-pass":
            return np.asarray(s / (s + corner))
        middle = 2 * BAND_WIDTH * corner * s
        return np.asarray(middle / (s**2 + middle + corner**2))


def closed_loop(
    plant: LoopPlant, controller: Controller, turns: float | None = None
) -> tuple[Array, Array, Array]:
    """ẋ = A x + B q_r, q = C x of the closed loops (n, m, m), (n, m, nq), (nq, m).

    States: the plant's, two of each spool, the delay's (Padé), and the filters' where pressures
    are fed back.

    Args:
        plant: of n poses.
        controller: of them.
        turns: ω T [rad] up to which the delay is met; None: at all modes and valves.
    """
    ns, nq, nc = plant.A.shape[1], plant.joints, plant.B.shape[2]
    if turns is None:
        turns = plant.fastest.max(initial=0.0) * plant.delay
    lag, delay = _spools(plant), pade_delay(plant.delay, turns, nc)
    filters = _filters(controller, nc)
    ends = np.cumsum([0, ns, 2 * nc, delay[0].shape[0], filters[0].shape[1]])
    x, v, d, h = (slice(begin, end) for begin, end in pairwise(ends))
    A = np.zeros((len(plant), ends[-1], ends[-1]))
    A[:, x, x], A[:, x, v.start : v.start + nc] = plant.A, plant.B
    A[:, v, v], A[:, d, d] = lag[0], delay[0]
    A[:, v, d] = lag[1] @ delay[2]
    A[:, h, h], A[:, h, x] = filters[0], filters[1] @ plant.load
    # The demand of all controllers, by the plant's states and the filters', and by q_r.
    demand = np.zeros((len(plant), nc, ends[-1]))
    wanted = plant.moment_arms * controller.position[:, None]
    demand[:, :, :nq] = -wanted
    demand[:, :, x] -= controller.pressure[:, :, None] * (filters[3] @ plant.load)
    demand[:, :, h] -= controller.pressure[:, :, None] * filters[2]
    A[:, d] += delay[1] @ demand
    A[:, v] += (lag[1] @ delay[3]) @ demand
    B = np.zeros((len(plant), ends[-1], nq))
    B[:, d], B[:, v] = delay[1] @ wanted, (lag[1] @ delay[3]) @ wanted
    return A, B, np.eye(nq, ends[-1])


def _spools(plant: LoopPlant) -> tuple[Array, Array]:
    """A (2nc, 2nc) and B (2nc, nc) of spool positions and speeds."""
    nc = len(plant.valve_omega)
    omega, damping = plant.valve_omega, plant.valve_damping
    A, B = np.zeros((2 * nc, 2 * nc)), np.zeros((2 * nc, nc))
    A[:nc, nc:], B[nc:] = np.eye(nc), np.diag(omega**2)
    A[nc:] = np.hstack([np.diag(-(omega**2)), np.diag(-2 * damping * omega)])
    return A, B


def pade_delay(delay: float, turns: float, nc: int) -> tuple[Array, Array, Array, Array]:
    """State space of nc delays T [s] that errs by less than 0.001 up to ω T = ``turns`` [rad].

    Padé's approximation with a numerator of one degree less: what has entered within T, by its
    first Legendre polynomials, of which 1.4 to 1.9 rad take one each. It passes no frequency
    louder than it is. Voelker, Kajić, Eliasmith (2019). No states for no delay.
    """
    if delay == 0:
        return np.zeros((0, 0)), np.zeros((0, nc)), np.zeros((nc, 0)), np.eye(nc)
    degree = np.arange(LEAST_DEGREES + math.ceil(PER_TURN * turns))
    row, column = degree[:, None], degree
    sign = np.where(row < column, -1.0, -((-1.0) ** (row - column)))
    norm = np.sqrt(2 * degree + 1.0)
    A, B = norm[:, None] * norm * sign / delay, (norm * (-1.0) ** degree)[:, None] / delay
    one = np.eye(nc)
    return np.kron(A, one), np.kron(B, one), np.kron(norm[None], one), np.zeros((nc, nc))


def _filters(controller: Controller, nc: int) -> tuple[Array, Array, Array, Array]:
    """State space (n, …) of the filters of nc load pressures."""
    corner, one = controller.corner[:, None, None], np.eye(nc)
    if not controller.pressure.any():
        none = np.zeros((len(corner), nc, 0))
        return none[:, :0], np.swapaxes(none, 1, 2), none, np.zeros((1, nc, nc))
    if controller.filter == "high-pass":  # p − z, ż = ω_c (p − z)
        return -corner * one, corner * one, -np.tile(one, (len(corner), 1, 1)), one[None]
    middle, none = 2 * BAND_WIDTH * corner, np.zeros((len(corner), nc, nc))
    A = np.concatenate(
        [
            np.concatenate([-middle * one, -corner * one], axis=2),
            np.concatenate([corner * one, none], axis=2),
        ],
        axis=1,
    )
    B = np.concatenate([middle * one, none], axis=1)
    C = np.concatenate([np.tile(one, (len(corner), 1, 1)), none], axis=2)
    return A, B, C, np.zeros((1, nc, nc))
