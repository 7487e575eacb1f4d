"""Canonical pins: of all designs that are equally good, the one that moves the pins least.

Turn all pins of a cylinder together about the joint that it drives, each in its own link, and its
length, moment arm and stroke stay what they are at every pose: the four pin coordinates make three
numbers of a triangle. Without a preference the answer would depend on where the search started.
"""

from __future__ import annotations

import numpy as np

from armdesign.arrays import Array
from armdesign.design.program.problem import Problem

ANGLES = 400  # tried between the pins as found and the least move, where the box is in the way


def least_moved_pins(problem: Problem, x: Array) -> Array:
    """The design of the same lengths and moment arms whose pins move least within the box.

    A cylinder keeps its pins where not all of them may move in the plane in which their joint
    turns; all do where something else feels the turning: own masses, outlines, clearances, boxes
    of single pins.
    """
    x, r = x.copy(), problem.requirements
    noticed = problem.vector.moving_masses or r.outlines or r.clearances or r.pin_boxes
    for i in problem.vector.moving if not noticed else ():
        entries, centres, mirrored = _turnable(problem, i)
        if len(entries) == 0:
            continue
        today = _levers(problem, problem.vector.start, i, centres, mirrored)
        levers, box = _levers(problem, x, i, centres, mirrored), problem.vector.pin_box
        moved = (_turned_towards(levers, today, box) - today) / box
        x[entries[:, 0]] = moved.real
        x[entries[:, 1]] = np.where(mirrored, -moved.imag, moved.imag)
    return x


def _turned_towards(levers: Array, today: Array, box: float) -> Array:
    """Levers, as complex numbers, turned together to the least sum of squared moves.

    Or towards it, as far as the box allows.
    """
    angle = np.angle(np.sum(np.conj(levers) * today))
    turned = levers * np.exp(1j * np.linspace(0.0, angle, ANGLES))[:, None]
    moved = turned - today
    reach = np.maximum(np.abs(moved.real), np.abs(moved.imag)).max(axis=1)
    outside = np.flatnonzero(reach > max(box, reach[0]))
    return np.asarray(turned[outside[0] - 1 if len(outside) else -1])


def _turnable(problem: Problem, i: int) -> tuple[Array, Array, Array]:
    """Entries of x of a cylinder's pins (pins, 2), and where their links see the joint.

    The last tells which links see it from behind. Empty where they cannot turn.
    """
    arm, joint = problem.machine.arm, problem.machine.linkages[i].joints[0]
    index = {move: entry for entry, move in problem.vector.moves(i).items()}
    pose = arm.zero
    entries, centres, mirrored = [], [], []
    for link, name in _pins(problem, i):
        into_link = arm.link_rotation(pose, link)[0].T
        axis = into_link @ pose.axis[0, joint]
        in_plane = sorted(axis_ for name_, axis_ in index if name_ == name) == [0, 2]
        level = arm.joints[joint].revolute and abs(abs(axis[1]) - 1) <= 1e-9
        if not (in_plane and level):
            return np.empty((0, 2), dtype=int), np.empty(0), np.empty(0, dtype=bool)
        entries.append([index[name, 0], index[name, 2]])
        centre = into_link @ (pose.translation[0, joint] - arm.point(pose, link, np.zeros(3))[0])
        centres.append(complex(centre[0], centre[2]))
        mirrored.append(bool(axis[1] < 0))
    return np.array(entries), np.array(centres), np.array(mirrored)


def _pins(problem: Problem, i: int) -> list[tuple[str, str]]:
    """Link and name of every pin of a cylinder's linkage."""
    linkage = problem.machine.linkages[i]
    return [(pin.link, name) for pin, name in zip(linkage.pins, linkage.pin_names, strict=True)]


def _levers(problem: Problem, x: Array, i: int, centres: Array, mirrored: Array) -> Array:
    """From the joint to every pin in its link's plane, x + i z [m].

    Conjugate where the link sees the joint turned.
    """
    linkage = problem.vector.linkages(x)[i]
    places = [linkage.place(name) or (0.0, 0.0, 0.0) for _, name in _pins(problem, i)]
    levers = np.array([complex(at[0], at[2]) for at in places]) - centres
    return np.asarray(np.where(mirrored, np.conj(levers), levers))
