"""The journal: an SQLite file with a row for every finished case.

It is written by one process, a transaction per case, synchronously to the disk, so that a case is
there or is not. A lock of the system on the file, and SQLite's own, both of which end with the
process, keep a second run out. Answers are JSON, whose numbers keep every bit; nothing in it is
ever run.
"""

from __future__ import annotations

import contextlib
import json
import os
import sqlite3
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

from armdesign.errors import ArmDesignError, printable
from armdesign.journal.keys import canonical, digest
from armdesign.journal.lock import held

FORMAT = 1  # of the tables
APPLICATION = 0x61726D64  # "armd": what other programs know the file by
HEAD = 512  # bytes, the least page that SQLite writes
MAGIC = b"SQLite format 3\x00"  # with which it begins
TABLES, PROGRAM = slice(40, 44), slice(68, 72)  # of the head: changes of tables, application
MOVE = "move it elsewhere, or name another file"  # for what is no journal
PATIENCE = 1.0  # [s] for which a lock is waited for
NEW = "begin another with --new (in Python new=True), which keeps this one beside it"

KINDS = (str, str, str, float, str, str)  # of a row of cases

_TABLES = (
    "CREATE TABLE about (name TEXT PRIMARY KEY, value TEXT NOT NULL)",
    """CREATE TABLE cases (
    key TEXT PRIMARY KEY, name TEXT NOT NULL, answer TEXT NOT NULL, seconds REAL NOT NULL,
    error TEXT NOT NULL, digest TEXT NOT NULL
)""",
)


class DamageError(Exception):
    """What is in the file was never written there."""


@dataclass(frozen=True, kw_only=True)
class Entry:
    """The answer of a finished case.

    Attributes:
        answer: numbers, words and truth values by name; empty where it failed.
        seconds: that it took.
        error: why it failed; empty where it did not.
    """

    answer: Mapping[str, Any]
    seconds: float
    error: str = ""


class Journal:
    """An open journal; a context, at whose end it is closed, and goes if nothing is in it.

    Attributes:
        path: of the file.
    """

    def __init__(
        self, path: Path, files: Mapping[str, str], version: str, new: bool, otherwise: str = NEW
    ) -> None:
        """Open a journal, or begin it.

        Args:
            path: of the file.
            files: digests of the files that all cases begin with, by name.
            version: of the package.
            new: whether one that exists is set aside.
            otherwise: what to do about one that cannot be gone on with.

        Raises:
            ArmDesignError: it cannot be used, another run writes it, it is damaged, or belongs to
                other files or another version.
        """
        self.path, self._otherwise, self._served = path, otherwise, False
        self._file = path.absolute()  # wherever a task goes
        with self._in_words(), contextlib.ExitStack() as opened:
            self._refuse_places()
            if new and self._file.exists():
                with held(self._file, PATIENCE):
                    self._refuse_others()
                    _set_aside(self._file)
            self._fresh = [one for one in self._file.parents if not one.exists()]
            opened.enter_context(held(self._file, PATIENCE))
            self._refuse_others()
            self._refuse_emptied()
            self._database = _connected(self._file)
            opened.callback(self._close)
            self._begin_or_check(files, version)
            self._opened = opened.pop_all()

    def __enter__(self) -> Journal:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with self._opened:
            goes = self._served or self._has_cases() is False
            self._close()
            if goes:
                self._remove()

    def _close(self) -> None:
        with contextlib.suppress(sqlite3.Error):  # a full disk; all cases are in the log beside
            self._database.close()

    def _remove(self) -> None:
        for end in ("-wal", "-shm", ""):
            self._file.with_name(self._file.name + end).unlink(missing_ok=True)
        for folder in self._fresh:  # the innermost first
            with contextlib.suppress(OSError):  # not there, or not empty
                folder.rmdir()

    def entries(self) -> dict[str, Entry]:
        """Every finished case by its key."""
        with self._in_words():
            return {
                key: Entry(answer=_by_name(answer), seconds=seconds, error=error)
                for key, _, answer, seconds, error in self._cases()
            }

    def _cases(self) -> Iterator[list[Any]]:
        """Rows of finished cases, but for the digests, which are those of what is there."""
        for row in self._database.execute(
            "SELECT key, name, answer, seconds, error, digest FROM cases"
        ):
            *fields, kept = row
            if tuple(map(type, row)) != KINDS or digest(fields) != kept:
                raise DamageError
            yield fields

    def keep(self, key: str, name: str, entry: Entry) -> None:
        """Write a finished case, which is on the disk when this returns.

        Raises:
            ArmDesignError: it cannot be written; what was written before stays.
        """
        answer = json.dumps(dict(entry.answer))  # in its own order, every bit of a number
        fields = [key, printable(name), answer, float(entry.seconds), entry.error]
        with self._in_words():
            self._database.execute(
                "INSERT OR IGNORE INTO cases VALUES (?, ?, ?, ?, ?, ?)", [*fields, digest(fields)]
            )
        if not self._file.exists():
            fault = "was removed or moved while a run wrote it"
            raise ArmDesignError(str(self.path), fault, "move it back, with its -wal, and go on")

    def names(self) -> dict[str, str]:
        """Names of all finished cases by their keys."""
        with self._in_words():
            return {key: name for key, name, *_ in self._cases()}

    def forget(self, keys: Collection[str]) -> int:
        """Drop finished cases; how many are left. Without any the file goes at the end."""
        with self._in_words():
            execute = self._database.execute
            left: int = execute("SELECT count(*) FROM cases").fetchone()[0] - len(keys)
            self._served = left == 0  # nothing need be written then, on a full disk
            if left and keys:
                execute("BEGIN IMMEDIATE")
                self._database.executemany(
                    "DELETE FROM cases WHERE key = ?", [(key,) for key in keys]
                )
                execute("COMMIT")
        return left

    def _has_cases(self) -> bool | None:
        """Whether any case is in it; None where that cannot be read."""
        try:
            return self._database.execute("SELECT 1 FROM cases LIMIT 1").fetchone() is not None
        except (AttributeError, sqlite3.Error):  # it is not open yet, or damaged
            return None

    def _begin_or_check(self, files: Mapping[str, str], version: str) -> None:
        """Write the tables into an empty file; compare what others hold."""
        about = {"version": version, "files": canonical(dict(files))}
        execute = self._database.execute
        known = execute("SELECT name FROM sqlite_master WHERE name = 'about'").fetchone()
        application = execute("PRAGMA application_id").fetchone()[0]
        if known is None:
            if application == APPLICATION:
                raise DamageError
            if execute("SELECT count(*) FROM sqlite_master").fetchone()[0] or application:
                raise ArmDesignError(str(self.path), "is no journal", MOVE)
            execute("BEGIN IMMEDIATE")
            for statement in _TABLES:
                execute(statement)
            for name, value in about.items():
                execute("INSERT INTO about VALUES (?, ?)", [name, value])
            execute(f"PRAGMA application_id = {APPLICATION}")
            execute(f"PRAGMA user_version = {FORMAT}")
            execute("COMMIT")
            return
        if application != APPLICATION:
            raise ArmDesignError(str(self.path), "is no journal", MOVE)
        self._check(files, version)

    def _check(self, files: Mapping[str, str], version: str) -> None:
        """Raise where the journal is damaged, or does not belong to the run.

        Its tables are those that are written here and no others, no views that compute for ever.
        """
        execute = self._database.execute
        form = execute("PRAGMA user_version").fetchone()[0]
        if form != FORMAT:
            fault = f"has the format {form}, this version of armdesign reads {FORMAT}"
            raise ArmDesignError(str(self.path), fault, self._otherwise)
        made = execute("SELECT sql FROM sqlite_master WHERE sql IS NOT NULL").fetchall()
        if len(made) != len(_TABLES) or {sql for (sql,) in made} != set(_TABLES):
            raise DamageError
        if execute("PRAGMA integrity_check").fetchone()[0] != "ok":
            raise DamageError
        about = dict(execute("SELECT name, value FROM about").fetchall())
        written, before = about.get("version"), _by_name(about.get("files"))
        if not isinstance(written, str):
            raise DamageError
        if written != version:
            fault = f"was written by armdesign {written}, this is {version}"
            raise ArmDesignError(str(self.path), fault, self._otherwise)
        changed = [name for name in files if before.get(name, files[name]) != files[name]]
        if changed:
            fault = f"belongs to another state of {', '.join(changed)}"
            remedy = f"restore that, give the --set that it was begun with, or {self._otherwise}"
            raise ArmDesignError(str(self.path), fault, remedy)
        if files.keys() - before.keys():  # machines that a study has more than before
            together = canonical({**before, **files})
            execute("UPDATE about SET value = ? WHERE name = 'files'", [together])

    def _refuse_places(self) -> None:
        """Raise for a place that is no file, or a link: its log would lie beside that."""
        path, place = self._file, str(self.path)
        if path.is_symlink():
            raise ArmDesignError(place, "is a link", "remove it, or name another file")
        if not path.name or "\0" in place or _is_other(path):
            raise ArmDesignError(place, "is no regular file", "name another for the journal")
        if _is_other(self._log):
            raise ArmDesignError(f"{place}-wal", "is no regular file", MOVE)

    @property
    def _log(self) -> Path:
        """The file beside it that has what was written last."""
        return self._file.with_name(f"{self._file.name}-wal")

    def _refuse_others(self) -> None:
        """Raise for a file that holds what no journal begins with."""
        with self._file.open("rb") as file:
            head = file.read(HEAD)
        # a log may have what the head has not yet
        made = len(head) == HEAD and any(head[TABLES]) and not self._log.exists()
        other = made and head[PROGRAM] != APPLICATION.to_bytes(4)
        if other or not MAGIC.startswith(head[: len(MAGIC)]):
            raise ArmDesignError(str(self.path), "is no journal", MOVE)

    def _refuse_emptied(self) -> None:
        """Raise for a file without its head, which SQLite would begin anew.

        One without a byte may have been killed as it was begun, or is new; beside a log it is not.
        """
        with contextlib.suppress(OSError):
            size = self._file.stat().st_size
            if 0 < size < HEAD or (size == 0 and self._log.stat().st_size > 0):
                raise DamageError

    def _in_use(self) -> ArmDesignError:
        remedy = "wait for that, or name another folder"
        return ArmDesignError(str(self.path), "another run writes it", remedy)

    def _damaged(self) -> ArmDesignError:
        remedy = f"restore a copy with its own -wal beside it, or with none, or {self._otherwise}"
        return ArmDesignError(str(self.path), "is damaged", remedy)

    @contextlib.contextmanager
    def _in_words(self) -> Iterator[None]:
        """Faults of SQLite and the system, as errors of the package."""
        place = str(self.path)
        try:
            yield
        except (DamageError, UnicodeDecodeError):  # the latter where SQLite says what is wrong
            raise self._damaged() from None
        except BlockingIOError:
            raise self._in_use() from None
        except OSError as error:
            fault = f"cannot be written ({error.strerror})"
            raise ArmDesignError(f"{place:.60}", fault, "name another folder") from None
        except sqlite3.Error as error:
            code = getattr(error, "sqlite_errorcode", 0) & 0xFF
            undecoded = "decode" in str(error)  # a flipped bit in a text
            if undecoded or code in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB):
                raise self._damaged() from None
            if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
                raise self._in_use() from None
            if code in (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR):
                fault = "cannot be written, the disk may be full"
                if self._has_cases():
                    fault += "; what was finished before is kept"
                remedy = "make room, or free the file if it is protected, and run it again"
                raise ArmDesignError(place, fault, remedy) from None
            fault = f"cannot be used ({error})"
            raise ArmDesignError(place, fault, "name another folder") from None


def _is_other(path: Path) -> bool:
    """Whether there is something that is no file."""
    return path.exists() and not path.is_file()


def _by_name(text: Any) -> dict[str, Any]:
    """Values by name, of the JSON that has them.

    Raises:
        DamageError: it is no such text.
    """
    try:
        values = json.loads(text) if isinstance(text, str) else None
    except (ValueError, RecursionError):
        raise DamageError from None
    if not isinstance(values, dict):
        raise DamageError
    return values


def _connected(path: Path) -> sqlite3.Connection:
    """A connection that holds SQLite's lock of a file, whose path is absolute.

    A relative one may read as a URI or ":memory:".
    """
    database = sqlite3.connect(path, timeout=PATIENCE, isolation_level=None)
    try:
        database.execute("PRAGMA locking_mode = EXCLUSIVE")
        database.execute("PRAGMA journal_mode = WAL")
        database.execute("PRAGMA synchronous = FULL")
        database.execute("BEGIN IMMEDIATE")  # takes the lock
        database.execute("COMMIT")
    except BaseException:
        database.close()
        raise
    return database


def _set_aside(path: Path) -> None:
    """Rename a journal and its log, unless another run writes it."""
    if not path.exists():
        return
    try:
        _connected(path).close()
    except (sqlite3.Error, UnicodeDecodeError) as error:  # it may be damaged
        if getattr(error, "sqlite_errorcode", 0) & 0xFF == sqlite3.SQLITE_BUSY:
            raise
    number = 1
    while (place := path.with_name(f"{path.stem}.{number}{path.suffix}")).exists():
        number += 1
    try:
        for end in ("-wal", "-shm", ""):
            if (part := path.with_name(path.name + end)).exists():
                os.rename(part, place.with_name(place.name + end))
    except OSError as error:
        fault = f"cannot be set aside ({error.strerror})"
        raise ArmDesignError(str(path), fault, "name another folder") from None
