"""Machines and plants that tests of controllers share."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import control
import numpy as np
from numpy.typing import ArrayLike

import armdesign as ad
from armdesign.control.loop_plant import LoopPlant, loop_plant

WORST = (1.154484, -1.057556, -2.191324)  # rigid 20 t machine, payload full: 0.91 Hz


@cache
def rigid() -> ad.Machine:
    """The 20 t machine under its load, on oil alone."""
    machine = ad.load("excavator_20t").with_payload("full")
    cylinders = tuple(replace(cylinder, compliance=0.0) for cylinder in machine.cylinders)
    return replace(machine, cylinders=cylinders)


@cache
def worst_plant(damping: float | None = 0.02, delay: float = 0.0) -> LoopPlant:
    """Its plant at its worst pose."""
    return loop_plant(rigid(), rigid().at(WORST), damping, delay)


def single_pose(machine: ad.Machine, q: ArrayLike) -> ad.Workspace:
    """A workspace of one pose."""
    first = ad.Workspace.grid(machine, points=2).subset(np.array([0]))
    return replace(first, q=np.array([q], dtype=float))


@cache
def many_plants(count: int = 50) -> LoopPlant:
    """Its plants at random poses, with the damping of its file."""
    machine = rigid()
    low, high = machine.range_within(0.05).T
    q = np.random.default_rng(3).uniform(low, high, (4 * count, len(low)))
    poses = machine.at(q[machine.holds(q)][:count])
    return loop_plant(machine, poses)


def one_mass(omega: float, ratio: float, valve: float = 1e4, delay: float = 0.0) -> LoopPlant:
    """A mass on the oil of its cylinder, in closed form: arm 1, oil spring ω², area 1 m²."""
    A = np.array([[0.0, 1.0, 0.0], [0.0, -2 * ratio * omega, 1.0], [0.0, -(omega**2), 0.0]])
    one = np.ones((1, 1))
    return LoopPlant(
        q=0 * one,
        A=A[None],
        B=np.array([[[0.0], [0.0], [omega**2]]]),
        load=np.array([[0.0, 0.0, 1.0]]),
        moment_arms=one[None],
        oil_stiffness=omega**2 * one,
        areas=one[0],
        frequencies=omega / (2 * np.pi) * one,
        damping=ratio * one,
        valve_omega=valve * one[0],
        valve_damping=one[0],
        sides=np.ones((1, 1, 2)),
        delay=delay,
    )


def margin_of_loop(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, loop: int, omega: np.ndarray
) -> float:
    """Disk margin by python-control of one position loop of ẋ = A x + B q_r, q = C x.

    T = q/q_r of the joint; opened at its position error the loop is L = T/(1 − T).
    """
    opened = control.ss(A + B[:, [loop]] @ C[[loop]], B[:, [loop]], C[[loop]], 0)
    return float(control.disk_margins(opened, omega, skew=0.0)[0])
