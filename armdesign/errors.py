"""The one base error of the package, with the facts in it as data."""

from __future__ import annotations

import difflib
import re
import sys
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from armdesign.design.requirements.record import Concession

# C0 and C1 with delete, what has no width, marks and turns of the writing's direction, line and
# paragraph separators, halves of surrogate pairs
CONTROLS = re.compile(
    "[\x00-\x1f\x7f-\x9f\u061c\u200b\u200e\u200f\u2028-\u202e\u2060\u2066-\u2069\ufeff\ud800-\udfff]"
)

DIGITS, READ = re.compile("[0-9,]+"), 60  # of a whole number, of which nobody reads more
LONGEST = 4_000  # characters of a part, fault or remedy: names in files may have any length
SURROUNDINGS = (OSError, ImportError, MemoryError)  # as Python says that a place is at fault
# as SQLite does: busy, locked, no memory, read-only, input or output, full, cannot be opened
SURROUNDINGS_OF_SQLITE = (5, 6, 7, 8, 10, 13, 14)
CAUSES = 100  # of an error that are looked at: one may be its own
MOST_NAMES, SHOWN_NAMES = 200, 60  # among which a name is looked for; that a remedy lists


def printable(text: str) -> str:
    """The text with control characters as Python writes them, which no terminal obeys."""
    return CONTROLS.sub(lambda control: repr(control[0])[1:-1], text)


def _line(text: str) -> str:
    line = DIGITS.sub(_short, " ".join(printable(text).split()))
    return line if len(line) <= LONGEST else f"{line[:LONGEST]}…"


def _short(number: re.Match[str]) -> str:
    return number[0] if len(number[0]) <= READ else f"{number[0][:READ]}…"


class ArmDesignError(Exception):
    """Bad input, said in one line: which part, its value, what is allowed, what to do.

    Attributes:
        part: what is at fault: a key path (``cylinder.boom.bore_mm``), a file, a cylinder.
        fault: value with unit and allowed range.
        remedy: what to do about it.
        line: of the file in which it stands; None where it stands in none, or the line is not
            known.
        key: key path of the machine file that causes it, where the part is another file's.
        table: what more there is to say, as plain text in lines; empty where one line says it all.
        passing: whether it may pass without another input, as it comes from the surroundings: a
            disk, a file, a package, memory, an environment variable. An error that is raised where
            Python's own for these is handled is.
        finished: a result with the answers that were found before it; None for none.
    """

    passing: bool = False
    finished: Any = None

    def __init__(
        self, part: str, fault: str, remedy: str = "", line: int | None = None, key: str = ""
    ) -> None:
        super().__init__()
        self.part, self.fault, self.remedy, self.key = part, fault, remedy, key
        self.table, self.passing = "", may_pass(sys.exception())
        self.tell_line(line)

    def add_remedy(self, more: str) -> None:
        """Say what else there is to do, or to know, behind the remedy."""
        self.remedy += f"; {more}"
        self.tell_line(self.line)

    def tell_line(self, line: int | None, file: str = "") -> None:
        """Say in which line it stands (None: not known), and of which file if not the part's."""
        self.line = line
        part, fault, remedy = map(_line, (self.part, self.fault, self.remedy))
        place = f" (line {line}{file and f' of {file}'})" if line else ""
        self.args = (f"{part}: {fault}" + (f"; {remedy}" if remedy else "") + place,)

    def __reduce__(self) -> tuple[type[ArmDesignError], tuple[str, ...], dict[str, Any]]:
        """Travel whole between processes."""
        state = {**vars(self), "args": self.args}
        return type(self), (self.part, self.fault, self.remedy), state


def may_pass(error: BaseException | None) -> bool:
    """Whether an error may pass without another input: it, or one that it was raised for."""
    for _ in range(CAUSES):
        if _is_of_surroundings(error):
            return True
        if error is None or isinstance(error, ArmDesignError):
            break
        error = error.__cause__ if error.__suppress_context__ else error.__context__
    return isinstance(error, ArmDesignError) and error.passing


def _is_of_surroundings(error: BaseException | None) -> bool:
    if isinstance(error, SURROUNDINGS):
        return True
    sqlite3 = sys.modules.get("sqlite3")  # loaded where there is a journal
    if sqlite3 is None or not isinstance(error, sqlite3.Error):
        return False
    return getattr(error, "sqlite_errorcode", 0) & 0xFF in SURROUNDINGS_OF_SQLITE


class MachineFileError(ArmDesignError):
    """The machine file or its URDF is wrong."""


class PoseError(ArmDesignError):
    """A pose cannot be taken: out of stroke, open four-bar, singular, or not finite."""


class TopplingError(PoseError):
    """Springs are too soft for gravity.

    Attributes:
        factor: by how much stiffer they must be at least.
    """

    factor: float = 1.0


class InfeasibleError(ArmDesignError):
    """No design meets the requirements.

    Attributes:
        conflict: requirements that cannot be met together, though without any one of them the
            others can; of several such sets that have nothing in common all, see
            ``Concession.part``. If each is relaxed by its ``together``, there is a design.
        drawn: whether a machine with all that is relaxed was drawn and meets the rest.
    """

    def __init__(
        self,
        part: str,
        fault: str,
        remedy: str = "",
        conflict: tuple[Concession, ...] = (),
        table: str = "",
    ) -> None:
        super().__init__(part, fault, remedy)
        self.conflict, self.table, self.drawn = conflict, table, False


class UntriedError(InfeasibleError):
    """No design that was tried meets the requirements, but not all were tried."""


class SimulationError(ArmDesignError):
    """The nonlinear run could not be completed or identified."""


class Stopped(KeyboardInterrupt):
    """Ctrl-C while several answers are sought, of which some are finished.

    Attributes:
        finished: result with these answers.
    """

    def __init__(self, finished: Any) -> None:
        super().__init__()
        self.finished = finished


def raise_together(errors: Sequence[ArmDesignError]) -> None:
    """Raise an error of the first one's kind that says all of them once; nothing if none."""
    different = list({str(error): error for error in errors}.values())
    if len(different) == 1:
        raise different[0]
    if different:
        first, *others = different
        words = "; also: ".join(
            [str(first).removeprefix(f"{_line(first.part)}: "), *map(str, others)]
        )
        error = type(first)(first.part, words)
        error.passing = any(one.passing for one in different)
        raise error


def choose(name: str, known: Collection[str]) -> str:
    """A remedy for a wrong name: the one that was meant, or all that there are."""
    if close := nearest(name, known):
        return f'did you mean "{close}"?'
    more = f" and {len(known) - SHOWN_NAMES} more" if len(known) > SHOWN_NAMES else ""
    return f"choose from: {', '.join(list(known)[:SHOWN_NAMES]) or 'none'}{more}"


def nearest(name: str, known: Collection[str]) -> str | None:
    """The known name that is most like a wrong one; None where none is like it."""
    return next(iter(difflib.get_close_matches(name, list(known)[:MOST_NAMES], n=1)), None)
