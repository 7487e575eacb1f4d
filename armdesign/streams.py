"""Streams of the command line: stdout and stderr that take every text, or end in one line."""

from __future__ import annotations

import codecs
import errno
import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TextIO

# of streams that have lost what they could not write, as stderr and those of ``python -u``
OF_STREAMS = {errno.EBADF, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.ENOSPC, errno.EPIPE}
ASCII = {"²": "2", "³": "3", "·": " ", "µ": "u", "×": "x", "≤": "<=", "≥": ">=", "→": "->"}
ASCII |= {"–": "-", "—": "-", "−": "-", "…": "...", "°": "deg", "±": "+-", "½": "1/2", "Σ": "sum"}


def _in_ascii(error: UnicodeError) -> tuple[str, int]:
    """Characters that a terminal lacks, in those that all have."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    lacking = error.object[error.start : error.end]
    plain = (ASCII.get(c) or c.encode("ascii", "backslashreplace").decode() for c in lacking)
    return "".join(plain), error.end


codecs.register_error("armdesign", _in_ascii)


def as_printed(text: str) -> str:
    """A text as stdout prints it: in other characters what it lacks, as deg for °."""
    encoding = getattr(sys.stdout, "encoding", None) or "utf-8"
    return text.encode(encoding, "armdesign").decode(encoding)


def replace_closed() -> None:
    """Put nothing in the place of streams that were closed, as by ``>&-``: workers need some.

    At the very beginning: under their own numbers, which nothing else must be given.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            place = os.open(os.devnull, os.O_RDWR)  # the lowest number that is free
            os.set_inheritable(place, True)
            mode = "w" if number else "r"
            setattr(sys, name, open(place, mode, encoding="utf-8"))  # noqa: SIM115


def keep_for_answers() -> None:
    """Give stdout a number of its own: at number 1 libraries in C print what is no answer.

    HiGHS has such a line, which no option of SciPy turns off. It goes nowhere.
    """
    shared = sys.stdout
    if not isinstance(shared, io.TextIOWrapper):
        return
    number = shared.fileno()
    own = open(os.dup(number), "w", encoding=shared.encoding, errors=shared.errors)  # noqa: SIM115
    own.reconfigure(line_buffering=shared.line_buffering, write_through=shared.write_through)
    shared.flush()
    sys.stdout = own
    sys.__stdout__ = own  # type: ignore[misc]  # of which the width of a terminal is asked
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, number)
    os.close(nowhere)


@contextmanager
def printing() -> Iterator[None]:
    """Within it stdout and stderr take every text; one that cannot be written is one line, code 2.

    A pipe that nobody reads any more ends the program without a word. An error of other files or
    connections is none of this.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="armdesign")
    try:
        try:
            yield
        finally:
            sys.stdout.flush()
    except OSError as error:
        broken = [stream for stream in (sys.stdout, sys.stderr) if not _flushes(stream)]
        if not broken and error.errno not in OF_STREAMS:
            raise
        for stream in broken:  # nor may Python's own end try it again
            with suppress(OSError, ValueError):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
        if not isinstance(error, BrokenPipeError):
            with suppress(OSError):
                remedy = "print to another place"
                line = f"armdesign: output: cannot be written ({error.strerror}); {remedy}"
                print(line, file=sys.stderr)
        sys.exit(2)


def _flushes(stream: TextIO) -> bool:
    """Whether a stream takes what it has, which is also what it could not write before."""
    try:
        stream.flush()
    except (OSError, ValueError):
        return False
    return True
