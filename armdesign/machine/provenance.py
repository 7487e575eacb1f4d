"""Provenance: how, when and from what a new machine was made, told in its file.

The comments at the head of today's file tell of today's machine, so the new file has a head of its
own. Every line whose value differs says what it was, followed by what its comment said of that.
All other lines stay as they are, with the comments that tell where their numbers are from.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import date
from importlib.metadata import version
from typing import Any

import tomlkit
from tomlkit.items import InlineTable

from armdesign.errors import printable
from armdesign.machine.file import machine_file, saving
from armdesign.machine.file.section import NAME_LENGTH
from armdesign.machine.file.toml_writing import edit
from armdesign.machine.machine import Machine

WAS = "# was "
WIDTH = 98  # columns of the head's lines
# what was, and what the comment said before
_STORY = re.compile(rf'{WAS}(?:"(?:\\.|[^"\\])*"|[^":])*(?:: (.*))?')


def retold(
    machine: Machine,
    today: Machine,
    word: str,
    story: Sequence[str],
    notes: Mapping[str, str] | None = None,
) -> Machine:
    """The new machine under its own name and title, with the story of how it was made in its file.

    Args:
        machine: the new machine; its story is told anew if it has one already.
        today: the machine that it was made from.
        word: what was done to it, as "optimized": ends name and title.
        story: paragraphs of the head that follow its origin.
        notes: by key path of what changed, what follows the old value, as ", by hand".
    """
    changes = _changes(machine, today)
    changes["name"] = f"{today.name[: NAME_LENGTH - len(word) - 1]}_{word}"
    changes["title"] = f"{today.section.title or today.name}, {word}"
    plain = _without_stories(today.text) if saving.is_made(today.text) else today.text
    text = _with_old_values(edit(plain, changes, today.source.name), plain, changes, notes or {})
    source = today.source.with_name(f"{changes['name']}.toml")
    signed = Machine.from_text(
        _with_head(text, _head(today, story)), today.urdf_text, source, arm=machine.arm
    )
    return signed.loaded_like(machine)


def as_toml(value: Any) -> str:
    """A value as it is written in a machine file."""
    return tomlkit.item(value).as_string()


def _changes(machine: Machine, today: Machine) -> dict[str, Any]:
    """Values of the new file that differ from today's, by key path."""
    before, after = (machine_file.flat(one.section) for one in (today, machine))
    return {path: value for path, value in after.items() if value != before.get(path)}


# --------------------------------------------------------------------------------- what a line was


def _with_old_values(
    text: str, before: str, paths: Iterable[str], notes: Mapping[str, str]
) -> str:
    """The text in which every line with one of the key paths says what it was before.

    A note on a key path follows that.
    """
    document, old = tomlkit.parse(text), tomlkit.parse(before)
    lines: dict[str, list[str]] = {}
    for path in paths:
        line, within = _line_of(document, path)
        value = _value_at(old, path)
        words = "not given" if value is None else tomlkit.item(value).as_string()
        if within and _value_at(old, line) is not None:
            words = f"{within} = {words}"
        lines.setdefault(line, []).append(words + notes.get(path, ""))
    for line, words in lines.items():
        item, former = (_value_at(whole, line, item=True) for whole in (document, old))
        trivia, origin = item.trivia, item.trivia.comment.removeprefix("#").strip()
        trivia.comment = f"{WAS}{', '.join(dict.fromkeys(words))}{origin and f': {origin}'}"
        longer = len(item.as_string()) - len(former.as_string()) if former is not None else 0
        # comments stay in their column
        trivia.comment_ws = " " * max(len(trivia.comment_ws) - longer, 2)
    return tomlkit.dumps(document)


def _without_stories(text: str) -> str:
    """The text of a file made here in which no line says any longer what it was before.

    What its comment said stays.
    """
    document = tomlkit.parse(text)
    for item in _items(document):
        if story := _STORY.fullmatch(item.trivia.comment):
            item.trivia.comment = f"# {story[1]}" if story[1] else ""
            item.trivia.comment_ws = item.trivia.comment_ws if story[1] else ""
    return tomlkit.dumps(document)


def _items(table: Any) -> Iterator[Any]:
    """Every item of a table that has a line, and of the tables in it."""
    for key in table:
        item = table.item(key) if hasattr(table, "item") else table[key]
        if hasattr(item, "trivia"):
            yield item
        if isinstance(item, Mapping) and not isinstance(item, InlineTable):
            yield from _items(item)


def _line_of(document: Any, path: str) -> tuple[str, str]:
    """The key path that has a line of its own, and what of the path lies within that line."""
    keys, node = path.split("."), document
    for depth, key in enumerate(keys, start=1):
        node = node[key]
        if isinstance(node, InlineTable):
            return ".".join(keys[:depth]), ".".join(keys[depth:])
    return path, ""


def _value_at(document: Any, path: str, item: bool = False) -> Any:
    """The value at a key path, or the ``item`` that holds it; None where there is none."""
    node = document
    for key in path.split("."):
        if key not in node:
            return None
        node = node.item(key) if item and hasattr(node, "item") else node[key]
    return node if item else tomlkit.item(node).unwrap()


# ---------------------------------------------------------------------------------------- the head


def _with_head(text: str, head: list[str]) -> str:
    """The text with the comments in front of its first key replaced.

    A ``#:schema`` line stays the first.
    """
    lines = text.splitlines(keepends=True)
    end = "\r\n" if lines and lines[0].endswith("\r\n") else "\n"
    first = next(
        (k for k, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")),
        len(lines),
    )
    schema = [line for line in lines[:first] if line.startswith(saving.DIRECTIVE)]
    return "".join([*schema, *(f"# {line}".rstrip() + end for line in head), end, *lines[first:]])


def _head(today: Machine, story: Sequence[str]) -> list[str]:
    """Lines of the new head."""
    source = today.source.name
    origin = (
        f"{saving.MADE.removeprefix('# ')} {version('armdesign')} on {date.today().isoformat()}"
    )
    paragraphs = [
        f"{origin} from {source}: {today.section.title or today.name}.",
        *story,
        f"Changed lines say what they were. Where all other numbers are from: {source}.",
    ]
    wrap = textwrap.TextWrapper(
        WIDTH, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
    )
    # printable: nothing in a line ends it but its end, so that a comment can hold it
    return [line for words in paragraphs for line in wrap.wrap(printable(words))]
