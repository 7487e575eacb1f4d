"""Where the keys of a TOML text stand: their lines, for messages.

Neither ``tomllib`` nor ``tomlkit`` (python-poetry/tomlkit, issue 55) tells where a key was read,
so the text is scanned once more: headers of tables, dotted and quoted keys, inline tables, lists.
Only text that ``tomllib`` has read without fault may be scanned.
"""

from __future__ import annotations

import bisect
import contextlib
import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from armdesign.errors import ArmDesignError

Keys = tuple[str, ...]
_SPACE = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")
_BARE = re.compile(r"[A-Za-z0-9_-]+")
_SCALAR = re.compile(r"[^,\]}#\r\n]*")
_QUOTED = re.compile(
    r'"""(?:\\.|[^\\])*?"{3,5}(?!")' r"|'''.*?'{3,5}(?!')" r'|"(?:\\.|[^"\\\n])*"' r"|'[^'\n]*'",
    re.DOTALL,
)


@dataclass(frozen=True)
class Place:
    """Line of a key, counted from 1, and its value as it is written; "" of a table."""

    line: int
    written: str


def tell_line(error: ArmDesignError, places: Places, source: str) -> None:
    """Give an error the line of the key that it names, if it is about a key of this file."""
    if error.part.startswith(f"{source}: "):
        error.tell_line(places.line_of(error.part.removeprefix(f"{source}: ")))
    elif error.key:
        error.tell_line(places.line_of(error.key), source)


@contextlib.contextmanager
def lines_of(text: str, source: str) -> Iterator[None]:
    """Within it, errors about keys of a file say the line of its text.

    None where the text does not have the key.

    Args:
        text: TOML, without fault wherever a key is spoken of.
        source: the file's name in messages.
    """
    try:
        yield
    except ArmDesignError as error:
        tell_line(error, Places(text), source)
        raise


class Places:
    """Places of all keys of a TOML text.

    Args:
        text: TOML without fault.
    """

    def __init__(self, text: str) -> None:
        self._text = text
        self._found: dict[Keys, Place] = {}

    @cached_property
    def by_path(self) -> dict[str, Place]:
        """Place of every key, table and list item by its path.

        Of a table its header, or the key that makes it.
        """
        table: Keys = ()
        at = self._past_space(0)
        while at < len(self._text):
            if self._text[at] == "[":
                brackets = 2 if self._text.startswith("[[", at) else 1
                table, end = self._key(at + brackets)
                self._note(table, at, "")
                at = self._text.index("]", end) + brackets
            else:
                at = self._pair(table, at)
            at = self._past_space(at)
        return {".".join(keys): place for keys, place in self._found.items()}

    def line_of(self, path: str) -> int | None:
        """Line of a key path, or of the nearest table above it that the text has.

        None where it has neither.
        """
        while path and path not in self.by_path:
            path = path.rpartition(".")[0]
        return self.by_path[path].line if path else None

    def written(self, path: str) -> str:
        """The value at a key path as it is written; "" where there is none."""
        return self.by_path[path].written if path in self.by_path else ""

    @cached_property
    def _line_ends(self) -> list[int]:
        return [match.start() for match in re.finditer("\n", self._text)]

    def _note(self, keys: Keys, at: int, written: str) -> None:
        """Note a key that stands at ``at``, and the tables that it makes."""
        line = bisect.bisect_left(self._line_ends, at) + 1
        for depth in range(1, len(keys)):
            self._found.setdefault(keys[:depth], Place(line, ""))
        self._found[keys] = Place(line, written)

    def _past_space(self, at: int) -> int:
        match = _SPACE.match(self._text, at)
        return match.end() if match else at

    def _key(self, at: int) -> tuple[Keys, int]:
        """The parts of a dotted key and where it ends."""
        parts: list[str] = []
        while True:
            at = self._past_space(at)
            if quoted := _QUOTED.match(self._text, at):
                parts.append(str(tomllib.loads(f"key = {quoted[0]}")["key"]))
            match = quoted or _BARE.match(self._text, at)
            if match is None:
                raise ValueError(f"no key at {at}: the text is not TOML")
            if not quoted:
                parts.append(match[0])
            at = self._past_space(match.end())
            if self._text[at] != ".":
                return tuple(parts), at
            at += 1

    def _pair(self, table: Keys, at: int) -> int:
        """Read ``key = value``; where it ends."""
        key, equals = self._key(at)
        start = self._past_space(equals + 1)
        end = self._value((*table, *key), start)
        self._note((*table, *key), at, self._text[start:end].rstrip())
        return end

    def _value(self, keys: Keys, at: int) -> int:
        """Read a value and what is in it; where it ends."""
        opening = self._text[at]
        if opening not in "[{":
            match = _QUOTED.match(self._text, at) or _SCALAR.match(self._text, at)
            return match.end() if match else at
        at, index = self._past_space(at + 1), 0
        while self._text[at] not in "]}":
            if self._text[at] == ",":
                at += 1
            elif opening == "{":
                at = self._pair(keys, at)
            else:
                end = self._value((*keys, str(index)), at)
                self._note((*keys, str(index)), at, self._text[at:end].rstrip())
                at, index = end, index + 1
            at = self._past_space(at)
        return at + 1
