"""Finished pieces of a long command: what its journal has is not computed again.

A command opens its journal with ``keeping``; what computes below it asks for its pieces with
``finished`` or ``all_finished`` and need not know whether there is one. The process that opened
the journal writes it alone. A piece's key is a digest of everything that decides it; its name
begins with the run that finished it, so that a run that ends well takes along the pieces of those
that it went on with, and no others.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar
from uuid import uuid4

from armdesign.errors import ArmDesignError, InfeasibleError
from armdesign.journal.journal import Entry, Journal
from armdesign.journal.keys import digest, version_of_sources

ANEW = "delete it to begin anew"

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Form(Generic[T]):
    """Form in which a piece is kept.

    Attributes:
        write: what a journal can hold of it; None: it is not kept.
        read: the piece of that.

    Both are given its number among those that were asked for first.
    """

    write: Callable[[int, T], Mapping[str, Any] | None]
    read: Callable[[int, Mapping[str, Any]], T]


@dataclass(eq=False)
class Pieces:
    """The pieces in an open journal.

    Attributes:
        journal: where they are kept.
        entries: all that are finished, by their keys.
        answered: how many were asked for and had been finished by a run before.
        left: how many stay at the end: of runs that this one did not go on with.
    """

    journal: Journal
    entries: dict[str, Entry]
    answered: int = field(default=0, init=False)
    left: int = field(default=0, init=False)
    version: str = field(default_factory=version_of_sources)

    def __post_init__(self) -> None:
        self._run = uuid4().hex[:8]
        self._before = {key: name.partition(":")[0] for key, name in self.journal.names().items()}
        self._went_on = set[str]()

    def key(self, what: str, identity: Any) -> str:
        """The key of a piece."""
        return digest([self.version, what, identity])

    def count_answered(self, keys: Iterable[str]) -> None:
        """Count pieces that were asked for and that a run before had finished."""
        runs = [self._before[key] for key in keys if key in self._before]
        self.answered += len(runs)
        self._went_on.update(runs)
        self._run = runs[0] if runs else self._run

    def keep(self, key: str, what: str, answer: Mapping[str, Any], seconds: float) -> None:
        """Write a piece, which is on the disk when this returns."""
        entry = Entry(answer=answer, seconds=seconds)
        self.entries[key] = entry
        self.journal.keep(key, f"{self._run}: {what}", entry)

    def end(self) -> None:
        """Forget the pieces of this run and of those that it went on with."""
        others = {key for key, run in self._before.items() if run not in self._went_on}
        self.left = self.journal.forget(self.entries.keys() - others)

    def of_other_runs(self) -> Iterator[str]:
        """Sentences on pieces of interrupted runs: those gone on with, those that stay."""
        if self.answered:
            pieces_were = "piece was" if self.answered == 1 else "pieces were"
            yield f"{self.answered} {pieces_were} finished before, by an interrupted run"
        if self.left:
            stay = "piece stays" if self.left == 1 else "pieces stay"
            those = f"{self.left} {stay} in {self.journal.path}, of an interrupted run"
            yield f"{those} with other inputs; delete it if that need not go on"


_open: list[Pieces] = []


def is_keeping() -> bool:
    """Whether finished pieces are kept now."""
    return bool(_open)


@contextmanager
def keeping(path: Path) -> Iterator[Pieces]:
    """Keep the pieces that are finished in the block in a journal, until the block has ended well.

    Where it is interrupted or fails the journal stays, unless there is nothing in it; where it
    proves that there is no answer, that is one too. Pieces of runs that were interrupted and that
    this one does not go on with stay.

    Raises:
        ArmDesignError: the journal cannot be written, is damaged, or another run writes it.
    """
    with Journal(path, {}, version_of_sources(), new=False, otherwise=ANEW) as journal:
        pieces = Pieces(journal, journal.entries())
        _open.append(pieces)
        try:
            yield pieces
            pieces.end()
        except InfeasibleError:
            pieces.end()
            raise
        except ArmDesignError as error:
            if error.passing and pieces.entries:
                error.add_remedy(f"what was finished is kept in {path}")
            raise
        finally:
            _open.remove(pieces)


def finished(what: str, identity: Callable[[], Any], compute: Callable[[], T], form: Form[T]) -> T:
    """A piece from the journal that is open, or computed and kept there; without one computed.

    Args:
        what: the word for it.
        identity: gives everything that decides it, but for the version, as JSON has it.
        compute: it.
        form: how it is kept.
    """
    return all_finished(what, 1, lambda _: identity(), lambda _: [(0, compute())], form)[0]


def all_finished(
    what: str,
    count: int,
    identity: Callable[[int], Any],
    compute: Callable[[list[int]], Iterable[tuple[int, T]]],
    form: Form[T],
) -> list[T]:
    """Several pieces, each as by ``finished``, in their order.

    Args:
        what: the word for one of them.
        count: how many.
        identity: of each, by its number.
        compute: gives the pieces of some numbers as they come, each with its number.
        form: how they are kept.
    """
    if not _open:
        done = dict(compute(list(range(count))))
        return [done[k] for k in range(count)]
    pieces = _open[-1]
    keys = [pieces.key(what, identity(k)) for k in range(count)]
    known = {k: pieces.entries[key] for k, key in enumerate(keys) if key in pieces.entries}
    pieces.count_answered(keys)
    done = {k: form.read(k, entry.answer) for k, entry in known.items()}
    missing, began = [k for k in range(count) if k not in known], time.monotonic()
    for k, piece in compute(missing) if missing else ():
        answer = form.write(k, piece)
        if answer is not None:
            pieces.keep(keys[k], what, answer, time.monotonic() - began)
        done[k], began = piece, time.monotonic()
    return [done[k] for k in range(count)]
