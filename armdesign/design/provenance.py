"""Provenance: how, when and from what a new machine was made, told in its file.

The comments at the head of today's file tell of today's machine, so the new file has a head of its
own. Every line whose value differs says what it was, followed by what its comment said of that.
All other lines stay as they are, with the comments that tell where their numbers are from.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields
from datetime import date
from importlib.metadata import version
from typing import Any

import tomlkit
from tomlkit.items import InlineTable

from armdesign.design.requirements.settings import Requirements
from armdesign.errors import printable
from armdesign.frequency.bands import Bands
from armdesign.machine.file import machine_file, saving
from armdesign.machine.file.schema import NAME_LENGTH
from armdesign.machine.file.toml_writing import edit
from armdesign.machine.machine import Machine

NEW_NAME, NEW_TITLE = "_optimized", ", optimized"
WAS = "# was "
WIDTH = 98  # columns of the head's lines
# what was, and what the comment said before
_STORY = re.compile(rf'{WAS}(?:"(?:\\.|[^"\\])*"|[^":])*(?:: (.*))?')
_TABLE = "requirements."


def documented(
    machine: Machine, today: Machine, requirements: Requirements, command: str
) -> Machine:
    """The new machine under its own name and title, with the story of how it was made in its file.

    Args:
        machine: the new machine; its story is told anew if it has one already.
        today: the machine that it was made from.
        requirements: the limits within which it was made.
        command: what made it, as typed in a terminal or in Python.
    """
    changes = _changes(machine, today)
    changes["name"] = today.name[: NAME_LENGTH - len(NEW_NAME)] + NEW_NAME
    changes["title"] = (today.section.title or today.name) + NEW_TITLE
    told = _without_stories(today.text) if saving.is_made(today.text) else today.text
    text = edit(told, changes, today.source.name)
    text = _with_head(_with_old_values(text, told, changes), _head(today, requirements, command))
    source = today.source.with_name(f"{changes['name']}.toml")
    signed = Machine.from_text(text, today.urdf_text, source, arm=machine.arm)
    return signed.loaded_like(machine)


def call(function: str, **arguments: Any) -> str:
    """A call of this package as it is written in Python.

    Arguments that ask for nothing are left out.
    """
    words = ", ".join(
        f"{name}={value!r}" for name, value in arguments.items() if value not in (None, Bands())
    )
    return f"armdesign.{function}({words})"


def _changes(machine: Machine, today: Machine) -> dict[str, Any]:
    """Values of the new file that differ from today's, by key path."""
    before = machine_file.flat(today.section)
    return {
        path: value
        for path, value in machine_file.flat(machine.section).items()
        if value != before.get(path)
    }


# --------------------------------------------------------------------------------- what a line was


def _with_old_values(text: str, before: str, paths: Iterable[str]) -> str:
    """The text in which every line with one of the key paths says what it was before."""
    document, old = tomlkit.parse(text), tomlkit.parse(before)
    lines: dict[str, list[str]] = {}
    for path in paths:
        line, within = _line_of(document, path)
        value = _found(old, path)
        words = "not given" if value is None else tomlkit.item(value).as_string()
        lines.setdefault(line, []).append(f"{within} = {words}" if within else words)
    for line, words in lines.items():
        item, former = (_found(whole, line, item=True) for whole in (document, old))
        trivia, origin = item.trivia, item.trivia.comment.removeprefix("#").strip()
        trivia.comment = f"{WAS}{', '.join(words)}{origin and f': {origin}'}"
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


def _found(document: Any, path: str, item: bool = False) -> Any:
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


def _head(today: Machine, requirements: Requirements, command: str) -> list[str]:
    """Lines of the new head."""
    source = today.source.name
    paragraphs = [
        (
            f"{saving.MADE.removeprefix('# ')} {version('armdesign')} on"
            f" {date.today().isoformat()} from {source}: {today.section.title or today.name}."
        ),
        f"Command: {command}",
        f"Requirements: {_stated(today, requirements)}.",
        f"Changed lines say what they were. Where all other numbers are from: {source}.",
    ]
    return [line for words in paragraphs for line in _wrapped(words)]


def _stated(today: Machine, requirements: Requirements) -> str:
    """Every requirement of today's file, defaults included, and what was asked for instead."""
    words = ", ".join(
        f"{path.removeprefix(_TABLE)} {tomlkit.item(value).as_string()}"
        for path, value in machine_file.flat(today.section).items()
        if path.startswith(_TABLE)
    )
    of_file = Requirements.of(today)
    pairs = (
        (f.name, getattr(requirements, f.name), getattr(of_file, f.name))
        for f in fields(Requirements)
    )
    instead = ", ".join(f"{name} = {value!r}" for name, value, before in pairs if value != before)
    return f"{words}; instead of these, in SI units: {instead}" if instead else words


def _wrapped(words: str) -> list[str]:
    """Lines that a comment can hold: nothing in them ends the line but their end."""
    return textwrap.wrap(
        printable(words),
        WIDTH,
        subsequent_indent="  ",
        break_long_words=False,
        break_on_hyphens=False,
    )
