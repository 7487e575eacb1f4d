"""A sheet as a table for the terminal, which need not be wide: words wrap, numbers stay whole."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import TYPE_CHECKING

from armdesign.report.sheet import Sheet

if TYPE_CHECKING:
    from rich.console import JustifyMethod
    from rich.table import Table

MANY = 9  # columns stand closer together
LEAST = 12  # characters of a column of words
PARTS = re.compile(r"\s|(?<=_)|(?<=\.)(?=[A-Za-z])")  # between what stays whole of a head


def terminal_table(sheet: Sheet, room: int) -> Table:
    """Columns of a sheet, without title and note, in ``room`` characters.

    Where that is too little heads wrap, and words: the widest column most. Numbers are never cut:
    the table is rather wider.
    """
    from rich import box
    from rich.table import Table
    from rich.text import Text  # a unit in brackets looks like markup

    heads = [head.replace(" [", "\n[") for head in sheet.columns or ("", "")]
    texts = [[head, *cells] for head, *cells in zip(heads, *sheet.rows, strict=True)]
    words = [not i or head in sheet.words for i, head in enumerate(sheet.columns)] or [True, True]
    gap = 3 if len(heads) < MANY else 2
    widths = [_longest(text.split("\n") for text in column) for column in texts]
    if _total(widths, gap) > room:
        gap = 2
        widths = _narrower(texts, words, widths, room - _total([0] * len(heads), gap))
    table = Table(
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        padding=(0, 1) if gap == 3 else (0, 1, 0, 0),
        show_header=bool(sheet.columns),
        width=_total(widths, gap),
    )
    for head, width, left in zip(heads, widths, words, strict=True):
        justify: JustifyMethod = "left" if left else "right"
        broken = "\n".join(_broken(line, width) for line in head.split("\n"))
        table.add_column(Text(broken), justify=justify, width=width, overflow="fold")
    for index, row in enumerate(sheet.rows):
        cells = (Text(_broken(text, width)) for text, width in zip(row, widths, strict=True))
        table.add_row(*cells, style="bold" if index in sheet.bold else None)
    return table


def _broken(text: str, width: int) -> str:
    """Key paths longer than their column, broken behind a point or an underscore."""
    part = rf".{{1,{width}}}(?:(?<=[._])|$)|.{{{width}}}"
    words = ("\n".join(re.findall(part, word)) for word in text.split(" "))
    return " ".join(words)


def _total(widths: list[int], gap: int) -> int:
    """Width of a table of columns so wide, with what is between them and on both edges."""
    return sum(widths) + gap * (len(widths) - 1) + 2


def _longest(parts: Iterable[list[str]]) -> int:
    from rich.cells import cell_len

    return max((cell_len(part) for some in parts for part in some), default=1)


def _narrower(
    texts: list[list[str]], words: list[bool], widths: list[int], room: int
) -> list[int]:
    """Columns of numbers with wrapped heads, and of words in what is left, if that is enough."""
    narrow = list(widths)
    for i, (head, *cells) in enumerate(texts):
        if not words[i]:
            narrow[i] = _longest([PARTS.split(head), cells])
    while sum(narrow) > room:
        widest = max((i for i, left in enumerate(words) if left), key=lambda i: narrow[i])
        if narrow[widest] <= LEAST:
            break
        narrow[widest] -= 1
    return narrow
