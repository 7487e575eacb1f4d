"""What a design may vary: words and key paths of the machine file become the entries of x.

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
LEAST = 0.1  # an area, over today's


@dataclass(frozen=True, kw_only=True)
class Variable:
    """One entry of x: an area of a cylinder (``pin`` None.

    Axis 0 bore, 1 annulus) or a coordinate of its linkage.

    ``pin`` is then a place of the linkage: a pin, or a bar of its four-bar, whose only coordinate
    (0) is its length.
    """

    cylinder: int
    pin: str | None
    axis: int
    lower: float
    upper: float


def variables(
    machine: Machine, vary: Sequence[str], box: float, largest_area: float
) -> list[Variable]:
    """Entries of x: all areas (fixed unless they vary, and always of motors), then the coordinates that move.

    Args:
        machine: today's machine.
        vary: words and key paths.
        box: how far a coordinate may move [m]; nothing moves if it is zero.
        largest_area: upper end of an area, over today's.

    Raises:
        ArmDesignError: a word or path that names nothing, or nothing that can vary.
    """
    asked = chosen(machine, vary)
    made = []
    for i, actuator in enumerate(machine.actuators):
        bore, rod = (f"cylinder.{actuator.name}.{key}" in asked for key in SIZES)
        for axis, free in ((0, bore), (1, rod)):
            low, high = (LEAST, max(2.0, largest_area)) if free else (1.0, 1.0)
            if (
                axis == 0 and bore and not rod
            ):  # the annulus is what the bore leaves around today's rod
                low = 1 - (1 - LEAST) * actuator.annulus_area / actuator.bore_area
            made.append(Variable(cylinder=i, pin=None, axis=axis, lower=low, upper=high))
    for i in range(len(machine.cylinders)) if box > 0 else ():
        for path, (place, axis) in _coordinates(machine, i).items():
            if path in asked:
                made.append(Variable(cylinder=i, pin=place, axis=axis, lower=-1.0, upper=1.0))
    return made


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
    found: set[str] = set()
    for word in vary:
        names = (
            [f"cylinder.{c.name}.{key}" for c in machine.cylinders for key in WORDS[word]]
            if word in WORDS
            else []
        )
        if not names and word not in known:
            raise _unknown(machine, word, list(known))
        for name in names or [word]:
            found |= known.get(name, set())
    return found


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
    """Paths of the coordinates of a cylinder's linkage that can move: its place and which of its coordinates.

    None across several joints: its range depends on other cylinders too, so its stroke would not
    follow from its pins.
    """
    linkage, name = machine.linkages[i], machine.cylinders[i].name
    if len(linkage.joints) != 1:
        return {}
    found: dict[str, tuple[str, int]] = {}
    for place in linkage.places:
        path = f"cylinder.{name}.{linkage.key_of(place)}"
        if place in linkage.bar_names:
            found[path] = (place, 0)
        else:
            found |= {f"{path}.{axis}": (place, axis) for axis in range(3)}
    return found


def _unknown(machine: Machine, word: str, known: list[str]) -> ArmDesignError:
    """What to say of a word or path that nothing varies by."""
    for name, frozen in machine.idle.items():
        if f"{word}.".startswith(f"cylinder.{name}."):
            problem = f"the {name} cylinder stands still: joint {', '.join(frozen)} is frozen"
            return ArmDesignError(
                f"vary {word}", problem, "vary another one, or make the joint a coordinate"
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
