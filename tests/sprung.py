"""Machines on springs: two masses in a row, random arms, and a shipped excavator that rocks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from armdesign import ArmDesignError, Machine, load
from tests.machines import CylinderSpec, Joint, build

VALVE = (
    "valve = { rated_flow_l_per_min = 100, rated_drop_bar = 10, natural_frequency_hz = 20,"
    " damping_ratio = 0.8 }"
)


def spring(name: str, joint: str, stiffness: float, more: str = "", turns: bool = True) -> str:
    """The table of a spring."""
    unit = "N_m_per_rad" if turns else "N_per_m"
    return f'[spring.{name}]\njoint = "{joint}"\nstiffness_{unit} = {stiffness!r}\n{more}'


def two_masses(stiffness: float, carriage: float = 900.0, more: str = "") -> Machine:
    """A 400 kg slide that a level cylinder drives on a carriage on a spring, all along x.

    No gravity along it.
    """
    slide = Joint(
        "slide", "carriage", axis=(1, 0, 0), kind="prismatic", limits=(-0.2, 0.2), mass=400.0
    )
    base = replace(slide, name="carriage", parent="root", mass=carriage)
    push = CylinderSpec("push", ("carriage", (-1.0, 0, 0.0)), ("slide", (0.2, 0, 0)), extra=VALVE)
    table = spring("ground", "carriage", stiffness, more, turns=False)
    return build([base, slide], [push], order=["slide"], payload_kg=0.0, more=table)


def off_middle(machine: Machine) -> np.ndarray:
    """A pose (nq,) near the middle of all joint ranges, where no angle is round."""
    return np.asarray(machine.ranges @ [0.45, 0.55])


def random_sprung(seed: int) -> Machine:
    """One to three joints about or along any axis, each behind a joint on a spring.

    Cylinders weigh; springs stand a little off zero.
    """
    rng = np.random.default_rng(seed)
    for _ in range(50):
        try:
            return _attempt(rng)
        except ArmDesignError:  # a dead centre in the range
            continue
    raise AssertionError(f"no machine from seed {seed}")


def _attempt(rng: np.random.Generator) -> Machine:
    joints: list[Joint] = []
    cylinders: list[CylinderSpec] = []
    tables: list[str] = []
    for index in range(int(rng.integers(1, 4))):
        for name in (f"s{index}", f"j{index}"):
            joints.append(
                Joint(
                    name,
                    joints[-1].name if joints else "root",
                    xyz=tuple(rng.uniform(-1, 1, 3)),
                    rpy=tuple(rng.uniform(-3, 3, 3)),
                    axis=tuple(rng.normal(size=3)),
                    kind="prismatic" if rng.random() < 0.3 else "revolute",
                    limits=(-0.1, 0.1),
                    mass=float(rng.uniform(20, 400)),
                    com=tuple(rng.uniform(-0.5, 0.5, 3)),
                )
            )
        turns = joints[-2].kind == "revolute"
        at = "at_deg = 1.5" if turns else "at_mm = -20.0"
        stiffness = float(10 ** rng.uniform(5.5, 7))
        tables.append(spring(f"yield{index}", f"s{index}", stiffness, at, turns))
        cylinders.append(
            CylinderSpec(
                f"c{index}",
                (f"s{index}", tuple(rng.uniform(-1.5, 1.5, 3))),
                (f"j{index}", tuple(rng.uniform(-1.5, 1.5, 3))),
                extra="barrel_kg = 30\nrod_kg = 20",
            )
        )
    order = [joint.name for joint in joints if joint.name.startswith("j")]
    return build(joints, cylinders, order=order, more="\n\n".join(tables))


def rocking(name: str = "excavator_20t", stiffness: float = 2.5e7, more: str = "") -> Machine:
    """A shipped excavator whose tracks, 5 t, rock on the ground about the lateral axis."""
    machine = load(name)
    urdf, text = _on_tracks(machine.urdf_text), machine.text
    return Machine.from_text(
        f"{text}\n{spring('carriage', 'rocking', stiffness, more)}\n", urdf, machine.source
    )


def _on_tracks(urdf: str) -> str:
    """The URDF with a link between the ground and what stood on it."""
    tracks = (
        '<link name="tracks"><inertial><origin xyz="0 0 0.5"/><mass value="5000"/><inertia'
        ' ixx="3000" iyy="8000" izz="8000" ixy="0" ixz="0" iyz="0"/></inertial></link><joint'
        ' name="rocking" type="revolute"><parent link="ground"/><child link="tracks"/><axis xyz="0'
        ' -1 0"/><limit lower="-0.1" upper="0.1" effort="1" velocity="1"/></joint></robot>'
    )
    moved = urdf.replace('<parent link="ground"/>', '<parent link="tracks"/>')
    assert moved != urdf
    return moved.replace("</robot>", tracks)


def written(machine: Machine, folder: Path) -> Path:
    """Its files in a folder."""
    return machine.save(folder / f"{machine.name}.toml")
