"""A lock of the system on a file: it ends with the process that holds it.

SQLite has one of its own. That of POSIX is lost as soon as any part of the process closes the same
file: a second run in another thread, or a task that makes a copy of it.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

locks: Any
try:
    import fcntl as locks
except ImportError:  # Windows, where SQLite's own lock is of an open file, which cannot go
    locks = None

AGAIN = 0.01  # [s] between two attempts

_held: set[int] = set()  # descriptors


@contextmanager
def held(path: Path, patience: float) -> Iterator[None]:
    """Context in which a file is locked, which is made if there is none, and its folders.

    Who removes the file does so in it, so that what is locked is what is there.

    Args:
        path: of the file.
        patience: for which another's lock is waited for [s].

    Raises:
        BlockingIOError: another run, or one in this process, holds it.
        OSError: the file cannot be opened.
    """
    if locks is None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
        yield
        return
    descriptor, until = None, time.monotonic() + patience
    while descriptor is None:
        try:
            descriptor = _locked(path)
        except (BlockingIOError, FileNotFoundError):  # the latter: its folder went meanwhile
            if time.monotonic() > until:
                raise
            time.sleep(AGAIN)
    _held.add(descriptor)
    try:
        yield
    finally:
        _held.discard(descriptor)
        os.close(descriptor)


def _locked(path: Path) -> int:
    """A descriptor that holds the lock."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists() and any(_is_at(descriptor, path) for descriptor in _held):
        raise BlockingIOError
    descriptor = os.open(path, os.O_RDONLY | os.O_CREAT, 0o666)
    try:
        _lock(descriptor)
        if not _is_at(descriptor, path):  # another run took it away, and made one anew
            raise BlockingIOError
    except BaseException:
        os.close(descriptor)
        raise
    return descriptor


def _lock(descriptor: int) -> None:
    try:
        locks.flock(descriptor, locks.LOCK_EX | locks.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:  # a file system that knows no such locks: SQLite's own is left
        pass


def _is_at(descriptor: int, path: Path) -> bool:
    return os.path.samestat(os.fstat(descriptor), path.stat())


def _leave_to_parent() -> None:
    """A process that a task forks does not hold the lock on when its parent has ended."""
    for descriptor in _held:
        with contextlib.suppress(OSError):
            os.close(descriptor)
    _held.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_leave_to_parent)
