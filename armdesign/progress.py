"""Progress on stderr: a status line and bars, on one console, without a trace afterwards."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING

from armdesign.errors import printable

if TYPE_CHECKING:
    from rich.console import Console

PATIENCE = 2.0  # [s] before a progress bar appears


@cache
def console() -> Console:
    """The console of all who show progress, so that status and bars leave each other's lines."""
    from rich.console import Console

    return Console(stderr=True)


@contextmanager
def progress(text: str, *, silent: bool = False) -> Iterator[Callable[[str], None]]:
    """Show a status line unless ``silent``; yields a function that changes its text."""
    if silent:
        yield lambda _: None
        return
    from rich.text import Text

    with console().status(Text(printable(text))) as status:
        yield lambda changed_text: status.update(Text(printable(changed_text)))


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
