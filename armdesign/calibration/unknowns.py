"""Unknowns of a calibration: numbers of the machine file, positive ones in logarithms.

u = ln(value) where the schema allows no negative value, else u = value over its size, so that a
change of u is a relative change. Bounds are the schema's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from armdesign.errors import ArmDesignError, choose
from armdesign.machine.file.key_paths import allowed
from armdesign.machine.file.numbers import Number, chosen_numbers
from armdesign.machine.file.section import plain
from armdesign.machine.machine import Machine
from armdesign.machine.parts import coordinates

LEAST = 1e-18  # stands for zero in logarithms: no key's unit makes so small a number matter


@dataclass(frozen=True, kw_only=True)
class Unknown(Number):
    """A number of the machine file that a calibration fits.

    Attributes:
        prior: what is known beforehand: value and standard deviation; None: nothing.
    """

    prior: tuple[float, float] | None = None

    @property
    def place(self) -> tuple[str, int | None]:
        """Key path that the file has, and which number of the list there; None: of no list."""
        *above, last = self.location
        return (".".join(map(str, above)), last) if isinstance(last, int) else (self.path, None)

    @property
    def positive(self) -> bool:
        """Whether it is found by its logarithm."""
        return self.low >= 0

    @property
    def size(self) -> float:
        """The change of value that counts as 1 where there is no logarithm.

        The value itself, but no less than its natural step, as 10 mm.
        """
        return max(abs(self.value), abs(self.step[0]))

    def coordinate(self, value: float) -> float:
        """U of a value."""
        return math.log(max(value, LEAST)) if self.positive else value / self.size

    def number(self, coordinate: float) -> float:
        """The value of u, within the schema's bounds."""
        value = math.exp(coordinate) if self.positive else coordinate * self.size
        return min(max(value, self.low), self.high)

    @property
    def limits(self) -> tuple[float, float]:
        """Bounds of u."""
        return self.coordinate(self.low), self.coordinate(self.high)

    def surprise(self, coordinate: float) -> float:
        """Difference from the prior over its deviation; 0 without one."""
        if self.prior is None:
            return 0.0
        value, deviation = self.prior
        relative = deviation / (value if self.positive else self.size)
        return (coordinate - self.coordinate(value)) / relative


def unknowns_of(
    machine: Machine, fit: Sequence[str], priors: Mapping[str, tuple[float, float]] | None = None
) -> tuple[Unknown, ...]:
    """The unknowns of key paths.

    Args:
        machine: the machine.
        fit: key paths of numbers.
        priors: for some of them value and standard deviation, in the file's unit.

    Raises:
        ArmDesignError: no path, one twice, one that names no number, or a prior of no path.
    """
    if not fit or isinstance(fit, str):
        raise ArmDesignError("fit", f"{fit!r} is not allowed", "give some key paths of numbers")
    for path in fit:
        if list(fit).count(path) > 1:
            raise ArmDesignError(f"fit {path}", "is there twice", "leave one out")
    priors = dict(priors or {})
    for path in priors:
        if path not in fit:
            raise ArmDesignError(f"prior {path}", "is not fitted", choose(path, list(fit)))
    return tuple(_unknown(machine, path, priors.get(path)) for path in fit)


def _unknown(machine: Machine, path: str, prior: tuple[float, float] | None) -> Unknown:
    chosen = chosen_numbers(machine.section, path, f"fit {path}")
    if len(chosen) > 1:
        remedy = f"name one of its numbers, such as {chosen[0].path}"
        raise ArmDesignError(f"fit {path}", f"is a list of {len(chosen)} numbers", remedy)
    (number,) = chosen
    if prior is not None:
        mean, deviation = (float(x) for x in prior)
        possible = number.low <= mean <= number.high and (mean > 0 or number.low < 0)
        if not (possible and 0 < deviation < math.inf):
            remedy = f"give {allowed(number.location)} and a deviation above 0"
            raise ArmDesignError(f"prior {path}", f"{mean:g} ± {deviation:g}", remedy)
        prior = (mean, deviation)
    return Unknown(**vars(number), prior=prior)


def varied(machine: Machine, changes: Mapping[str, float]) -> Machine:
    """The machine with other numbers, for a look: its text is the old one.

    ``Machine.replace`` edits the text, too, which takes ten times as long.
    """
    data = plain(machine.section)
    for path, value in changes.items():
        *above, last = (int(key) if key.isdigit() else key for key in path.split("."))
        node: Any = data
        for key in above:
            node = node[key]
        node[last] = value
    section = type(machine.section).model_validate(data)
    same = coordinates(machine.section) == coordinates(section)
    texts = machine.text, machine.urdf_text, machine.source
    other = Machine.unchecked(*texts, arm=machine.arm if same else None, section=section)
    return other.loaded_like(machine)
