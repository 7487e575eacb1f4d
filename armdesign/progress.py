"""Progress on stderr: a status line and bars, on one console, without a trace afterwards.

The line says what is done, how much of it, and about how long the rest takes: "searching, start 2
of 3, 1 min left". Loops whose rounds take long tell it by ``counted``, one inside the other.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sized
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, TypeVar

from armdesign.errors import printable

if TYPE_CHECKING:
    from rich.console import Console

PATIENCE = 2.0  # [s] before a progress bar appears
Item = TypeVar("Item")


@dataclass
class Loop:
    """A loop at work: what its rounds are, how many, and how many are over, some from before."""

    what: str
    total: int
    done: int = 0
    began: float = field(default_factory=lambda: time.monotonic())
    before: int = 0

    @property
    def words(self) -> str:
        """The round at work."""
        return f"{self.what} {min(self.done + 1, self.total)} of {self.total}"


@dataclass
class Work:
    """The work that goes on now: its text and its loops, the outermost first."""

    text: str
    update: Callable[[str], None]
    loops: list[Loop] = field(default_factory=list)

    def say(self, text: str) -> None:
        """Change the text; loops of what was before it are over."""
        self.text, self.loops = text, []
        self.tell()

    def tell(self) -> None:
        """Show text, rounds and the time that is left."""
        self.update(", ".join([self.text, *self.rounds, *filter(None, [self.left])]))

    @property
    def rounds(self) -> list[str]:
        """Rounds at work, the outermost loop first."""
        return [loop.words for loop in self.loops]

    @property
    def left(self) -> str:
        """Time that the loops still take if the rest goes as what is over; empty at first."""
        share, width = 0.0, 1.0
        for loop in self.loops:
            rest = loop.total - loop.before
            share, width = share + width * (loop.done - loop.before) / rest, width / rest
        if not share:
            return ""
        seconds = (time.monotonic() - self.loops[0].began) * (1 - share) / share
        if seconds < 90:
            return f"{seconds:.0f} s left"
        return f"{seconds / 60:.0f} min left"


_at_work: list[Work] = []


@cache
def console() -> Console:
    """The console of all who show progress, so that status and bars leave each other's lines."""
    from rich.console import Console

    return Console(stderr=True)


@contextmanager
def progress(text: str, *, silent: bool = False) -> Iterator[Callable[[str], None]]:
    """Show a status line unless ``silent``; yields a function that changes its text."""
    if silent:
        yield from _working(text, lambda _: None)
        return
    from rich.text import Text

    with console().status(Text(printable(text))) as status:
        yield from _working(text, lambda words: status.update(Text(printable(words))))


def _working(text: str, update: Callable[[str], None]) -> Iterator[Callable[[str], None]]:
    work = Work(text, update)
    _at_work.append(work)
    try:
        yield work.say
    except KeyboardInterrupt as stop:
        if not hasattr(stop, "__notes__"):
            note_rounds(stop)
        raise
    finally:
        _at_work.remove(work)


def note_rounds(stop: BaseException) -> None:
    """Note on what ended the work at which rounds it was."""
    if _at_work and _at_work[-1].rounds:
        stop.add_note(f"at {', '.join(_at_work[-1].rounds)}")


def counted(items: Iterable[Item], what: str, total: int | None = None) -> Iterator[Item]:
    """The items, while the status line says at which one the work is.

    Args:
        items: of any kind.
        what: the word for one of them: "start".
        total: how many there are, where ``items`` has no length.
    """
    count = len(items) if total is None and isinstance(items, Sized) else total or 0
    with rounds(what, count) as finished:
        for done, item in enumerate(items, 1):
            yield item
            finished(done)


@contextmanager
def rounds(what: str, total: int, before: int = 0) -> Iterator[Callable[[int], None]]:
    """Say at which round the work is; yields a function that is given how many are over.

    Args:
        what: the word for one of them.
        total: how many there are.
        before: how many were over before the work began.
    """
    if not _at_work or total < 2 or total == before:
        yield lambda _: None
        return
    work, loop = _at_work[-1], Loop(what, total, done=before, before=before)
    work.loops.append(loop)
    work.tell()

    def finished(done: int) -> None:
        if done != loop.done:
            loop.done = done
            work.tell()

    yield finished
    if loop in work.loops:
        work.loops.remove(loop)
        work.tell()


def with_bar(slices: Iterable[slice], count: int, what: str) -> Iterator[slice]:
    """Slices of ``count`` rows, with a progress bar in a terminal once they take long."""
    start, bar = time.monotonic(), None
    try:
        for rows in slices:
            if bar is None and time.monotonic() - start > PATIENCE and sys.stderr.isatty():
                from rich.markup import escape
                from rich.progress import Progress

                bar = Progress(console=console(), transient=True)
                task = bar.add_task(escape(printable(what)), total=count)
                bar.start()
            if bar is not None:
                bar.update(task, completed=rows.start)
            yield rows
    finally:
        if bar is not None:
            bar.stop()
