"""The one base error of the package, with the facts in it as data."""

from __future__ import annotations

import difflib
from collections.abc import Collection


class ArmDesignError(Exception):
    """Bad input, said in one line: which part, its value, what is allowed, what to do.

    Attributes:
        part: what is at fault: a key path (``cylinder.boom.bore_mm``), a file, a cylinder.
        problem: value with unit and allowed range.
        remedy: what to do about it.
    """

    def __init__(self, part: str, problem: str, remedy: str = "") -> None:
        self.part, self.problem, self.remedy = part, problem, remedy
        text = f"{part}: {problem}" + (f"; {remedy}" if remedy else "")
        super().__init__(" ".join(text.split()))

    def __reduce__(self) -> tuple[type[ArmDesignError], tuple[str, str, str]]:
        """Travel whole between processes."""
        return type(self), (self.part, self.problem, self.remedy)


class MachineFileError(ArmDesignError):
    """The machine file or its URDF is wrong."""


class PoseError(ArmDesignError):
    """A pose cannot be taken: out of stroke, open four-bar, singular, or not finite."""


class InfeasibleError(ArmDesignError):
    """No design meets the requirements."""


class SimulationError(ArmDesignError):
    """The nonlinear run could not be completed or identified."""


def choose(name: str, known: Collection[str]) -> str:
    """A remedy for a wrong name: the one that was meant, or all that there are."""
    close = difflib.get_close_matches(name, known, n=1)
    return f'did you mean "{close[0]}"?' if close else f"choose from: {', '.join(known) or 'none'}"
