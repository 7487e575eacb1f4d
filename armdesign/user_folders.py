"""Folders of one user for caches, and whether anybody else could change what is in them.

Compiled code is run when it is read, so a folder that another user may write is as good as a
program of theirs.
"""

from __future__ import annotations

import contextlib
import os
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

POSIX = os.name == "posix"  # elsewhere caches and temporary folders are each user's own
OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


def of_user() -> Iterator[Path]:
    """Folders of this user, best first: with the other caches, or temporary; may not exist."""
    caches = Path(os.path.expanduser(os.environ.get("XDG_CACHE_HOME") or "~/.cache"))
    if caches.is_absolute():  # else nobody knows the user's home
        yield caches / "armdesign"
    yield from temporary()


def temporary() -> Iterator[Path]:
    """Temporary folders of this user, named so that a later process finds them."""
    places = (os.environ.get("TMPDIR") or "/tmp", "/tmp", "/var/tmp", "/dev/shm")
    for place in dict.fromkeys(places):  # the last one is memory: there if all disks are read-only
        folder = Path(place) / f"armdesign-{_user()}"
        if folder.is_absolute() and not folder.is_symlink():  # a link anybody could have put there
            yield folder


def made_private(folder: Path, owner_of: Path | None = None) -> bool:
    """Whether a folder exists, made if need be, and nobody else can change what is in it.

    Args:
        folder: to be checked; made with the folders above it if need be.
        owner_of: a folder of programs that are run anyway; within it, its owner is trusted.

    Raises:
        OSError: the folder does not exist and cannot be made.
    """
    folder.parent.mkdir(mode=0o700 if owner_of is None else 0o755, parents=True, exist_ok=True)
    owners, parent = {0, _user()}, Path(os.path.realpath(folder.parent))
    if owner_of is not None:
        owners.add(owner_of.stat().st_uid)
    elif not all(_stays(place.stat(), owners) for place in (parent, *parent.parents)):
        return False
    folder.mkdir(mode=0o755, exist_ok=True)
    status = folder.lstat()  # a link is no folder
    return stat.S_ISDIR(status.st_mode) and (
        not POSIX or (status.st_uid in owners and not status.st_mode & OTHERS_WRITE)
    )


def _stays(place: os.stat_result, owners: set[int]) -> bool:
    """Whether nobody else can take away what is in a place and put something else there."""
    mode = place.st_mode
    return not POSIX or (
        place.st_uid in owners and (not mode & OTHERS_WRITE or bool(mode & stat.S_ISVTX))
    )


def writable(folder: Path) -> bool:
    """Whether a file can be made in a folder, which its mode alone does not say."""
    with contextlib.suppress(OSError):
        tempfile.TemporaryFile(dir=folder).close()
        return True
    return False


def _user() -> int:
    return os.getuid() if hasattr(os, "getuid") else 0
