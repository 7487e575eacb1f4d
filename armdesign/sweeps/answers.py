"""Answers of a sweep: a row for each case, in one frame."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from armdesign.errors import ArmDesignError
from armdesign.journal.journal import Entry
from armdesign.journal.keys import canonical
from armdesign.short_repr import short_repr
from armdesign.sweeps.cases import Case

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.plots.canvas import Figure

COLUMNS = ("machine", "payload", "seconds", "error")  # of the frame, beside changes and answers


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
        import pandas as pd

        paths = self.paths
        rows = [
            {
                "machine": case.machine,
                "payload": case.payload or "",
                **{path: case.settings.get(path) for path in paths},
                **{name: one.answer.get(name) for name in self.names},
                "seconds": one.seconds,
                "error": one.error,
            }
            for case, one in zip(self.cases, self.outcomes, strict=True)
        ]
        return pd.DataFrame(rows)

    @property
    def answers(self) -> pd.DataFrame:
        """The answers alone, a row for each case, indexed by what tells the cases apart.

        Raises:
            ArmDesignError: a case failed; the first is named.
        """
        import pandas as pd

        for name, error in self.failures.items():
            raise ArmDesignError(name, error, "the frame has the other cases")
        settings = [{"machine": c.machine, "payload": c.payload, **c.settings} for c in self.cases]
        cases = pd.DataFrame(settings).map(_hashable)
        apart = [name for name in cases if cases[name].nunique(dropna=False) > 1]
        answers = pd.DataFrame(
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


def _hashable(value: Any) -> Any:
    plain = not isinstance(value, list | tuple | dict) and not hasattr(value, "identity")
    return value if plain else canonical(value)
