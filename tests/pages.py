"""Pages of the documentation as programs: their blocks run in order, in one folder.

``python``: runs; what a comment ``# → …`` says is printed. ``console``: commands of armdesign
after ``$``, and what they say; a line ``…`` stands for any lines, spaces and rules do not count.
``toml``, ``csv``: a first line ``# NAME: the whole file`` writes it, ``# in NAME`` changes values
of a machine file; every other ``toml`` is a piece of a machine file that the schema accepts.
``text`` is prose. The comment ``<!-- slow -->`` before a block leaves it to the slow tests.
"""

from __future__ import annotations

import contextlib
import io
import re
import shlex
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import tomlkit
from sybil import Document, Example, Sybil
from sybil.parsers.myst import CodeBlockParser

from armdesign.machine.file.schema import MachineSection
from tests.commands import spoken

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = [ROOT / "README.md", *sorted(DOCS.rglob("*.md"))]
PROSE = "sh", "text"  # sh: what .ci/run takes from the README
SLOW = "<!-- slow -->"
FILE = re.compile(r"# (?:(\S+): the whole file|in (\S+))\n")


def page(path: Path) -> Document:
    """A page with its blocks."""
    parsers = [CodeBlockParser(language, run) for language, run in RUNS.items()]
    return Sybil(parsers=parsers).parse(path)  # type: ignore[no-untyped-call]


def is_slow(example: Example) -> bool:
    return str(example.document.text[: example.region.start]).rstrip().endswith(SLOW)


def run_python(example: Example) -> None:
    printed = io.StringIO()
    code = compile("\n" * example.line + str(example.parsed), example.path, "exec")
    with contextlib.redirect_stdout(printed):
        exec(code, example.namespace)
    said = printed.getvalue()
    for expected in re.findall(r"# → (.*)", str(example.parsed)):
        assert expected in said, f"{expected!r} is not in what is printed:\n{said}"


def run_console(example: Example) -> None:
    for part in re.split(r"^\$ ", str(example.parsed), flags=re.M)[1:]:
        command = re.match(r"(?:.*\\\n)*.*", part)[0]  # type: ignore[index]
        check_answer(command, answer(shlex.split(command)), part[len(command) :])


def answer(words: list[str]) -> str:
    """What a command of armdesign says on both streams."""
    assert words[0] == "armdesign", words
    said = io.StringIO()
    assert spoken(words[1:], said, said) in (0, 2), said.getvalue()
    return said.getvalue()


def check_answer(command: str, said: str, expected: str) -> None:
    """Pieces between lines ``…`` are there, in this order; without such lines nothing else is."""
    pieces = [plain(piece) for piece in re.split(r"^ *…$", expected, flags=re.M)]
    where, text = 0, plain(said)
    for piece in pieces:
        at = text.find(piece, where)
        assert at >= 0, f"$ {command}\nsays not\n{piece}\nbut\n{said}"
        where = at + len(piece)
    assert text.startswith(pieces[0]), f"$ {command}\nbegins\n{said}"
    assert text.endswith(pieces[-1]), f"$ {command}\nends\n{said}"


def plain(text: str) -> str:
    """Words of a text, without rules of tables and the blanks between columns."""
    return " ".join(re.sub("[─━│┃]+", " ", text).split())


def run_toml(example: Example) -> None:
    text = str(example.parsed)
    if not write_file(text):
        whole = tomlkit.parse((DOCS / "every_key.toml").read_text("utf-8"))
        change(whole, tomllib.loads(text))
        MachineSection.model_validate(whole.unwrap())


def run_csv(example: Example) -> None:
    assert write_file(str(example.parsed)), "name the file in the first line"


def write_file(text: str) -> bool:
    """Write or change the file that the first line of a block names, if it names one."""
    named = FILE.match(text)
    if not named:
        return False
    if named[1]:
        Path(named[1]).write_text(text, encoding="utf-8")
        return True
    file = Path(named[2])
    machine = tomlkit.parse(file.read_text("utf-8"))
    change(machine, tomllib.loads(text))
    file.write_text(tomlkit.dumps(machine), encoding="utf-8")
    return True


def change(table: Any, values: dict[str, Any]) -> None:
    for key, value in values.items():
        if isinstance(value, dict) and isinstance(table.get(key), dict):
            change(table[key], value)
        else:
            table[key] = value


RUNS: dict[str, Callable[[Example], None]] = {
    "python": run_python,
    "console": run_console,
    "toml": run_toml,
    "csv": run_csv,
}
