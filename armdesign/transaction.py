"""Several files of one folder that change as one, all or none, whatever happens on the way.

New files are written into a folder of their own beside their places, ``.writing-`` with ``new``
and ``old`` in it. When all are whole, and every place is free, the files that they replace are
kept in ``old`` and the journal ``moving`` names them all; then each is moved. If a move fails, the
journal becomes ``undoing`` and the old files return. Where a process is killed on the way, the
next one that reads or writes there ends what the journal says. That the other is dead, and not at
work, is told by a lock that ends with its process. Until then a reader may find new files beside
old ones.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import re
import shutil
import signal
import stat
import sys
import tempfile
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows: nothing is waited for, and nothing left behind is touched
    fcntl = None  # type: ignore[assignment]

PREFIX = ".writing-"
AGAIN = 0.05  # [s] after which an interrupt that was ignored comes again
STAGE = re.compile(re.escape(PREFIX) + 8 * "[a-z0-9_]")  # as tempfile names them
ENDS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)


@contextlib.contextmanager
def staged(place: Path) -> Iterator[Path]:
    """A folder to write into, whose files move to ``place`` after the block, all or none.

    Raises:
        OSError: a file cannot be written, or its place is taken; all is then as it was.
    """
    fresh = [folder for folder in (place, *place.absolute().parents) if not folder.exists()]
    try:
        place.mkdir(parents=True, exist_ok=True)
        with _stage(place) as stage:
            yield stage.new
            with undisturbed(), _locked(place):
                _mend(place)
                stage.move()
    except BaseException:
        for folder in fresh:  # the innermost first
            with contextlib.suppress(OSError):  # not there, or not empty
                folder.rmdir()
        raise


def mend(place: Path) -> None:
    """End what killed processes left half done in a folder, and remove what they left behind."""
    with contextlib.suppress(OSError):
        if any(STAGE.fullmatch(name) for name in os.listdir(place)):
            with undisturbed(), _locked(place):
                _mend(place)


@contextlib.contextmanager
def undisturbed() -> Iterator[None]:
    """Postpone what ends the program, Ctrl-C or a signal, until after the block.

    Imports of libraries in C++ need it, too: an exception in the Python that they run as they are
    loaded ends the process, or is taken for a missing library and lost.
    """
    if threading.current_thread() is not threading.main_thread():  # it alone runs handlers
        yield
        return
    came: list[int] = []
    before = {number: signal.getsignal(number) for number in ENDS}
    # None: a handler that is not Python's own
    known = {number: handler for number, handler in before.items() if handler is not None}
    for number in known:
        signal.signal(number, lambda number, _: came.append(number))
    try:
        yield
    finally:
        for number, handler in known.items():
            signal.signal(number, handler)
        for number in came:
            signal.raise_signal(number)


@contextlib.contextmanager
def as_interrupt() -> Iterator[list[int]]:
    """Make SIGTERM and a closed terminal end the program as Ctrl-C does; yields such signals.

    An interrupt that falls where Python ignores exceptions, as in callbacks of weak references
    when a module has been imported, comes again.
    """
    came: list[int] = []

    def end(number: int, _: object) -> None:
        came.append(number)
        raise KeyboardInterrupt

    # not the ones that nohup ignores
    by_default = [number for number in ENDS if signal.getsignal(number) is signal.SIG_DFL]
    for number in by_default:
        signal.signal(number, end)
    ignored, sys.unraisablehook = sys.unraisablehook, _again
    try:
        yield came
    finally:
        sys.unraisablehook = ignored
        for number in by_default:
            signal.signal(number, signal.SIG_DFL)


@dataclass(frozen=True)
class _Staging:
    """Files on the way to their places."""

    root: Path
    place: Path

    @property
    def new(self) -> Path:
        return self.root / "new"

    @property
    def old(self) -> Path:
        return self.root / "old"

    @property
    def unfinished(self) -> bool:
        """Whether some files may have moved and others not."""
        return any((self.root / journal).exists() for journal in ("moving", "undoing"))

    def move(self) -> None:
        """Move all files from ``new`` to their places, or none."""
        paths = (path for path in self.new.rglob("*") if not path.is_dir())
        files = sorted(str(path.relative_to(self.new)) for path in paths)
        for file in files:
            self._check(file)
        replaced = [file for file in files if os.path.lexists(self.place / file)]
        for file in replaced:
            self._keep(file)
        parents = {str(folder) for file in files for folder in Path(file).parents}
        folders = sorted(
            (folder for folder in parents if not (self.place / folder).exists()), reverse=True
        )
        journal = {"files": files, "replaced": replaced, "folders": folders}
        (self.root / "journal").write_text(json.dumps(journal), encoding="utf-8")
        os.replace(self.root / "journal", self.root / "moving")
        self._finish()

    def recover(self) -> None:
        """End what a killed process began."""
        if (self.root / "moving").exists():
            self._finish()
        elif (self.root / "undoing").exists():
            self._undo()

    def _check(self, file: str) -> None:
        target = self.place / file
        for folder in reversed(target.relative_to(self.place).parents[:-1]):
            if (there := self.place / folder).exists() and not there.is_dir():
                raise NotADirectoryError(errno.ENOTDIR, f"{folder} is not a folder", str(there))
        if target.is_dir() and not target.is_symlink():
            fault = f"a folder named {file} is in the way"
            raise IsADirectoryError(errno.EISDIR, fault, str(target))

    def _keep(self, file: str) -> None:
        """The old file under a second name; a copy where the file system has no such names."""
        kept = self.old / file
        kept.parent.mkdir(parents=True, exist_ok=True)
        try:
            os.link(self.place / file, kept, follow_symlinks=False)
        except OSError:
            shutil.copy2(self.place / file, kept, follow_symlinks=False)

    def _journal(self, name: str) -> dict[str, list[str]]:
        """Names of files that move, of old files that they replace, and of new folders."""
        journal: dict[str, list[str]] = json.loads((self.root / name).read_text(encoding="utf-8"))
        for path in map(Path, (*journal["files"], *journal["folders"])):
            if path.is_absolute() or ".." in path.parts:
                raise ValueError(f"{path} leads out of the folder")
        return journal

    def _finish(self) -> None:
        journal = self._journal("moving")
        try:
            for file in journal["files"]:
                if os.path.lexists(self.new / file):
                    (self.place / file).parent.mkdir(parents=True, exist_ok=True)
                    os.replace(self.new / file, self.place / file)
        except BaseException:
            os.rename(self.root / "moving", self.root / "undoing")
            self._undo()
            raise
        (self.root / "moving").unlink()

    def _undo(self) -> None:
        """Old files return, new ones without one go; what cannot is left to the next run."""
        journal = self._journal("undoing")
        for file in journal["files"]:
            if os.path.lexists(self.old / file):
                os.rename(self.old / file, self.place / file)
            elif file not in journal["replaced"] and not os.path.lexists(self.new / file):
                (self.place / file).unlink(missing_ok=True)
        for folder in journal["folders"]:
            with contextlib.suppress(OSError):  # not made, or somebody else uses it
                (self.place / folder).rmdir()
        (self.root / "undoing").unlink()


@contextlib.contextmanager
def _stage(place: Path) -> Iterator[_Staging]:
    """A folder beside the places of new files, locked while this process lives."""
    with contextlib.ExitStack() as held:
        with _locked(place):  # until it has its own lock it looks like one left behind
            _mend(place)
            stage = _Staging(Path(tempfile.mkdtemp(dir=place, prefix=PREFIX)), place)
            held.enter_context(_locked(stage.root))
        try:
            stage.new.mkdir()
            stage.old.mkdir()
            yield stage
        finally:
            if not stage.unfinished:
                shutil.rmtree(stage.root, ignore_errors=True)


def _mend(place: Path) -> None:
    """As ``mend``, with the folder's lock held."""
    for root in sorted(path for path in place.iterdir() if STAGE.fullmatch(path.name)):
        with contextlib.suppress(OSError, ValueError, KeyError), _locked(root, wait=False) as dead:
            if dead and _is_private(root):
                stage = _Staging(root, place)
                stage.recover()
                shutil.rmtree(root, ignore_errors=True)


def _is_private(root: Path) -> bool:
    """Whether a folder can have been made by this user alone."""
    status = root.lstat()
    return (
        stat.S_ISDIR(status.st_mode)
        and status.st_uid == os.getuid()
        and not stat.S_IMODE(status.st_mode) & 0o077
    )


@contextlib.contextmanager
def _locked(folder: Path, wait: bool = True) -> Iterator[bool]:
    """Whether the folder's lock could be had; it ends with the block, or with the process."""
    opened = _lock(folder, wait)
    try:
        yield opened is not None
    finally:
        if opened is not None:
            os.close(opened)


def _lock(folder: Path, wait: bool) -> int | None:
    if fcntl is None:
        return None
    try:
        opened = os.open(folder, os.O_RDONLY)
    except OSError:
        return None
    try:
        fcntl.flock(opened, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except BaseException as error:  # held by another, no locks here; or the user will not wait
        os.close(opened)
        if isinstance(error, OSError):
            return None
        raise
    return opened


def _again(ignored: sys.UnraisableHookArgs) -> None:
    """Hook of ignored exceptions, from which none can be raised either."""
    if issubclass(ignored.exc_type, KeyboardInterrupt):
        threading.Timer(AGAIN, os.kill, (os.getpid(), signal.SIGINT)).start()
    else:
        sys.__unraisablehook__(ignored)
