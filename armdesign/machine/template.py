"""``armdesign new``: a commented machine file to fill in, complete enough to be mapped at once.

It is a boom of the ``scaffold``, or is like a machine that there is. The comments are what the
schema says of the keys; tables that a machine may have besides stand at the end as comments.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from armdesign.errors import ArmDesignError
from armdesign.machine import scaffold
from armdesign.machine.file.json_schema import meaning, of_how_many
from armdesign.machine.file.key_paths import Location, annotation, is_table
from armdesign.machine.file.schema import MachineSection
from armdesign.machine.file.section import DEVICE, NAME_LENGTH, NAME_PATTERN, NAME_RULE
from armdesign.machine.file.toml_writing import ONE_LINE
from armdesign.machine.links_of_urdf import links_of
from armdesign.machine.loading import load
from armdesign.machine.machine import Machine
from armdesign.machine.parallelogram import with_four_bar

COLUMN, WIDTH = 46, 99  # where comments begin, and the last column
PLACEHOLDERS = "EVERY NUMBER IS A PLACEHOLDER: replace it, and say where yours is from."


def new(name: str, *, links: int = 2, like: str = "", four_bar: bool = False) -> str:
    """Text of a machine file that can be mapped.

    Args:
        name: of the machine.
        links: moving links of its boom, 1 to 6.
        like: a machine that it is like, in place of a boom: its name or path; "" for none.
        four_bar: whether a four-bar is to move its last joint.

    Raises:
        ArmDesignError: a name that no machine can have, another number of links, no such machine,
            or one without a joint that a four-bar could move.
    """
    if DEVICE.fullmatch(name):
        fault = f'"{name}" is a device of Windows, not a file'
        raise ArmDesignError("name", fault, "give another name")
    if not re.match(NAME_PATTERN, name) or len(name) > NAME_LENGTH or name.endswith("\n"):
        remedy = f"{NAME_RULE}, at most {NAME_LENGTH}"
        raise ArmDesignError("name", f'"{name:.70}" is not allowed', remedy)
    if like:
        source = load(like)
        data, origin = _like(source, name), f"the numbers are from {source.name}"
    else:
        data, origin = scaffold.data_of(name, links), f"a boom of {links} link{'s' * (links > 1)}"
    text = _text(name, data, origin)
    if four_bar:
        machine = Machine.from_text(text, "", Path(f"{name}.toml"))
        text = _text(name, with_four_bar(data, machine), origin)
    Machine.from_text(text, "", Path(f"{name}.toml"))  # a name of a link may not be one of a table
    return text


def _like(machine: Machine, name: str) -> dict[str, Any]:
    """Data of a machine under another name, with its links in the file."""
    data = tomllib.loads(machine.text)
    data["title"] = f"{name}, like {machine.name}"
    data.pop("urdf", None)
    data["cylinder"] = {k: {"count": 1, **table} for k, table in data["cylinder"].items()}
    links = data.pop("links", None) or links_of(machine.urdf_text)
    return {"name": name, **{k: v for k, v in data.items() if k != "name"}, "links": links}


# -------------------------------------------------------------------------------------------- text


def _text(name: str, data: Mapping[str, Any], origin: str) -> str:
    head = [
        "#:schema ./machine.schema.json",
        f"# {name}, made by `armdesign new`: {origin}.",
        f"# {PLACEHOLDERS}",
        "# Units are in the keys. A link's frame lies in the joint that carries it: x along",
        "# the link, z up at 0; at_mm is x, y, z there. What could be of each parallel cylinder",
        "# or of all together says which.",
        f"# Then: armdesign check {name}.toml    armdesign map {name}.toml",
        "",
    ]
    body = _TomlLines()
    order = ["name", "title", "joints", "frozen", "damped", "tool"]
    order += ["links", "payload", "fluid", "supply", "cylinder", "motor", "spring", "stability"]
    order += ["lift_chart", "bands", "requirements", "tolerances"]
    for key in (key for key in order if key in data):
        body.add((key,), data[key])
    return "\n".join([*head, *body.lines, *_further(data)]) + "\n"


class _TomlLines:
    """Lines of a TOML text, each key with what the schema says of it."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self._said: set[str] = set()

    def add(self, location: Location, value: Any) -> None:
        """Add what is at a key path: a line, or a table with its own."""
        if not isinstance(value, Mapping):
            self._add_line(location, f"{_key(location[-1])} = {_value(value)}")
        elif (value and set(value) <= ONE_LINE) or _is_plain(location, value):
            self._add_line(location, f"{_key(location[-1])} = {_inline(value)}")
        else:
            self._add_table(location, value)

    def _add_table(self, location: Location, table: Mapping[str, Any]) -> None:
        own = {key: item for key, item in table.items() if not _has_header(location, key, item)}
        is_named = is_table(annotation(location)[0])
        if own or is_named:
            self.lines.append("")
            self._add_line(location, f"[{'.'.join(map(_key, location))}]")
        elif words := _words(location)[0]:
            self.lines += ["", *_wrapped(f"{location[-1]}: {words}")]
        for key, item in own.items():
            self.add((*location, key), item)
        for key, item in table.items():
            if key not in own:
                self.add((*location, key), item)

    def _add_line(self, location: Location, line: str) -> None:
        words = self._words(location)
        if not words:
            self.lines += _folded(line)
        elif len(line) <= COLUMN - 2 and COLUMN + 2 + len(words) <= WIDTH:
            self.lines.append(f"{line:<{COLUMN}}# {words}")
        elif len(line) + 4 + len(words) <= WIDTH:
            self.lines.append(f"{line}  # {words}")
        else:
            self.lines += [*_wrapped(words), *_folded(line)]

    def _words(self, location: Location) -> str:
        """The schema's words on a key, where it comes first; each or together wherever it is."""
        words, how_many = _words(location)
        new = words if words not in self._said else ""
        self._said.add(words)
        return "; ".join(filter(None, [new, how_many]))


def _words(location: Location) -> tuple[str, str]:
    """Meaning of a key, and whether it is of each parallel actuator or of all together."""
    *tables, key = location
    kind = annotation(tuple(tables))[0] if tables else MachineSection
    section = kind.__name__ if is_table(kind) else ""
    return meaning(section, key) if section else "", of_how_many(section, key)


def _is_plain(location: Location, value: Mapping[str, Any]) -> bool:
    """Whether a table of named entries holds values alone, as ``frozen`` and shares."""
    kind = annotation(location)[0]
    return not is_table(kind) and not any(isinstance(item, Mapping) for item in value.values())


def _has_header(location: Location, key: str, item: Any) -> bool:
    """Whether what is at a key stands below a header of its own."""
    if not isinstance(item, Mapping) or (item and set(item) <= ONE_LINE):
        return False
    return not _is_plain((*location, key), item)


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", str(key)) else f'"{key}"'


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    return repr(value)


def _inline(table: Mapping[str, Any]) -> str:
    items = (
        f"{_key(key)} = {_inline(item) if isinstance(item, Mapping) else _value(item)}"
        for key, item in table.items()
    )
    return f"{{ {', '.join(items)} }}"


def _folded(line: str) -> Iterator[str]:
    """A line, or lists of places in several."""
    if len(line) <= WIDTH or "[[" not in line:
        yield line
        return
    key, _, places = line.partition("[[")
    yield f"{key}["
    row = "   "
    for place in places.removesuffix("]]").split("], ["):
        if len(row) + len(place) + 4 > WIDTH:
            yield row
            row = "   "
        row += f" [{place}],"
    yield from (row, "]")


def _wrapped(words: str) -> list[str]:
    import textwrap

    return [f"# {line}" for line in textwrap.wrap(words, WIDTH - 2)]


# ----------------------------------------------------------------------------------------- further


def _further(data: Mapping[str, Any]) -> Iterator[str]:
    """Tables that most machines have and this one does not, as comments."""
    cylinder, link = next(iter(data["cylinder"])), data["tool"]["link"]
    path = Path(__file__).with_name("template_further.txt")
    hoses = {k: f"{x / 2:.2g}" for k, x in data["cylinder"][cylinder]["dead_volume_l"].items()}
    text = path.read_text(encoding="utf-8").format(cylinder=cylinder, link=link, **hoses)
    yield from ("", "# ----- what a machine may have besides: take the # away from what yours has")
    for block in text.strip().split("\n\n"):
        words = block.splitlines()[0].partition("]")[0].removeprefix("# [").split(".")
        given = data.get(words[0], {})
        if words[0] == "cylinder":
            there = any(words[2] in table for table in given.values())
        else:
            there = words[1] in given if words[0] == "requirements" else bool(given)
        if not there:
            yield from ("", *block.splitlines())
