"""Any machine: one to six joints, each turned or moved by some linkage, a motor or on a spring.

Hypothesis draws what each joint is; the numbers come from a seed, tried until no dead centre lies
in the ranges. A draft is what a machine is made of, so that what must not matter can be changed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from hypothesis import reject
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from armdesign import ArmDesignError, Machine
from armdesign.errors import TopplingError
from tests.machines import SOFT, CylinderSpec, Joint, build
from tests.sprung import VALVE, spring

CYLINDERS = ("turned", "pushed", "four-bar", "four-bar on the child")
SPRINGS = ("on a spring", "on a sliding spring")
KINDS = (*CYLINDERS, "motor", *SPRINGS)
LIMIT = 0.12  # [rad, m] of every joint, either way
POSES = 3
NO_ROOM = "no room"
# what random pins may do; other refusals are faults
UNLUCKY = ("at its dead centre", "opens at", "leave a direction of motion free", NO_ROOM)


@dataclass(frozen=True)
class MotorSpec:
    """A motor on a joint: oil trapped on either side, and of it in hoses [l]."""

    joint: str
    gear_ratio: float
    trapped: tuple[float, float]
    hose: tuple[float, float]
    compliance: float

    def table(self) -> str:
        a, b = self.trapped
        return (
            f"[motor.{self.joint}_motor]\njoint = '{self.joint}'\ndisplacement_cm3 = 160\n"
            f"gear_ratio = {self.gear_ratio!r}\ntrapped_volume_l = {{ a = {a!r}, b = {b!r} }}\n"
            f"hose = {{ a_l = {self.hose[0]!r}, b_l = {self.hose[1]!r} }}\n"
            f"compliance_rad_per_N_m = {self.compliance!r}\n{VALVE}"
        )


@dataclass(frozen=True)
class SpringSpec:
    """A spring on a joint, which stands at a place [deg, mm]."""

    joint: str
    stiffness: float
    at: float
    turns: bool

    def table(self) -> str:
        unit = "deg" if self.turns else "mm"
        at = f"at_{unit} = {self.at!r}"
        return spring(f"{self.joint}_spring", self.joint, self.stiffness, at, self.turns)


@dataclass(frozen=True)
class Draft:
    """What a machine is made of."""

    joints: tuple[Joint, ...]
    cylinders: tuple[CylinderSpec, ...]
    motors: tuple[MotorSpec, ...]
    springs: tuple[SpringSpec, ...]
    order: tuple[str, ...]  # of q
    payload_kg: float
    air_percent: float
    bar_kg: tuple[float, float]  # of every rocker and coupler

    def machine(self) -> Machine:
        tables = [part.table() for part in (*self.motors, *self.springs)]
        machine = build(
            list(self.joints),
            list(self.cylinders),
            order=list(self.order),
            payload_kg=self.payload_kg,
            air_percent=self.air_percent,
            more="\n\n".join(tables),
        )
        bars = zip(("rocker_kg", "coupler_kg"), self.bar_kg, strict=True)
        masses = {
            f"cylinder.{cylinder.name}.four_bar.{key}": mass
            for key, mass in bars
            for cylinder in self.cylinders
            if cylinder.pivot and mass
        }
        return machine.replace(masses) if masses else machine

    def reversed(self, index: int) -> Draft:
        """The same machine with the axis of one joint the other way round."""
        joints, name = list(self.joints), self.joints[index].name
        x, y, z = joints[index].axis
        joints[index] = replace(joints[index], axis=(-x, -y, -z))
        return replace(
            self,
            joints=tuple(joints),
            motors=tuple(
                replace(m, trapped=m.trapped[::-1], hose=m.hose[::-1]) if m.joint == name else m
                for m in self.motors
            ),
            springs=tuple(replace(s, at=-s.at) if s.joint == name else s for s in self.springs),
        )


@dataclass(frozen=True)
class AnyMachine:
    """A draft, its machine, and poses (n, nq) well away from dead centres."""

    draft: Draft
    machine: Machine
    q: np.ndarray

    def __repr__(self) -> str:
        """Short: Hypothesis refuses texts of many kB in place of the fault that it has found."""
        return f"AnyMachine with joints {', '.join(self.machine.joints)} at {self.q.tolist()}"


@st.composite
def any_machines(draw: st.DrawFn) -> AnyMachine:
    kinds = draw(
        st.lists(st.sampled_from(KINDS), min_size=1, max_size=6).filter(
            lambda kinds: any(kind in CYLINDERS for kind in kinds)  # a machine has one
        )
    )
    flat = draw(st.booleans())
    more = draw(st.booleans())
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    for _ in range(40):
        draft = _Sketch(rng, kinds, flat, more).draft()
        try:
            machine = draft.machine()
            return AnyMachine(draft, machine, _poses(machine, rng))
        except TopplingError:
            continue
        except ArmDesignError as error:
            if not any(words in error.fault for words in UNLUCKY):
                raise
    reject()


def _poses(machine: Machine, rng: np.random.Generator) -> np.ndarray:
    low, high = machine.ranges.T
    q = rng.uniform(low + 0.02 * (high - low), high - 0.02 * (high - low), (60, len(low)))
    q = q[np.all(machine.margins(q) > 0.01, axis=1)]
    arms = machine.evaluate(machine.arm.kinematics(q)).moment_arms[:, :, : len(low)]
    q = q[np.linalg.svd(arms, compute_uv=False)[:, -1] > 0.01][:POSES]
    if len(q) < POSES:
        raise ArmDesignError("machine", NO_ROOM)
    machine.at(q)
    return q


class _Sketch:
    """Numbers for joints of these kinds, one behind the other."""

    def __init__(self, rng: np.random.Generator, kinds: list[str], flat: bool, more: bool) -> None:
        self.rng, self.kinds, self.flat, self.more = rng, kinds, flat, more
        self.joints: list[Joint] = []
        self.cylinders: list[CylinderSpec] = []
        self.motors: list[MotorSpec] = []
        self.springs: list[SpringSpec] = []
        self.before = ["root"]  # links since the last spring, which no cylinder may span

    def draft(self) -> Draft:
        for index, kind in enumerate(self.kinds):
            self.add(f"j{index}", kind)
        driven = [k for k, kind in enumerate(self.kinds) if kind not in SPRINGS]
        if self.more and self.kinds[-1] not in SPRINGS:
            self.cylinders.append(self.cylinder("more", self.before[-1], self.before[:-1]))
        light = self.rng.random() < 0.5
        return Draft(
            joints=tuple(self.joints),
            cylinders=tuple(self.cylinders),
            motors=tuple(self.motors),
            springs=tuple(self.springs),
            order=tuple(f"j{k}" for k in self.rng.permutation(driven)),
            payload_kg=self.number(0, 300),
            air_percent=float(self.rng.choice([0.0, 0.5])),
            bar_kg=(0.0, 0.0) if light else (self.number(1, 30), self.number(1, 30)),
        )

    def number(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def point(self, size: float) -> tuple[float, ...]:
        return tuple(self.rng.uniform(-size, size, 3).tolist())

    def add(self, name: str, kind: str) -> None:
        slides = kind in ("pushed", "on a sliding spring")
        in_plane = self.flat or kind.startswith("four-bar")
        skew = kind == "four-bar on the child"  # it lies in the child's plane
        axis = tuple(self.rng.normal(size=3).tolist())
        if in_plane:
            axis = (1.0, 0.0, 0.0) if slides else (0.0, float(self.rng.choice([-1, 1])), 0.0)
        rpy = self.point(3.0) if not in_plane or (skew and not self.flat) else None
        endless = kind == "motor" and self.rng.random() < 0.5
        self.joints.append(
            Joint(
                name,
                self.joints[-1].name if self.joints else "root",
                xyz=self.point(1.0),
                rpy=rpy or (0.0, self.number(-3, 3), 0.0),
                axis=axis,
                kind="prismatic" if slides else "continuous" if endless else "revolute",
                limits=(-LIMIT, LIMIT),
                mass=self.number(20, 400),
                com=self.point(0.5),
            )
        )
        if kind in SPRINGS:
            at = self.number(-2, 2) * (10 if slides else 1)
            self.springs.append(SpringSpec(name, 10 ** self.number(6, 7.5), at, not slides))
            self.before = []
        elif kind == "motor":
            self.motors.append(self.motor(name))
        else:
            self.cylinders.append(self.cylinder(f"{name}_cylinder", name, self.before, kind))
        self.before.append(name)

    def motor(self, joint: str) -> MotorSpec:
        a, b = self.number(0.4, 1), self.number(0.4, 1)
        soft = self.rng.random() < 0.5
        return MotorSpec(
            joint,
            gear_ratio=self.number(50, 150),
            trapped=(a, b),
            hose=(0.3 * a, 0.2 * b) if soft else (0.0, 0.0),
            compliance=2e-8 if soft else 0.0,
        )

    def cylinder(
        self, name: str, link: str, before: list[str], kind: str = "turned"
    ) -> CylinderSpec:
        start = before[-1] if self.rng.random() < 0.7 else str(self.rng.choice(before))
        extra = [VALVE]
        if self.rng.random() < 0.3:
            extra.append(SOFT)
        if self.rng.random() < 0.5:
            extra.append(f"barrel_kg = {self.number(1, 60)!r}\nrod_kg = {self.number(1, 40)!r}")
        cylinder = CylinderSpec(
            name,
            (start, self.point(1.5)),
            bore_mm=self.number(60, 150),
            rod_mm=self.number(20, 55),
            extra="\n".join(extra),
        )
        if not kind.startswith("four-bar"):
            return replace(cylinder, rod_end=(link, self.point(1.5)))
        return self.four_bar(cylinder, on_child=kind == "four-bar on the child")

    def four_bar(self, cylinder: CylinderSpec, on_child: bool) -> CylinderSpec:
        """Both pins around the joint, and bars about as long as they are apart.

        Whatever the joint's frame, they turn about its y axis.
        """
        joint = self.joints[-1]
        near, far = np.array(self.point(0.4)), np.array(self.point(0.4))
        apart = float(np.hypot(*(near - far)[[0, 2]]))
        turned = Rotation.from_euler("xyz", joint.rpy).apply(far) + joint.xyz
        pins = [(joint.name, tuple(near.tolist())), (joint.parent, tuple(turned.tolist()))]
        pivot, lug = pins if on_child else pins[::-1]
        return replace(
            cylinder,
            pivot=pivot,
            lug=lug,
            rocker=apart * self.number(0.75, 1.3),
            coupler=apart * self.number(0.75, 1.3),
            knee=str(self.rng.choice(["left", "right"])),
        )
