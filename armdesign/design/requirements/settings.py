"""Requirements: what a new design must keep of today's machine, and what else it must do.

Settings and their meaning stand together in a file for each family; here they are one:
``Requirements`` has the settings of all, ``evaluations`` evaluates all on a candidate. How to add
one: ``record.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

from armdesign.arrays import Array
from armdesign.design.requirements.candidate import Candidate, Reference
from armdesign.design.requirements.holding import Holding, Lifts, holding, lifts
from armdesign.design.requirements.leverage import (
    DiggingForce,
    MomentArms,
    digging_force,
    leverage,
    transmissions,
)
from armdesign.design.requirements.lift_share import LiftShare, lift_share
from armdesign.design.requirements.oil import Oil, oil
from armdesign.design.requirements.places import PinPlaces, clearances, outlines
from armdesign.design.requirements.record import FIRST_WORDS, Concession, Evaluation, Family
from armdesign.design.requirements.speeds import Speeds, speeds
from armdesign.design.requirements.stated import Frozen, Stated, check_kind, check_numbers
from armdesign.design.requirements.strength import (
    Buckling,
    CylinderMass,
    Thrust,
    cylinder_mass,
    strength,
)
from armdesign.design.requirements.strokes_and_boxes import PinBoxes
from armdesign.design.requirements.torque import Torques, torques
from armdesign.errors import ArmDesignError, choose
from armdesign.machine.machine import Machine
from armdesign.short_repr import short_repr


@dataclass(frozen=True, kw_only=True)
class Requirements(
    PinPlaces,
    Lifts,
    Speeds,
    CylinderMass,
    PinBoxes,
    Buckling,
    DiggingForce,
    LiftShare,
    Torques,
    MomentArms,
    Thrust,
    Oil,
    Holding,
    Frozen,
):
    """Limits of a new design: shares of what today's machine has, or absolute.

    Each base is a family of requirements and has its attributes.
    """

    __repr__ = short_repr

    def __post_init__(self) -> None:
        for name, how in self._stated().items():
            object.__setattr__(self, name, how.completed(getattr(self, name)))
        super().__post_init__()
        for field in fields(self):
            if str(field.type).startswith("float"):
                path, value = f"requirements.{field.name}", getattr(self, field.name)
                check_kind(path, value, str(field.type))
        for name, value in vars(self).items():
            check_numbers(f"requirements.{name}", value)
        for name, value in vars(self).items():
            if isinstance(value, float | int) and value < 0:
                raise ArmDesignError(
                    f"requirements.{name}", f"{value!r} is not allowed", "give a number ≥ 0"
                )
        for name, how in self._stated().items():
            how.check(getattr(self, name))

    @classmethod
    def of(cls, machine: Machine, **instead: Any) -> Requirements:
        """The requirements that the machine's file states; of cylinders that stand still none.

        Example: ``Requirements.of(machine, lift_share=0.95)``.

        Args:
            machine: today's machine.
            instead: other values by their keys under ``[requirements]``, in the file's units.

        Raises:
            MachineFileError: a key or value that the file cannot have.

        Example:
            >>> import armdesign as ad
            >>> machine = ad.load("paper_1dof")
            >>> print(ad.Requirements.of(machine, lift_share=0.95).lift_share)
            0.95
        """
        if instead:
            machine = machine.replace({f"requirements.{key}": x for key, x in instead.items()})
        return cls(**{name: how.read(machine) for name, how in cls._stated().items()})

    @property
    def identity(self) -> dict[str, str]:
        """Everything in which two can differ, with every bit of a number."""
        return {name: repr(value) for name, value in vars(self).items()}

    @classmethod
    def _stated(cls) -> dict[str, Stated]:
        """Statement of each field in the file."""
        return {field.name: field.metadata["stated"] for field in fields(cls)}

    def _field(self, path: str) -> tuple[str, Stated, str]:
        """The field whose key a path begins with, how it is stated, and the rest of the path."""
        matches = [
            (name, how, subkey)
            for name, how in self._stated().items()
            if (subkey := how.subkey(path)) is not None
        ]
        return max(matches, key=lambda each: len(each[1].key))

    def setting(self, path: str) -> float:
        """A number by its key under ``[requirements]`` of a machine file, in that key's unit.

        ``thrust_share.NAME`` is the share of one actuator, its own or the common one. 1 for
        ``speed.NAME``: see ``with_setting``.
        """
        name, how, subkey = self._field(path)
        return how.number_of(getattr(self, name), subkey)

    def stated_at(self, path: str) -> str:
        """Key of the number at a key path: the common one where an actuator has no own number."""
        name, how, subkey = self._field(path)
        return how.key if subkey and not how.own(getattr(self, name), subkey) else path

    def with_setting(self, path: str, value: float) -> Requirements:
        """The requirements with a number changed by its key, in that key's unit.

        ``thrust_share.NAME`` changes the share of one actuator alone.
        ``speed.NAME`` stands for all speeds of a motion; ``value`` is then a factor on them.
        """
        name, how, subkey = self._field(path)
        change: dict[str, Any] = {name: how.changed(getattr(self, name), subkey, value)}
        return replace(self, **change)

    def granting(self, conflict: Iterable[Concession]) -> Requirements:
        """The requirements that give what a conflict says, all of it."""
        changed = self
        for concession in conflict:
            if concession.value is not None:
                changed = changed.with_setting(concession.setting, concession.value)
        return changed

    def refuse_unknown(self, machine: Machine) -> None:
        """Raise where a cylinder, joint or link is named that the machine does not have.

        Raises:
            ArmDesignError: such a name.
        """
        for field_name, how in self._stated().items():
            for path, kind, names, known in how.names(getattr(self, field_name), machine):
                for name in names:
                    if name not in known:
                        fault, remedy = f'no {kind} "{name}"', choose(name, known)
                        raise ArmDesignError(f"requirements.{path}", fault, remedy)


FAMILIES: tuple[Family, ...] = (
    *(oil, strength, leverage, torques, transmissions, speeds, lifts, lift_share),
    *(digging_force, outlines, clearances, cylinder_mass),
)


def evaluations(
    new: Candidate,
    reference: Reference,
    forces: Callable[[], Array],
    wanted: Collection[str] | None = None,
) -> Iterator[Evaluation]:
    """Every requirement that a design can miss, with its static forces (b, k, nc) [N].

    If names are ``wanted``, families without any of them are left out.
    """
    first_words = None if wanted is None else {name.split(".")[0] for name in wanted}
    for family in FAMILIES:
        if first_words is None or not first_words.isdisjoint(FIRST_WORDS[family]):
            yield from family(new, reference)
    if first_words is None or "holding" in first_words:
        yield from holding(new, reference, forces())
