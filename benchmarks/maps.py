"""Figures that poses and maps must reach, measured beside their targets.

``python -m benchmarks.maps``: on excavator_20t, and on chains of one to seven joints. Both sides
of the ratio run in this process on one core, the best of five each, by processor time (which is
wall time on an idle machine); memory is the peak of processes of their own. Last, what a second
core gains, by wall time.
"""

from __future__ import annotations

import os

# before numpy starts its threads
os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

import resource
import subprocess
import sys
import time
from functools import partial

import numpy as np
import pinocchio
from threadpoolctl import threadpool_limits

import armdesign as ad
from armdesign.arrays import Array
from benchmarks.timing import best_of, in_turn

MACHINE = "excavator_20t"
POSES, MANY, MOST = 100_000, 1_000_000, 10_000_000
JOINTS = range(1, 8)


def poses_of(machine: ad.Machine, count: int) -> Array:
    """Random poses in stroke."""
    low, high = machine.range_within(0.02).T
    return np.random.default_rng(1).uniform(low, high, (count, len(low)))


def on_a_spring(machine: ad.Machine) -> ad.Machine:
    """The machine whose boom foot rolls."""
    hinge = (
        '<joint name="boom_foot" type="revolute"><axis xyz="1 0 0"/><limit lower="-0.1"'
        ' upper="0.1" effort="1" velocity="1"/>'
    )
    urdf = machine.urdf_text.replace('<joint name="boom_foot" type="fixed">', hinge)
    spring = '[spring.foot]\njoint = "boom_foot"\nstiffness_N_m_per_rad = 5e7\n'
    return ad.Machine.from_text(f"{machine.text}\n{spring}", urdf, machine.source)


def rigid_loop(model: pinocchio.Model, q: Array) -> tuple[Array, Array, Array]:
    """What a Python loop over Pinocchio takes at least: M, g and ∂g/∂q, stored."""
    data = model.createData()
    n, nq = q.shape
    mass, gravity, slope = np.empty((n, nq, nq)), np.empty((n, nq)), np.empty((n, nq, nq))
    for row, at in enumerate(q):
        mass[row] = pinocchio.crba(model, data, at)
        slope[row] = pinocchio.computeGeneralizedGravityDerivatives(model, data, at)
        gravity[row] = data.g
    return mass, gravity, slope


def chain(joints: int) -> ad.Machine:
    """Links of a metre and 100 kg in a row, a cylinder at every joint."""
    links, cylinders = ['<link name="link0"/>'], {}
    for number in range(1, joints + 1):
        links.append(
            f'<joint name="joint{number}" type="revolute"><parent link="link{number - 1}"/>'
            f'<child link="link{number}"/><origin xyz="{float(number > 1)} 0 0"/>'
            '<axis xyz="0 -1 0"/><limit lower="-0.5" upper="0.5" effort="1" velocity="1"/>'
            f'</joint><link name="link{number}"><inertial><origin xyz="0.5 0 0"/>'
            '<mass value="100"/><inertia ixx="1" iyy="10" izz="10" ixy="0" ixz="0" iyz="0"/>'
            "</inertial></link>"
        )
        before = float(number > 1)
        cylinders[f"cylinder{number}"] = {
            **{"bore_mm": 100, "rod_mm": 60, "stroke_mm": 500, "closed_length_mm": 400},
            "dead_volume_l": {"cap": 1, "annulus": 1},
            "base": {"link": f"link{number - 1}", "at_mm": [1000 * before - 100, 0, -400]},
            "rod_end": {"link": f"link{number}", "at_mm": [450, 0, -100]},
        }
    urdf = f'<robot name="chain">{"".join(links)}</robot>'
    return ad.Machine.from_urdf(urdf, cylinders, name="chain")


def many(task: str, count: int) -> None:
    """Time and peak memory of many poses, printed: all kept, their map, or part after part."""
    machine = ad.load(MACHINE).with_payload("full")
    start = time.process_time()
    if task == "modes":
        poses = machine.at(poses_of(machine, count))
        kept: object = (poses, ad.natural_modes(poses))
    elif task == "map":
        points = round(count ** (1 / 3))
        kept = ad.frequency_map(machine, ad.Workspace.grid(machine, points=points))
    else:
        part = poses_of(machine, POSES)
        for _ in range(count // POSES):
            kept = ad.natural_modes(machine.at(part))
    assert kept is not None
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
    print(time.process_time() - start, memory)


def main() -> None:
    """Measure and print everything; memory first, as a process counts its parent's as its own."""
    for task, count in (("modes", MANY), ("map", MANY), ("parts", MANY), ("parts", MOST)):
        run = subprocess.run(
            [sys.executable, "-m", "benchmarks.maps", task, str(count)],
            check=True,
            capture_output=True,
            text=True,
        )
        time_, memory = (float(word) for word in run.stdout.split())
        reached = "ok" if memory < 1 else "MISSED"
        print(
            f"{count:>10,} poses, {task:<5} {time_:5.1f} s  {memory:5.2f} GiB   target < 1 GiB  "
            f" {reached}"
        )
    machine = ad.load(MACHINE)
    ratio("rigid", machine.with_payload("full"))
    ratio("on a spring", on_a_spring(machine).with_payload("full"))
    growth()
    cores()


def cores() -> None:
    """Wall time of the map of a million poses by one thread and by two, printed; turn by turn."""
    machine = ad.load(MACHINE).with_payload("full")
    workspace = ad.Workspace.grid(machine, points=round(MANY ** (1 / 3)))

    def mapped(threads: int) -> None:
        with threadpool_limits(threads):
            ad.frequency_map(machine, workspace)

    one, two = in_turn(partial(mapped, 1), partial(mapped, 2), times=5)
    gain = one.wall / two.wall
    reached = "ok" if gain >= 1.7 else "MISSED"
    print(f"two threads                  {gain:5.2f}       target ≥ 1.7     {reached}")


def growth() -> None:
    """Time for each pose, printed: of more and more poses, and of chains of more joints."""
    machine = ad.load(MACHINE).with_payload("full")
    print("time for each pose [µs]")
    for count in (1_000, 10_000, 100_000, 1_000_000):
        q = poses_of(machine, count)
        print(f"  {count:>9,} poses    {microseconds(machine, q):6.2f}")
    for joints in JOINTS:
        machine = chain(joints)
        q = np.random.default_rng(1).uniform(-0.2, 0.2, (POSES // 4, joints))
        print(f"  {joints:>9} joints   {microseconds(machine, q):6.2f}")


def microseconds(machine: ad.Machine, q: Array) -> float:
    """Processor time for each pose [µs] of all arrays and modes."""
    return best_of(lambda: ad.natural_modes(machine.at(q)), 2).processor / len(q) * 1e6


def ratio(label: str, machine: ad.Machine) -> None:
    """Measure and print the time of all arrays and modes over the loop's."""
    model = pinocchio.buildModelFromXML(machine.arm.xml)
    q = poses_of(machine, POSES)
    coordinates = machine.arm.with_springs(q)
    both = in_turn(
        lambda: rigid_loop(model, coordinates), lambda: ad.natural_modes(machine.at(q)), times=5
    )
    loop, modes = (best.processor for best in both)
    reached = "ok" if modes <= 2 * loop else "MISSED"
    print(
        f"{POSES:,} poses, one payload, {label}: loop over pinocchio {loop:.2f} s,"
        f" modes {modes:.2f} s"
    )
    print(f"ratio                        {modes / loop:5.2f}       target ≤ 2       {reached}")


if __name__ == "__main__":
    many(sys.argv[1], int(sys.argv[2])) if sys.argv[1:] else main()
