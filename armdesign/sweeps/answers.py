"""Answers of a sweep: a row for each case, in one frame."""

from __future__ import annotations

from collections.abc import Iterable, Set
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from armdesign.errors import ArmDesignError
from armdesign.journal.journal import Entry
from armdesign.journal.keys import canonical
from armdesign.short_repr import short_repr
from armdesign.sweeps.cases import OF_SWEEP, Case

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.plots.canvas import Figure

EXACT = 2**53  # up to which floats have every whole number
COLUMNS = ("machine", "payload", "seconds", "error")  # of the frame, beside changes and answers
MOST_PATHS = 2_000  # a machine file has hundreds of numbers


@dataclass(frozen=True, eq=False, kw_only=True)
class Sweep:
    """Answers of a sweep.

    Attributes:
        cases: all, in their order.
        outcomes: one for each case.
        kept: how many of them a journal had already.
        retried: names of cases that were tried again because a worker died.
        outputs: names of the answers that were chosen; None: all.
    """

    __repr__ = short_repr

    cases: tuple[Case, ...]
    outcomes: tuple[Entry, ...]
    kept: int
    retried: tuple[str, ...]
    outputs: tuple[str, ...] | None = None

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the answers: those that were chosen, or all that any case has."""
        return names_of(self.outcomes) if self.outputs is None else self.outputs

    @property
    def failures(self) -> dict[str, str]:
        """Why cases failed, by their names."""
        pairs = zip(self.cases, self.outcomes, strict=True)
        return {case.name: outcome.error for case, outcome in pairs if outcome.error}

    @property
    def paths(self) -> tuple[str, ...]:
        """Key paths that any case changes, and options that only some have."""
        return paths_of(self.cases)

    @cached_property
    def frame(self) -> pd.DataFrame:
        """A row for each case: machine, payload, changed values, answers, ``seconds``, ``error``.

        ``payload`` is empty where all load cases count, a changed value where the case keeps the
        file's, an answer where the case failed. Options of which several sets were given are
        columns beside the changed values.
        """
        paths = self.paths
        rows = [
            {
                "machine": case.machine,
                "payload": case.payload or "",
                **{writable(path): _shown(case.settings.get(path)) for path in paths},
                **{name: one.answer.get(name) for name in self.names},
                "seconds": one.seconds,
                "error": one.error,
            }
            for case, one in zip(self.cases, self.outcomes, strict=True)
        ]
        return _table(rows)

    @property
    def answers(self) -> pd.DataFrame:
        """The answers alone, a row for each case, indexed by what tells the cases apart.

        Raises:
            ArmDesignError: a case failed; the first is named.
        """
        for name, error in self.failures.items():
            raise ArmDesignError(name, error, "the frame has the other cases")
        settings = [
            {"machine": case.machine, "payload": case.payload}
            | {writable(path): _shown(value) for path, value in case.settings.items()}
            for case in self.cases
        ]
        cases = _table(settings).map(_hashable)
        apart = [name for name in cases if cases[name].nunique(dropna=False) > 1]
        answers = _table(
            [{name: one.answer.get(name) for name in self.names} for one in self.outcomes]
        )
        return answers.set_index(cases.set_index(apart or "machine").index)

    def plot(self, answer: str = "") -> Figure:
        """Figure of an answer, by default the first, over each number that was changed."""
        from armdesign import plots

        return plots.sweep_answers(self, answer)


def paths_of(cases: Iterable[Case]) -> tuple[str, ...]:
    """Key paths that any case changes, and options that only some have."""
    return tuple(dict.fromkeys(path for case in cases for path in case.settings))


def names_of(outcomes: Iterable[Entry]) -> tuple[str, ...]:
    """Names of all answers that any case has."""
    return tuple(dict.fromkeys(name for one in outcomes for name in one.answer))


def refuse_names(paths: Set[Any], options: Set[str], outputs: Set[str]) -> None:
    """Raise for key paths that cannot be, and options and outputs with the name of a column."""
    if len(paths) > MOST_PATHS:
        fault = f"{len(paths)} key paths are not allowed"
        raise ArmDesignError("changes", fault, f"change at most {MOST_PATHS} numbers")
    remedy = 'give texts, such as "cylinder.boom.bore_mm"'
    for path in paths:
        if not isinstance(path, str):
            raise ArmDesignError("changes", f"{path!r} is no key path", remedy)
        if path in COLUMNS:
            fault = "is a column of the frame and no number of a machine file"
            raise ArmDesignError(f"changes.{path}", fault, f"leave it out; in Python, {OF_SWEEP}")
    for name in options & {*COLUMNS, *paths}:
        fault = "is the name of another column"
        raise ArmDesignError(f"options.{name}", fault, "give it another name")
    for name in outputs & {*COLUMNS, *paths, *options}:
        fault = f"{name!r} is a column of the frame in any case, and no answer"
        raise ArmDesignError("outputs", fault, "leave it out")


def within_columns(outcome: Entry, others: Set[str]) -> Entry:
    """An outcome as a frame has it: a failure where an answer has the name of another column.

    The other cases decide that, so it is no outcome of the case itself, as a journal has it.
    """
    for name in outcome.answer:
        if name in others:
            fault, remedy = "is the name of another column", "give it another name"
            words = str(ArmDesignError(f"answer {name}", fault, remedy))
            return Entry(answer={}, seconds=outcome.seconds, error=words)
    return outcome


def writable(text: str) -> str:
    """The text with halves of surrogate pairs, which no file holds, as Python writes them."""
    return text.encode("utf-8", "backslashreplace").decode()


def _shown(value: Any) -> Any:
    return writable(value) if isinstance(value, str) else value


def _table(rows: list[dict[str, Any]]) -> pd.DataFrame:
    """Rows as a frame, in which whole numbers keep every digit."""
    import pandas as pd

    table = pd.DataFrame(rows)
    for name in map(str, table.select_dtypes("float")):
        values = [row.get(name) for row in rows]
        if any(isinstance(value, int) and abs(value) > EXACT for value in values):
            table[name] = pd.Series(values, dtype=object)  # which are no floats
    return table


def _hashable(value: Any) -> Any:
    plain = not isinstance(value, list | tuple | dict) and not hasattr(value, "identity")
    return value if plain else canonical(value)
