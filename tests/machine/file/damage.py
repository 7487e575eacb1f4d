"""Random damage to machine files and URDFs: characters, lines, numbers, tokens, structure."""

from __future__ import annotations

import random
import re

NUMBER, WORD = r"-?\d+\.?\d*(?:e-?\d+)?", r"[\w.-]+"
QUOTED, ATTRIBUTE, ELEMENT = r'"[^"\n]*"', r' \w+="[^"]*"', r"<(\w+)[^<>]*/>"
LETTERS = "0123456789.-e[]{}\"'=#<>/ \x00é\t"


NUMBERS = [
    "0",
    "-1",
    "1e30",
    "1e-30",
    "nan",
    "1e9",
    "1e-9",
    "inf",
    "1e400",
    "1e-320",
    "9" * 400,
    "1_0",
    '"x"',
    "-0.0",
    "true",
    "[]",
    "",
]


def _one_of(pattern: str, text: str, chance: random.Random) -> tuple[int, int]:
    """Where a random match starts and ends; a random place where there is none."""
    spans = [match.span() for match in re.finditer(pattern, text)]
    i = chance.randrange(max(len(text), 1))
    return chance.choice(spans or [(i, i)])


def _characters(text: str, chance: random.Random) -> str:
    i = chance.randrange(max(len(text), 1))
    j = i + chance.choice([1, 1, 2, 5, 30])
    return (
        text[:i]
        + chance.choice(["", text[i:j] * 2, text[i:j][::-1], chance.choice(LETTERS)])
        + text[j:]
    )


def _lines(text: str, chance: random.Random) -> str:
    """One deleted, doubled elsewhere, or two swapped; in XML on one line the elements are the
    lines.
    """
    glue = "\n" if text.count("\n") > 5 else ">"
    lines = text.split(glue)
    a, b = chance.randrange(len(lines)), chance.randrange(len(lines))
    kind = chance.randrange(3)
    if kind == 0:
        del lines[a]
    elif kind == 1:
        lines.insert(b, lines[a])
    else:
        lines[a], lines[b] = lines[b], lines[a]
    return glue.join(lines)


def _number(text: str, chance: random.Random) -> str:
    start, end = _one_of(NUMBER, text, chance)
    new = chance.choice([*NUMBERS, f"-{text[start:end]}", f"{text[start:end]}0"])
    return text[:start] + new + text[end:]


def _token(text: str, chance: random.Random) -> str:
    """A word deleted, or two words exchanged."""
    return (
        _exchanged(WORD, text, chance) if chance.random() < 0.5 else _without(WORD, text, chance)
    )


def _without(pattern: str, text: str, chance: random.Random) -> str:
    start, end = _one_of(pattern, text, chance)
    return text[:start] + text[end:]


def _exchanged(pattern: str, text: str, chance: random.Random) -> str:
    (a, b), (c, d) = sorted(_one_of(pattern, text, chance) for _ in range(2))
    return text if b > c else text[:a] + text[c:d] + text[b:c] + text[a:b] + text[d:]


def _link(text: str, chance: random.Random) -> str:
    """A quoted name, mostly of a link or joint, in the place of another."""
    return _exchanged(QUOTED, text, chance)


def _structure(text: str, chance: random.Random) -> str:
    """An attribute or a whole element out of a URDF; a key's value, a table's head out of a
    machine file.
    """
    patterns = (
        [ATTRIBUTE, ELEMENT]
        if "<robot" in text
        else [r"(?m)= .*$", r"(?m)^\[.*\]$", r"(?m)^\w+ *= .*$"]
    )
    return _without(chance.choice(patterns), text, chance)


WOUNDS = (_characters, _lines, _number, _number, _token, _link, _structure)


def damaged(text: str, chance: random.Random) -> str:
    """One to four random wounds."""
    for _ in range(chance.choice([1, 1, 1, 2, 4])):
        text = chance.choice(WOUNDS)(text, chance)
    return text


def damaged_bytes(text: str, chance: random.Random) -> bytes:
    """As ``damaged``; every tenth has some bytes overwritten instead, which then seldom are
    UTF-8.
    """
    if chance.random() > 0.1:
        return damaged(text, chance).encode()
    data = bytearray(text.encode())
    for _ in range(chance.choice([1, 3])):
        data[chance.randrange(len(data))] = chance.randrange(256)
    return bytes(data)
