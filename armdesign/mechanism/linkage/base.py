"""Base of all linkages: length, moment arm and its derivative, from the motion of the rod end.

ℓ(q) is the distance between base pin B and rod end P; its derivatives are the moment arm
r = ∂ℓ/∂q and the moment-arm derivative H = ∂²ℓ/∂q². All is seen from one link, the observer; any
number of revolute or prismatic joints may lie between the pins. Axis 0 is the pose.

The formulas are written on jets, so ℓ = |P − B| carries r and H with it: r_j = d·d_j/ℓ,
H_jk = (d_j·d_k + d·d_jk − r_j r_k)/ℓ  with d = P − B.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, Self, TypeAlias

import numpy as np

from armdesign.arrays import Array, Flags, side_by_side
from armdesign.errors import MachineFileError
from armdesign.mechanism.arm import Arm
from armdesign.mechanism.jets import Jet, ScalarJet, VectorJet, dot
from armdesign.mechanism.rigid_poses import RigidPoses

Move: TypeAlias = tuple[str, int]  # a place and which of its coordinates


@dataclass(frozen=True, kw_only=True)
class Pin:
    """A pin of a link, at [m] in the link's frame."""

    link: str
    at: tuple[float, float, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "at", tuple(self.at))  # a list has no hash


class Actuation(Jet):
    """A length over n poses, with its derivatives by all k coordinates, zero for springs."""

    @property
    def length(self) -> Array:
        """(n,) [m]."""
        return self.value

    @property
    def moment_arm(self) -> Array:
        """(n, k) [m/rad]."""
        return self.first

    @property
    def moment_arm_derivative(self) -> Array:
        """(n, k, k), computed when it is asked for."""
        return self.second


class Drive(ABC):
    """Motion that an actuator gives the joints of the arm."""

    @property
    @abstractmethod
    def joints(self) -> tuple[int, ...]:
        """Coordinates that change the actuator's length."""

    @abstractmethod
    def length(self, poses: RigidPoses) -> Array:
        """Length (n,) [m]; NaN where the linkage does not close."""

    @abstractmethod
    def actuation(self, poses: RigidPoses) -> Actuation:
        """Length, moment arm and its derivative at the poses."""

    @abstractmethod
    def record(self) -> dict[str, Any]:
        """Record for compiled code: numbers, directions and pins by field."""


def moment_arms(drives: Iterable[Drive], poses: RigidPoses) -> Array:
    """Moment arms ∂ℓ/∂q of drives about all coordinates (n, nc, k) [m/rad]."""
    return np.stack([drive.actuation(poses).moment_arm for drive in drives], axis=1)


@dataclass(frozen=True, kw_only=True)
class Linkage(Drive):
    """Connection of a cylinder to the links: a base pin on a link, and a rod end somewhere.

    What a design may move is named by a place: a pin with three coordinates in its link, or a bar
    with one, its length. A place is a field of that name.

    To add a kind of linkage:

    1. A subclass in a file of its own: fields, class attributes, ``rod_end_from`` and, where they
       apply, ``observer``, ``closure``, ``fault``, ``transmission``; its name in ``kinds.py``.
    2. Its table in ``machine/file/schema.py``, in ``CylinderSection`` under its ``key``: a pin for
       each of ``pin_names``, a length ``…_mm`` and a mass ``…_kg`` for each of ``bar_names``.
       ``machine/file/json_schema.py`` describes them to editors.

    It is then simulated by its ``rod_end_record``, and exported as a robot by its ``legs``.
    """

    key: ClassVar[str]  # in the cylinder's table of the machine file
    title: ClassVar[str]  # in messages
    pin_names: ClassVar[tuple[str, ...]]
    bar_names: ClassVar[tuple[str, ...]] = ()
    # bars from a pin to the rod end, each with its pin
    legs: ClassVar[tuple[tuple[str, str], ...]] = ()
    rod_end_name: ClassVar[str] = "rod_end"  # of the point where it is, in tables and pictures
    rod_end_words: ClassVar[str] = ""  # where the rod end is if no pin of a link
    transmission_words: ClassVar[str] = ""  # the angle of ``transmission``; none if ""
    closing_words: ClassVar[str] = ""  # what lets it close

    base: Pin
    arm: Arm = field(repr=False, compare=False)

    # -------------------------------------------------------------------------------------- places

    @property
    def places(self) -> tuple[str, ...]:
        """Names of all pins and bars."""
        return (*self.pin_names, *self.bar_names)

    @property
    def own_places(self) -> tuple[str, ...]:
        """Names of the pins and bars in the kind's own table, which move the rod end."""
        return tuple(name for name in self.places if name not in ("base", self.key))

    @property
    def pins(self) -> tuple[Pin, ...]:
        """Every pin on a link."""
        return tuple(getattr(self, name) for name in self.pin_names)

    @classmethod
    def key_of(cls, place: str) -> str:
        """Key of a place in the cylinder's table of the machine file."""
        key = f"{place}_mm" if place in cls.bar_names else f"{place}.at_mm"
        return key if place in ("base", cls.key) else f"{cls.key}.{key}"

    @classmethod
    def mass_key_of(cls, bar: str) -> str:
        """Key of a bar's mass in the cylinder's table, of barrel and rod too."""
        return f"{cls.key}.{bar}_kg" if bar in cls.bar_names else f"{bar}_kg"

    def pin(self, name: str) -> Pin | None:
        """A pin by its name; None where the linkage has no such pin."""
        return getattr(self, name) if name in self.pin_names else None

    def place(self, name: str) -> tuple[float, ...] | None:
        """Coordinates of a pin in its link (3) or length of a bar (1) [m]; None if neither."""
        if name in self.bar_names:
            return (getattr(self, name),)
        pin = self.pin(name)
        return None if pin is None else pin.at

    def with_places(self, places: Mapping[str, Sequence[float]]) -> Self:
        """The linkage with pins elsewhere in their links and bars of other lengths [m], by name.

        Raises:
            ValueError: it has no such place.
        """
        changed: dict[str, Any] = {}
        for name, at in places.items():
            self._refuse_unknown(name)
            pin = self.pin(name)
            place: Any = tuple(at)
            changed[name] = at[0] if pin is None else replace(pin, at=place)
        return replace(self, **changed)

    def _refuse_unknown(self, place: str) -> None:
        if place not in self.places:
            raise ValueError(f"this cylinder has no {place!r}")

    # ------------------------------------------------------------------------ what a kind decides

    @property
    def mirrored(self) -> tuple[str, str, str, Self] | None:
        """Key of a word that could be another, it, the other, and the linkage with that."""
        return None

    @property
    def observer(self) -> str:
        """The link from which all motion is seen."""
        return self.base.link

    @abstractmethod
    def rod_end_from(self, poses: RigidPoses, link: str, joints: tuple[int, ...]) -> VectorJet:
        """The rod end seen from a link, with derivatives by some joints.

        Complex-safe; places may differ by row.
        """

    @abstractmethod
    def rod_end_record(self) -> dict[str, Any]:
        """Record of the rod end for compiled code: a pin ``far``, or a knee.

        A knee is where two bars meet, ``rocker`` from a pin ``pivot`` and ``coupler`` to a pin
        ``far``, of these lengths [m], on a ``side`` (±1) of the line pivot → far. It lies in the
        plane of the directions ``right`` and ``up`` in the frame of the pivot's joint.
        """

    def closure(self, poses: RigidPoses) -> Array:
        """How far the linkage is from where it opens (n,); with slopes beyond, where it is < 0."""
        return np.ones(len(poses))

    def closes(self, poses: RigidPoses) -> Flags:
        """Whether the linkage can be assembled (n,)."""
        return np.asarray(self.closure(poses) > 0)

    def fault(self, where: str) -> MachineFileError | None:
        """Fault where links and joints do not suit the kind; ``where`` names its cylinder."""
        return None

    def transmission(self, poses: RigidPoses) -> Array:
        """Cosine of the transmission angle (n,); complex-safe, places may differ by row."""
        raise NotImplementedError(f"{self.title}: no transmission angle")

    # ---------------------------------------------------------------------------------- what moves

    @cached_property
    def joints(self) -> tuple[int, ...]:
        """Coordinates that change the length."""
        paths = (self.arm.path(self.observer, pin.link) for pin in self.pins)
        return tuple(sorted({j for path in paths for j, _ in path}))

    def length(self, poses: RigidPoses) -> Array:
        """Pin-to-pin length (n,) [m]; NaN where the linkage does not close."""
        few, back = self._distinct(poses)
        end = self.rod_end_from(few, self.observer, ())
        span = (end - self._motion(few, self.base, self.observer, ())).value
        return np.asarray(np.sqrt(dot(span, span))[back])

    def idle_length(self) -> float:
        """Length [m] of a cylinder that no joint moves; NaN where the linkage does not close."""
        with np.errstate(invalid="ignore"):
            return float(self.length(self.arm.zero)[0])

    def actuation(self, poses: RigidPoses) -> Actuation:
        """Length, moment arm and its derivative at the poses."""
        few, back = self._distinct(poses)
        span = self.span(few)
        return self._scatter(span.dot(span).sqrt(), back)

    def stepped(self, moves: Sequence[Move], step: float, count: int) -> Self:
        """The linkage with a complex step along each of k coordinates of places, by row.

        In k·``count`` rows: ``count`` of them for each coordinate. The imaginary part of what is
        computed from it, over the step, is its exact derivative.
        """
        at: dict[str, Array] = {}
        for k, (name, axis) in enumerate(moves):
            if name not in at:
                self._refuse_unknown(name)
                at[name] = np.array([self.place(name)] * len(moves), dtype=complex)
            at[name][k, axis] += 1j * step
        places = {name: list(np.repeat(rows, count, axis=0).T) for name, rows in at.items()}
        return self.with_places(places)

    def stepped_actuation(
        self, poses: RigidPoses, moves: Sequence[Move], step: float
    ) -> Actuation:
        """The actuation with a complex step along each of k coordinates of places (k·n, …)."""
        few, back = self._distinct(poses)
        span = self.stepped(moves, step, len(few)).span(few.repeated(len(moves)))
        if not isinstance(back, slice):
            back = np.add.outer(len(few) * np.arange(len(moves)), back).ravel()
        return self._scatter(span.dot(span).sqrt(), back)

    def span(self, poses: RigidPoses) -> VectorJet:
        """The vector from base pin to rod end, seen from the observer."""
        end = self.rod_end_from(poses, self.observer, self.joints)
        return end - self._motion(poses, self.base, self.observer, self.joints)

    def ends(self, poses: RigidPoses) -> tuple[Array, Array]:
        """World positions (n, 3) [m] of base pin and rod end."""
        end = self.rod_end_from(poses, self.observer, ())
        return self.point(poses, self.base), end.value

    def point(self, poses: RigidPoses, pin: Pin) -> Array:
        """World position (n, 3) [m] of a pin."""
        return self.arm.point(poses, pin.link, side_by_side(pin.at))

    def bars(
        self,
        poses: RigidPoses,
        length: float,
        seen_from: str | None = None,
        joints: tuple[int, ...] | None = None,
        names: Collection[str] | None = None,
    ) -> dict[str, tuple[VectorJet, VectorJet]]:
        """Both ends of moving bars seen from a link, with derivatives by some coordinates.

        From the root, by all of them, where none are given; of all bars, or at least of those of
        some ``names``. Barrel and rod are as long as the closed cylinder, ``length`` [m]: one from
        the base pin, one up to the rod end.
        """
        root = self.arm.root if seen_from is None else seen_from
        joints = tuple(range(len(self.arm.coordinates))) if joints is None else joints
        end = self.rod_end_from(poses, root, joints)
        legs = {
            bar: (self._motion(poses, getattr(self, pin), root, joints), end)
            for bar, pin in self.legs
        }
        if names is not None and legs.keys() >= set(names):
            return legs
        base = self._motion(poses, self.base, root, joints)
        span = end - base
        along = span * (span.dot(span).sqrt().reciprocal() * length)
        return {"barrel": (base, base + along), "rod": (end - along, end), **legs}

    def record(self) -> dict[str, Any]:
        """Record for compiled code: numbers, directions and pins by field."""
        return {"base": self.base, **self.rod_end_record()}

    def _motion(
        self, poses: RigidPoses, pin: Pin, link: str, joints: tuple[int, ...]
    ) -> VectorJet:
        """A pin seen from a link."""
        return self.arm.motion(poses, pin.link, side_by_side(pin.at), link, joints)

    def _distinct(self, poses: RigidPoses) -> tuple[RigidPoses, Array | slice]:
        """Poses at which the length differs, and for every pose which of them has its length."""
        if len(self.joints) != 1:
            return poses, slice(None)
        return poses.alone(self.joints[0], self.arm.placed_alone)

    def _scatter(self, jet: ScalarJet, back: Array | slice) -> Actuation:
        """From the linkage's joints to all coordinates of the arm, and ``back`` to all poses."""
        length, k = jet.value[back], len(self.arm.coordinates)
        moment_arm = np.zeros((len(length), k), length.dtype, order="F")
        for a, joint in enumerate(self.joints):
            moment_arm[:, joint] = jet.first[back, a]

        def derivative() -> Array:
            whole = np.zeros((len(length), k, k), length.dtype, order="F")
            for a, joint in enumerate(self.joints):
                for b, other in enumerate(self.joints):
                    whole[:, joint, other] = jet.second[back, a, b]
            return whole

        return Actuation(length, moment_arm, derivative)


def follows(drives: Sequence[Drive], i: int, joint: int) -> bool:
    """Whether a drive across several joints goes along about one that another moves alone.

    Its moment arm may vanish there: that is no dead centre.
    """
    others = (drive for k, drive in enumerate(drives) if k != i)
    return len(drives[i].joints) > 1 and any(other.joints == (joint,) for other in others)
