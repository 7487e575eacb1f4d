"""TOML text of machine files: values changed in a text that keeps its comments, and new texts."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, get_origin

import tomlkit
from tomlkit.exceptions import TOMLKitError

from armdesign.errors import MachineFileError, choose
from armdesign.machine.file.key_paths import annotation, is_requirement, is_table
from armdesign.machine.file.schema import BY_ACTUATOR, DEFAULT

_BY_ACTUATOR = [["requirements", key] for key in BY_ACTUATOR]  # numbers that may become tables
SHOWN = 60  # letters of a value in a message
ONE_LINE = {"link", "at_mm", "cap", "annulus", "a", "b"}  # keys of tables written in one line


def edit(text: str, changes: Mapping[str, Any], source: str) -> str:
    """The text with the values at some key paths changed and all else as it was.

    A requirement may be a whole table, and new: its tables are made. Others only change.

    Raises:
        MachineFileError: a path that the file's schema does not have.
    """
    try:
        document = tomlkit.parse(text)
    except (TOMLKitError, ValueError, RecursionError) as error:
        fault = f"cannot be edited: {error}"
        raise MachineFileError(source, fault, "write it as plainer TOML") from None
    for path, value in changes.items():
        if not isinstance(path, str) or not path:
            remedy = "give one such as cylinder.boom.bore_mm"
            raise MachineFileError(source, f"{path!r} is not a key path", remedy)
        *tables, leaf = path.split(".")
        node: Any = document
        for depth, key in enumerate(tables):
            if key not in node:
                _refuse_new_table(tuple(tables[: depth + 1]), node, f"{source}: {path}")
                node[key] = tomlkit.inline_table()
            if tables[: depth + 1] in _BY_ACTUATOR and not hasattr(node[key], "keys"):
                node[key] = _inline({DEFAULT: node[key]})
            node = node[key]
            if not hasattr(node, "keys"):
                own = ".".join(tables[: depth + 1])
                raise MachineFileError(f"{source}: {path}", *_not_a_table(own, node))
        if is_requirement(tuple(path.split("."))) and isinstance(node.get(leaf), dict):
            del node[leaf]  # a table or a value takes its place as a whole
        _set_leaf(node, leaf, value, f"{source}: {path}")
    new = tomlkit.dumps(document)
    windows = "\n" in text and text.count("\n") == text.count("\r\n")
    return re.sub("(?<!\r)\n", "\r\n", new) if windows else new  # new keys have \n alone


def _inline(value: Any) -> Any:
    """A value, tables in it on one line, so that they can stand in any table."""
    if not isinstance(value, Mapping):
        return value
    table = tomlkit.inline_table()
    for key, item in value.items():
        table[key] = _inline(item)
    return table


def _refuse_new_table(location: tuple[str, ...], node: Any, where: str) -> None:
    """Raise unless the schema has this table: a change makes no load cases and no cylinders.

    It does make requirements, which the schema judges whole.
    """
    parent, _ = annotation(location[:-1])
    if is_requirement(location) and get_origin(parent) is dict:
        return
    known = parent.model_fields if is_table(parent) else node
    if known is node or location[-1] not in known:
        fault = f'no "{location[-1]}" in the file'
        if known:
            raise MachineFileError(where, fault, choose(location[-1], known))
        kind, _ = annotation(location)
        keys = f", with {', '.join(kind.model_fields)}" if is_table(kind) else ""
        raise MachineFileError(where, fault, f"write [{'.'.join(location)}] first{keys}")


def _not_a_table(path: str, value: Any) -> tuple[str, str]:
    """That a key path goes beyond a value, and how to give the value."""
    name = path.rpartition(".")[2]
    if isinstance(value, list):
        whole = f"{path}={_plain(value)}"
        shown = whole if len(whole) <= SHOWN else f"{whole[:SHOWN]} …"
        return f'"{name}" is a list', f"give the whole of it, now {shown}"
    return f'"{name}" is a value, not a table', f"name {path} itself"


def _set_leaf(node: Any, leaf: str, value: Any, where: str) -> None:
    old, value = node.get(leaf), _plain(value)
    if isinstance(old, dict):
        raise MachineFileError(where, "is a table, not a value", "name one of its keys")
    try:
        if isinstance(old, list) and isinstance(value, list) and len(old) == len(value):
            for index, item in enumerate(value):  # spacing and comments of the list stay
                if old[index] != item:  # so that 0 does not become 0.0
                    old[index] = item
        else:
            node[leaf] = _inline(value)
    except (TypeError, ValueError, TOMLKitError):
        fault, remedy = f"cannot hold {value!r}", "give a number or a text"
        raise MachineFileError(where, fault, remedy) from None


def dump(data: Mapping[str, Any], heading: str) -> str:
    """Text of a new machine file below a comment, pins and volumes in one line each.

    Raises:
        MachineFileError: a value that TOML cannot hold.
    """
    document = tomlkit.document()
    document.add(tomlkit.comment(heading))
    for key, value in data.items():
        document[key] = _item(value, str(key))
    return tomlkit.dumps(document)


def _item(value: Any, path: str) -> Any:
    value = _plain(value)
    if isinstance(value, Mapping):
        table = tomlkit.inline_table() if value and set(value) <= ONE_LINE else tomlkit.table()
        for key, item in value.items():
            if item is not None:
                table[str(key)] = _item(item, f"{path}.{key}")
        return table
    try:
        return tomlkit.item(value)
    except (TypeError, ValueError, TOMLKitError):
        fault, remedy = f"cannot hold {value!r}", "give a number, a text, a list or a table"
        raise MachineFileError(path, fault, remedy) from None


def _plain(value: Any) -> Any:
    """Numbers and lists of numpy as Python's own."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value
