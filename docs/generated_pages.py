"""What pages say of the schema, taken from it while they are read.

A page has the line ``% generated: machine file`` where the reference of the machine file goes: for
each table of the schema a table of its keys, with the texts that editors show and the examples of
``every_key.toml``. Likewise ``errata``, ``figures`` and ``numbers``.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from pydantic_core import PydanticUndefined

from armdesign.machine.file.json_schema import meaning, of_how_many
from armdesign.machine.file.key_paths import allowed, is_table, unit_of, unwrap
from armdesign.machine.file.schema import BY_ACTUATOR, MachineSection, Section
from armdesign.sweeps.numbers import MEANINGS

DOCS = Path(__file__).parent
EXAMPLES = DOCS / "every_key.toml"
NAMED = "NAME"  # stands for a name that the author of a machine file chooses
COLUMNS = "key", "unit", "default", "range", "each or together", "meaning", "example"
Row = tuple[str, str, str, str, str, str, str]  # as COLUMNS
Path_ = tuple[str, ...]


def sections(
    kind: type[Section] = MachineSection, path: Path_ = ()
) -> Iterator[tuple[type[Section], Path_]]:
    """Every table of the schema with every path at which it stands, from the top down."""
    yield kind, path
    for key, field in kind.model_fields.items():
        inner, _ = unwrap(field.annotation)
        below: Path_ = (*path, key)
        if get_origin(inner) is dict:
            inner, below = unwrap(get_args(inner)[-1])[0], (*below, NAMED)
        if is_table(inner):
            yield from sections(inner, below)


def tables() -> dict[type[Section], list[Path_]]:
    """Paths of each table of the schema."""
    paths: dict[type[Section], list[Path_]] = {}
    for kind, path in sections():
        paths.setdefault(kind, []).append(path)
    return paths


def rows(kind: type[Section], paths: list[Path_]) -> list[Row]:
    """The rows of the table of a section: one for each of its keys."""
    return [_row(kind, key, paths) for key in kind.model_fields]


def _row(kind: type[Section], key: str, paths: list[Path_]) -> Row:
    field = kind.model_fields[key]
    words, _, default = meaning(kind.__name__, key).partition("; default: ")
    unit = unit_of((*paths[0], key)).strip()
    one_or_all = of_how_many(kind.__name__, key)
    return (
        f"`{key}`",
        unit or "–",
        default or _default(field.default),
        _range(kind, key, paths).replace("a number in ", "").replace(f" {unit}" * bool(unit), ""),
        {"": "–", "each": "each"}.get(one_or_all, "together"),
        words,
        f"`{_statement(kind, key, paths)}`",
    )


def _statement(kind: type[Section], key: str, paths: list[Path_]) -> str:
    """How a file states a key: one line of it, or the heading of its table."""
    text = f"{key} = {_toml(_example(paths, key))}"
    if "…" not in text:
        return text
    inner = unwrap(kind.model_fields[key].annotation)[0]
    named = (NAMED,) if get_origin(inner) is dict else ()
    return f"[{'.'.join((*paths[0], key, *named))}]"


def _default(value: Any) -> str:
    if value is PydanticUndefined:
        return "required"
    if value is None or value == {}:
        return "none"
    return "of its keys" if isinstance(value, Section) else f"`{_toml(value)}`"


def _range(kind: type[Section], key: str, paths: list[Path_]) -> str:
    """The values that a key may have."""
    location = (*paths[0], key)
    inner = unwrap(kind.model_fields[key].annotation)[0]
    if inner is bool:
        return "`true` or `false`"
    if is_table(inner):
        return "a table"
    if get_origin(inner) is Literal:
        return " or ".join(f"`{_toml(choice)}`" for choice in get_args(inner))
    if get_origin(inner) is dict:
        named = unwrap(get_args(inner)[-1])[0]
        return "tables by name" if is_table(named) else f"by name: {allowed((*location, NAMED))}"
    return allowed(location) + ("; or a table by actuator" if key in BY_ACTUATOR else "")


def _example(paths: list[Path_], key: str) -> Any:
    """What ``every_key.toml`` has at a key, below the first of its paths that has it."""
    data = tomllib.loads(EXAMPLES.read_text("utf-8"))
    for path in paths:
        for table in _at(data, path):
            if key in table:
                return table[key]
    raise KeyError(f"{EXAMPLES.name} has no {'.'.join((*paths[0], key))}: give it one")


def _at(data: Any, path: Path_) -> list[dict[str, Any]]:
    """The tables of a file at a path, all of them where the path has ``NAME``."""
    level = [data]
    for key in path:
        level = [
            below
            for table in level
            for below in (table.values() if key == NAMED else [table[key]] if key in table else [])
        ]
    return level


def _toml(value: Any, depth: int = 0) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list):
        return f"[{', '.join(_toml(item, depth + 1) for item in value)}]"
    if isinstance(value, dict):
        if depth or len(value) > 2 or any(isinstance(item, dict) for item in value.values()):
            return "{ … }"
        items = (f"{_key(key)} = {_toml(item, depth + 1)}" for key, item in value.items())
        return f"{{ {', '.join(items)} }}"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _key(name: str) -> str:
    return f'"{name}"' if "." in name else name


def machine_file() -> str:
    """The reference of the machine file as Markdown."""
    return "\n\n".join(_table(kind, paths) for kind, paths in tables().items())


def _table(kind: type[Section], paths: list[Path_]) -> str:
    text = " ".join((kind.__doc__ or "").replace("``", "`").split())
    where = "" if len(paths) == 1 else f"\n\nAt {', '.join(_heading(path) for path in paths)}."
    lines = [" | ".join(COLUMNS), "|".join("---" for _ in COLUMNS)]
    lines += [" | ".join(cell.replace("|", "\\|") for cell in row) for row in rows(kind, paths)]
    body = "\n".join(f"| {line} |" for line in lines)
    return f"## {_title(paths)}\n\n{text}{where}\n\n{body}"


def _title(paths: list[Path_]) -> str:
    if paths == [()]:
        return "The whole file"
    return _heading(paths[0]) if len(paths) == 1 else _names(paths)


def _names(paths: list[Path_]) -> str:
    return ", ".join(dict.fromkeys(f"`{path[-1]}`" for path in paths))


def _heading(path: Path_) -> str:
    return f"`[{'.'.join(path)}]`"


def errata() -> str:
    """The paper's errata, and what each does to the frequency over its configurations."""
    from armdesign.machine.loading import load
    from armdesign.paper.configurations import grid
    from armdesign.paper.errata import errata as of_mechanism
    from armdesign.paper.errata import errata_frame

    rows = ["| equation | printed | right | change of the frequency | rms [rad/s] | remark |"]
    rows.append("|---|---|---|---|---|---|")
    for row in errata_frame(of_mechanism(grid(load("paper_1dof")))).itertuples():
        effect = f"{100 * row.least:+.2f} to {100 * row.largest:+.2f} % | {row.rms_rad_per_s:.2f}"
        if row.least != row.least:  # in no frequency
            effect = "– | –"
        rows.append(f"| {row.equation} | {row.printed} | {row.right} | {effect} | {row.remark} |")
    return "\n".join(rows)


def figures() -> str:
    """Figures of the validation as ``python -m tests.validation_figures`` wrote them."""
    rows = json.loads((DOCS / "validation.json").read_text("utf-8"))
    head = [["quantity", "source", "published", "here"], ["---"] * 4]
    return "\n".join(f"| {' | '.join(row)} |" for row in head + rows)


def numbers() -> str:
    """A table of the numbers of ``--json`` and of sweeps, by name."""
    rows = [f"| `{name}` | {text} |" for name, text in MEANINGS.items()]
    return "\n".join(["| name | meaning |", "|---|---|", *rows])


GENERATED: dict[str, Callable[[], str]] = {
    "machine file": machine_file,
    "errata": errata,
    "figures": figures,
    "numbers": numbers,
}


def fill(text: str) -> str:
    """The text of a page with its generated parts."""
    for name, part in GENERATED.items():
        marker = f"% generated: {name}\n"
        if marker in text:
            text = text.replace(marker, part() + "\n")
    return text


def setup(app: Any) -> dict[str, bool]:
    """Sphinx's door: generated parts are put into a page when it is read."""

    def read(_app: Any, _page: str, source: list[str]) -> None:
        source[0] = fill(source[0])

    def plain_bars(*event: Any) -> None:
        """Bars of a docstring are |absolute values|, not substitutions of reStructuredText."""
        lines = event[-1]
        for at, line in enumerate(lines):
            pieces = line.split("``")
            pieces[::2] = [piece.replace("|", r"\|") for piece in pieces[::2]]
            lines[at] = "``".join(pieces)

    app.connect("source-read", read)
    app.connect("autodoc-process-docstring", plain_bars)
    return {"parallel_read_safe": True}
