"""Machines nobody would build, as texts of a machine file and a URDF: tests go through the front
door. `named` gives them, and the shipped ones, by name.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from armdesign import ArmDesignError, Machine, load
from armdesign.mechanism.arm import Arm
from armdesign.mechanism.linkage.base import Pin
from armdesign.mechanism.linkage.direct import Direct
from armdesign.mechanism.linkage.four_bar import FourBar


@dataclass(frozen=True)
class Joint:
    """A joint from `parent` to a link of the joint's own name, whose body has a box's inertia
    about `com`.
    """

    name: str
    parent: str
    xyz: tuple[float, ...] = (0, 0, 0)
    rpy: tuple[float, ...] = (0, 0, 0)
    axis: tuple[float, ...] = (0, -1, 0)
    kind: str = "revolute"
    limits: tuple[float, float] = (-0.3, 0.3)
    mass: float = 100.0
    com: tuple[float, ...] = (0.8, 0.05, 0.1)


@dataclass(frozen=True)
class CylinderSpec:
    """A cylinder between two pins (link, [m]); its stroke is laid around its length at q = 0."""

    name: str
    base: tuple[str, tuple[float, ...]]
    rod_end: tuple[str, tuple[float, ...]] | None = None
    pivot: tuple[str, tuple[float, ...]] | None = None
    lug: tuple[str, tuple[float, ...]] | None = None
    rocker: float = 0.5
    coupler: float = 0.45
    knee: str = "left"
    bore_mm: float = 100
    rod_mm: float = 63
    extra: str = ""


def words(values: tuple[float, ...]) -> str:
    return " ".join(repr(float(x)) for x in values)


def urdf(joints: list[Joint]) -> str:
    parts = ['<link name="root"/>']
    for joint in joints:
        a, b, c = (1.2, 0.3, 0.2)  # a box's edges [m]
        inertia = [joint.mass / 12 * x for x in (b * b + c * c, a * a + c * c, a * a + b * b)]
        parts.append(
            f'<joint name="{joint.name}" type="{joint.kind}"><parent link="{joint.parent}"/><child'
            f' link="{joint.name}"/><origin xyz="{words(joint.xyz)}"'
            f' rpy="{words(joint.rpy)}"/><axis xyz="{words(joint.axis)}"/><limit'
            f' lower="{joint.limits[0]}" upper="{joint.limits[1]}" effort="1"'
            f' velocity="1"/></joint><link name="{joint.name}"><inertial><origin'
            f' xyz="{words(joint.com)}" rpy="0.1 0.2 -0.3"/><mass value="{joint.mass}"/><inertia'
            f' ixx="{inertia[0]}" iyy="{inertia[1]}" izz="{inertia[2]}" ixy="0" ixz="0"'
            ' iyz="0"/></inertial></link>'
        )
    return f'<robot name="odd">{"".join(parts)}</robot>'


def _pin(at: tuple[str, tuple[float, ...]]) -> str:
    return f'{{ link = "{at[0]}", at_mm = {[1000 * float(x) for x in at[1]]} }}'


def _zero_length(arm: Arm, actuator: CylinderSpec) -> float:
    """Pin-to-pin length at q = 0, only to lay the stroke around it."""

    def pin(at: tuple[str, tuple[float, ...]]) -> Pin:
        return Pin(link=at[0], at=at[1])  # type: ignore[arg-type]

    base = pin(actuator.base)
    if actuator.rod_end:
        linkage = Direct(base=base, rod_end=pin(actuator.rod_end), arm=arm)
    else:
        bars = {name: getattr(actuator, name) for name in ("rocker", "coupler", "knee")}
        pivot, lug = pin(actuator.pivot), pin(actuator.lug)
        linkage = FourBar(base=base, pivot=pivot, lug=lug, arm=arm, **bars)
    return float(linkage.length(arm.kinematics(np.zeros((1, len(arm.joints)))))[0])


def build(
    joints: list[Joint],
    actuators: list[CylinderSpec],
    *,
    order: list[str] | None = None,
    payload: tuple[str, tuple[float, ...]] | None = None,
    payload_kg: float = 150,
    air_percent: float = 0.0,
    more: str = "",
) -> Machine:
    """The machine of these joints and cylinders, and of tables as text; `order` is q's, if not
    the file's own.
    """
    order = order or [joint.name for joint in joints]
    robot = urdf(joints)
    arm = Arm(robot, order, {}, "odd.urdf")
    held = payload or (joints[-1].name, (1.0, 0.1, -0.2))
    text = [
        f'name = "odd"\nurdf = "odd.urdf"\njoints = {order}\ntool = {_pin(held)}'.replace(
            "'", '"'
        ),
        (
            f'[payload.load]\nmass_kg = {payload_kg}\nlink = "{held[0]}"\nat_mm ='
            f" {[1000 * float(x) for x in held[1]]}"
        ),
        f"[fluid]\nbulk_modulus_MPa = 1200\nentrained_air_percent = {air_percent}",
        "[supply]\npressure_bar = 300\nreturn_pressure_bar = 5\nflow_l_per_min = 200",
    ]
    for f in actuators:
        length = 1000 * _zero_length(arm, f)
        text.append(
            f"[cylinder.{f.name}]\nbore_mm = {f.bore_mm}\nrod_mm = {f.rod_mm}\n"
            f"stroke_mm = {length:.3f}\nclosed_length_mm = {0.45 * length:.3f}\n"
            f"dead_volume_l = {{ cap = 1.5, annulus = 2.5 }}\nbase = {_pin(f.base)}\n{f.extra}"
        )
        if f.rod_end:
            text[-1] += f"\nrod_end = {_pin(f.rod_end)}"
        else:
            text.append(
                f"[cylinder.{f.name}.four_bar]\npivot = {_pin(f.pivot)}\nlug = {_pin(f.lug)}\n"
                f"rocker_mm = {1000 * f.rocker}\ncoupler_mm = {1000 * f.coupler}\nknee ="
                f' "{f.knee}"'
            )
    return Machine.from_text("\n\n".join([*text, more]), robot, Path("odd.toml"))


BOOM = Joint("boom", "root", xyz=(0.1, 0, 0.5), com=(1.2, 0, 0.2), mass=300)


STICK = Joint("stick", "boom", xyz=(2.5, 0, 0), rpy=(0, 0.7, 0), mass=150)


BUCKET = Joint("bucket", "stick", xyz=(1.6, 0, 0), rpy=(0, 0.3, 0), mass=80, com=(0.4, 0, 0.2))


LIFT = CylinderSpec("lift", ("root", (0.7, 0, 0.1)), ("boom", (1.1, 0, 0.4)))


FOLD = CylinderSpec("fold", ("boom", (1.3, 0, 0.7)), ("stick", (-0.4, 0, 0.25)))


BAR_MASSES = {"barrel": 110, "rod": 85}


SOFT = (
    "count = 2\ncompliance_m_per_N = 2e-8\nhose = { cap_l = 0.9, annulus_l = 0.4, bulk_modulus_MPa"
    " = 400 }"
)


def four_bar(knee: str, base: tuple[str, tuple[float, ...]] = ("stick", (0.2, 0, 0.5))) -> Machine:
    """Boom, stick and a bucket on a four-bar; with `base` on the boom its cylinder spans two
    joints.
    """
    height = 0.15 if knee == "left" else -0.1
    tilt = CylinderSpec(
        "tilt",
        base,
        pivot=("stick", (1.3, 0, height)),
        lug=("bucket", (0.1, 0.02, 2 * height)),
        knee=knee,
    )
    return build([BOOM, STICK, BUCKET], [LIFT, FOLD, tilt])


def spatial() -> Machine:
    """Slewing, a skew hinge, a telescope and a skew wrist; air, hoses, compliance, parallel
    cylinders.
    """
    joints = [
        Joint("slew", "root", xyz=(0, 0, 1), axis=(0, 0, 1), mass=500, com=(-0.2, 0.1, 0.3)),
        Joint(
            "boom",
            "slew",
            xyz=(0.3, 0.1, 0.4),
            rpy=(0.2, -0.4, 0.1),
            axis=(0.1, -2, 0.3),
            mass=250,
        ),
        Joint(
            "slide",
            "boom",
            xyz=(0.8, 0, 0.1),
            axis=(3, 0.2, 0),
            kind="prismatic",
            limits=(-0.2, 0.4),
            mass=120,
        ),
        Joint("wrist", "slide", xyz=(1.2, 0.2, 0), rpy=(0.5, 0.2, 1), axis=(0.4, 0.5, 1), mass=60),
    ]
    cylinders = [
        CylinderSpec("turn", ("root", (0.9, 0.6, 1.1)), ("slew", (0.3, 0.9, 0.2)), extra=SOFT),
        CylinderSpec(
            "lift", ("slew", (0.9, 0, -0.3)), ("boom", (0.9, -0.1, 0.3)), bore_mm=140, rod_mm=80
        ),
        CylinderSpec("reach", ("boom", (-0.1, 0.1, 0.3)), ("slide", (0.9, 0.2, 0.35)), extra=SOFT),
        CylinderSpec(
            "swing",
            ("slide", (0.5, -0.3, 0.2)),
            ("wrist", (0.2, -0.5, 0.3)),
            bore_mm=63,
            rod_mm=36,
        ),
    ]
    return build(joints, cylinders, air_percent=1.0)


def crossing() -> Machine:
    """The second cylinder spans both joints; q in another order than the tree."""
    second = CylinderSpec("long", ("root", (-0.5, 0, 0.9)), ("stick", (-0.3, 0, 0.7)), extra=SOFT)
    return build([BOOM, STICK], [LIFT, second], order=["stick", "boom"], air_percent=0.5)


def branched() -> Machine:
    """Two arms on one root; cylinders from one to the other see a joint from behind, one of them
    across a telescope.
    """
    joints = [
        BOOM,
        replace(STICK, kind="prismatic", axis=(1, 0, 0.2), limits=(-0.2, 0.3)),
        Joint("mast", "root", xyz=(-0.6, 0.2, 0.5), rpy=(0, -1.2, 0), axis=(0.1, -1, 0)),
    ]
    tie = CylinderSpec("tie", ("mast", (1.1, 0, 0.1)), ("boom", (0.9, 0, 0.9)))
    stay = CylinderSpec("stay", ("root", (-1.2, 0.1, 0.4)), ("mast", (0.6, 0.1, 0.3)))
    reach = CylinderSpec("reach", ("mast", (0.9, 0, -0.2)), ("stick", (0.2, 0.1, 0.4)))
    return build(joints, [tie, stay, reach], payload=("stick", (1.0, 0.1, -0.2)))


def redundant(reverse: bool = False) -> Machine:
    """Four cylinders on two joints: two unlike ones on the boom, one on the stick, one across
    both.
    """
    cylinders = [
        LIFT,
        CylinderSpec(
            "help",
            ("root", (-0.6, 0, 0.2)),
            ("boom", (0.3, 0, 0.8)),
            bore_mm=63,
            rod_mm=36,
            extra=SOFT,
        ),
        FOLD,
        CylinderSpec(
            "long", ("root", (-0.5, 0, 0.9)), ("stick", (-0.3, 0, 0.7)), bore_mm=80, rod_mm=50
        ),
    ]
    return build([BOOM, STICK], cylinders[::-1] if reverse else cylinders, air_percent=0.2)


def rotator() -> Machine:
    """A motor that turns a skew wrist against gravity, between cylinders; compliance in its gear,
    hoses, air.
    """
    wrist = Joint(
        "wrist",
        "stick",
        xyz=(1.2, 0.1, 0),
        axis=(1, 0.3, 0.2),
        kind="continuous",
        com=(0.3, 0.4, 0.1),
    )
    motor = (
        "[motor.turn]\njoint = 'wrist'\ncount = 2\ndisplacement_cm3 = 160\ngear_ratio ="
        " 24\ntrapped_volume_l = { a = 0.6, b = 0.9 }\nhose = { a_l = 0.2, b_l = 0.3,"
        " bulk_modulus_MPa = 400 }\ncompliance_rad_per_N_m = 2e-7"
    )
    tilt = CylinderSpec("tilt", ("wrist", (0.2, 0, 0.5)), ("bucket", (0.3, 0.1, 0.5)))
    joints = [BOOM, STICK, wrist, replace(BUCKET, parent="wrist")]
    return build(joints, [LIFT, FOLD, tilt], more=motor, air_percent=0.3)


ANY_LIFT_AND_TORQUE = {"lift_share": 0.0, "torque_share": 0.0, "end_torque_share": 0.0}


ODD: dict[str, Callable[[], Machine]] = {
    "four_bar_left": lambda: four_bar("left"),
    "four_bar_right": lambda: four_bar("right"),
    "four_bar_from_boom": lambda: four_bar("left", ("boom", (1.4, 0, 0.9))),
    "spatial": spatial,
    "crossing": crossing,
    "branched": branched,
    "redundant": redundant,
    "rotator": rotator,
}


@cache
def named(name: str) -> Machine:
    """A shipped machine, also `rigid_<name>`, one of `ODD`, or `random_<seed>`; read once."""
    if name.startswith("random_"):
        return random_machine(int(name.removeprefix("random_")))
    if name.startswith("rigid_"):
        return rigid(name.removeprefix("rigid_"))
    if name == "heavy_bars":
        return heavy_bars()
    if name == "slewing":
        return slewing()
    if name == "rocking":
        from tests import sprung

        return sprung.rocking()
    return ODD[name]() if name in ODD else load(name)


def machine_with(machine: Machine, bands: str) -> Machine:
    """The machine whose file states these bands instead of its own."""
    text = f"{_without(machine.text, 'bands')}\n[bands]\n{bands}\n"
    return Machine.from_text(text, machine.urdf_text, machine.source)


def demanding(machine: Machine, requirements: str) -> Machine:
    """The machine whose file states these requirements instead of its own."""
    text = f"{_without(machine.text, 'requirements')}\n[requirements]\n{requirements}\n"
    return Machine.from_text(text, machine.urdf_text, machine.source)


def _without(text: str, table: str) -> str:
    """A machine file without a table and all below it."""
    return re.sub(rf"(?ms)^\[{re.escape(table)}[.\]].*?(?=^\[|\Z)", "", text)


@cache
def rigid(name: str) -> Machine:
    """A shipped machine with rigid structure, oil alone, and with nothing uncertain.

    Its designs may have any sizes, pins anywhere in their boxes, and less lift and torque. As the
    sources of many expected numbers took it.
    """
    machine = load(name)
    text = re.sub(r"(?m)^(compliance_|catalogue|torque_share).*\n", "", machine.text)
    for table in ("bands", "requirements.outline", "requirements.clearance"):
        text = _without(text, table)
    machine = Machine.from_text(text, machine.urdf_text, machine.source)
    return machine.replace({f"requirements.{key}": 0.0 for key in ANY_LIFT_AND_TORQUE})


def heavy_bars() -> Machine:
    """The rigid 20 t machine with cylinders and four-bar that weigh: masses of that order."""
    masses = {
        f"{name}.{part}_kg": mass
        for name in ("boom", "stick", "bucket")
        for part, mass in BAR_MASSES.items()
    }
    four_bar = {"bucket.four_bar.rocker_kg": 95, "bucket.four_bar.coupler_kg": 130}
    return rigid("excavator_20t").replace(
        {f"cylinder.{key}": value for key, value in (masses | four_bar).items()}
    )


def slewing() -> Machine:
    """The rigid 20 t machine free to slew on its motor, its load beside the arm's plane."""
    aside = {
        "joints": ["swing", "boom", "stick", "bucket"],
        "payload.full.at_mm": [645.0, 700.0, 435.0],
    }
    return rigid("excavator_20t").replace(aside)


def random_machine(seed: int) -> Machine:
    """One to four joints about or along any axis, each with a cylinder from some link before it,
    no dead centre.
    """
    rng = np.random.default_rng(seed)
    for _ in range(50):
        try:
            machine = _attempt(rng)
        except ArmDesignError:  # a dead centre in the range
            continue
        if _reachable(machine, rng, 200).size > 100 * len(machine.joints):
            return machine
    raise AssertionError(f"no machine from seed {seed}")


def _attempt(rng: np.random.Generator) -> Machine:
    joints: list[Joint] = []
    cylinders: list[CylinderSpec] = []
    for index in range(int(rng.integers(1, 5))):
        parent = joints[-1].name if joints else "root"
        prismatic = rng.random() < 0.25
        joints.append(
            Joint(
                f"j{index}",
                parent,
                xyz=tuple(rng.uniform(-1, 1, 3)),
                rpy=tuple(rng.uniform(-3, 3, 3)),
                axis=tuple(rng.normal(size=3)),
                kind="prismatic" if prismatic else "revolute",
                limits=(-0.1, 0.1),
                mass=float(rng.uniform(20, 400)),
                com=tuple(rng.uniform(-0.5, 0.5, 3)),
            )
        )
        before = ["root", *(joint.name for joint in joints[:-1])]
        start = before[-1] if rng.random() < 0.7 else str(rng.choice(before))
        cylinders.append(
            CylinderSpec(
                f"c{index}",
                (start, tuple(rng.uniform(-1.5, 1.5, 3))),
                (f"j{index}", tuple(rng.uniform(-1.5, 1.5, 3))),
                bore_mm=float(rng.uniform(60, 150)),
                rod_mm=float(rng.uniform(20, 55)),
                extra=SOFT if rng.random() < 0.3 else "",
            )
        )
    return build(
        joints,
        cylinders,
        payload_kg=float(rng.uniform(0, 300)),
        air_percent=float(rng.choice([0, 0.5])),
    )


def middle(machine: Machine) -> np.ndarray:
    """The middle of all joint ranges (nq,)."""
    return np.asarray(machine.ranges.mean(axis=1))


def inner_poses(machine: Machine, count: int, seed: int = 0) -> np.ndarray:
    """Poses (count, nq) inside all ranges and strokes, at which cylinders hold their joints."""
    q = _reachable(machine, np.random.default_rng(seed), 50 * count)
    assert len(q) >= count, "a machine without room to move is no test"
    return q[:count]


def _reachable(machine: Machine, rng: np.random.Generator, tries: int) -> np.ndarray:
    low, high = machine.ranges.T
    q = rng.uniform(low + 0.02 * (high - low), high - 0.02 * (high - low), (tries, len(low)))
    q = q[np.all(machine.margins(q) > 0.01, axis=1)]
    arms = machine.evaluate(machine.arm.kinematics(q)).moment_arms
    return q[np.linalg.svd(arms, compute_uv=False)[:, -1] > 0.01]
