"""Design variables: words and key paths of the machine file become the entries of x.

``areas`` are all bores and rods; ``pins`` the base and rod-end pins; ``linkages`` those and all of
the four-bars. A key path names one thing or all below it: ``cylinder.boom``,
``cylinder.boom.bore_mm``, ``cylinder.boom.base``, ``cylinder.boom.base.at_mm.0`` (one coordinate),
``cylinder.bucket.four_bar.rocker_mm``. A pin named as a whole moves in its link's x–z plane;
across it only where its ``at_mm.1`` is named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from armdesign.errors import ArmDesignError, choose
from armdesign.machine.machine import Machine
from armdesign.mechanism.linkage.kinds import KINDS

WORDS = {
    "areas": ("bore_mm", "rod_mm"),
    "pins": ("base", "rod_end"),
    "linkages": ("base", *(kind.key for kind in KINDS)),
}
SIZES = ("bore_mm", "rod_mm")
IN_PLANE = (0, 2)


@dataclass(frozen=True, kw_only=True)
class Variable:
    """One entry of x: an area of an actuator, or a coordinate of a place of its linkage.

    Attributes:
        cylinder: number of the actuator.
        pin: place of the linkage: a pin, or a bar of its four-bar; None for an area.
        axis: of an area 0 for the bore and 1 for the annulus; of a pin the coordinate in its link;
            of a bar 0, its length.
        free: whether it may change.
    """

    cylinder: int
    pin: str | None
    axis: int
    free: bool = True


def variables(machine: Machine, vary: Sequence[str], pins_move: bool) -> tuple[Variable, ...]:
    """Entries of x: all areas, free where they vary, then the coordinates that move.

    Args:
        machine: today's machine.
        vary: words and key paths.
        pins_move: whether anything but areas may vary.

    Raises:
        ArmDesignError: a word or path that names nothing, or nothing that can vary.
    """
    paths = chosen(machine, vary)
    areas = [
        Variable(cylinder=i, pin=None, axis=axis, free=f"cylinder.{actuator.name}.{key}" in paths)
        for i, actuator in enumerate(machine.actuators)
        for axis, key in enumerate(SIZES)
    ]
    coordinates = [
        Variable(cylinder=i, pin=place, axis=axis)
        for i in range(len(machine.cylinders) if pins_move else 0)
        for path, (place, axis) in _coordinates(machine, i).items()
        if path in paths
    ]
    return (*areas, *coordinates)


def chosen(machine: Machine, vary: Sequence[str]) -> set[str]:
    """Key paths of the single numbers that words and key paths stand for.

    Raises:
        ArmDesignError: a word or path that names nothing, or nothing that can vary.
    """
    if not vary or isinstance(vary, str):
        raise ArmDesignError(
            "vary", f"{vary!r} is not allowed", f"give some of {', '.join(WORDS)} and key paths"
        )
    if not machine.cylinders:
        remedy = "make a joint that a cylinder moves a coordinate"
        raise ArmDesignError("vary", "no cylinder of the machine moves: nothing can vary", remedy)
    known = _known(machine)
    places: set[str] = set()
    for word in vary:
        names = (
            [f"cylinder.{c.name}.{key}" for c in machine.cylinders for key in WORDS[word]]
            if word in WORDS
            else []
        )
        if not names and word not in known:
            raise _unknown(machine, word, list(known))
        for name in names or [word]:
            places |= known.get(name, set())
    return places


def _known(machine: Machine) -> dict[str, set[str]]:
    """Every path that may be asked for and the single numbers that it stands for."""
    known: dict[str, set[str]] = {}
    for i, cylinder in enumerate(machine.cylinders):
        plain = {f"cylinder.{cylinder.name}.{key}": True for key in SIZES}
        for path, (place, axis) in _coordinates(machine, i).items():
            plain[path] = place in machine.linkages[i].bar_names or axis in IN_PLANE
        for path, by_default in plain.items():
            parts = path.split(".")
            for count in range(2, len(parts) + 1):
                if by_default or count == len(parts):
                    known.setdefault(".".join(parts[:count]), set()).add(path)
    return known


def _coordinates(machine: Machine, i: int) -> dict[str, tuple[str, int]]:
    """Paths of the coordinates of a cylinder's linkage that can move, each with place and axis.

    None across several joints: its range depends on other cylinders too, so its stroke would not
    follow from its pins.
    """
    linkage, name = machine.linkages[i], machine.cylinders[i].name
    if len(linkage.joints) != 1:
        return {}
    coordinates: dict[str, tuple[str, int]] = {}
    for place in linkage.places:
        path = f"cylinder.{name}.{linkage.key_of(place)}"
        if place in linkage.bar_names:
            coordinates[path] = (place, 0)
        else:
            coordinates |= {f"{path}.{axis}": (place, axis) for axis in range(3)}
    return coordinates


def _unknown(machine: Machine, word: str, known: list[str]) -> ArmDesignError:
    """The error for a word or path that nothing varies by."""
    for name, frozen in machine.idle.items():
        if f"{word}.".startswith(f"cylinder.{name}."):
            fault = f"the {name} cylinder stands still: joint {', '.join(frozen)} is frozen"
            return ArmDesignError(
                f"vary {word}", fault, "vary another one, or make the joint a coordinate"
            )
    for cylinder, linkage in zip(machine.cylinders, machine.linkages, strict=True):
        places = [f"cylinder.{cylinder.name}.{linkage.key_of(place)}" for place in linkage.places]
        if len(linkage.joints) > 1 and any(
            f"{path}.".startswith(f"{word}.") or word.startswith(path) for path in places
        ):
            joints = " and ".join(f'"{machine.joints[j]}"' for j in linkage.joints)
            return ArmDesignError(
                f"vary {word}",
                f"the {cylinder.name} cylinder moves {joints}, so its stroke does not follow from"
                " its pins",
                "vary its bore_mm or rod_mm",
            )
    top = [path for path in known if path.count(".") <= 2]
    remedy = choose(word, [*WORDS, *known])
    return ArmDesignError(
        f"vary {word}",
        "nothing of this name can vary",
        remedy if "mean" in remedy else choose("", [*WORDS, *top]),
    )
