"""Files that people give: regular ones of bounded size; text of them in UTF-8.

What is no regular file (a device, a pipe) may never end, also behind a symbolic link, so it is
told before anything is read of it.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

MB = 1_000_000
LARGEST_MACHINE_FILE = 1 * MB  # a hundred times the largest one that comes with the package
LARGEST_URDF = 4 * MB
LARGEST_TABLE = 64 * MB  # a CSV file: an hour of ten signals at 200 Hz
LARGEST_REPORT = 64 * MB  # report.json: that of a design takes up to 1 MB; and a picture beside it
# without waiting: a pipe is opened before it is known to be one
READ = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)


def read(path: str | Path, largest: int) -> str:
    """Text of a file as it is, its line ends too, without a byte-order mark.

    Args:
        path: of the file.
        largest: bytes that it may have.

    Raises:
        OSError: no such file, no regular one, or a larger one.
        ValueError: no UTF-8, or a path that no file can have.
    """
    return read_bytes(path, largest).decode("utf-8-sig")


def read_bytes(path: str | Path, largest: int) -> bytes:
    """Bytes of a file of at most so many; errors as of ``read``."""
    opened = os.open(path, READ)
    try:
        kind = os.fstat(opened).st_mode
        if stat.S_ISDIR(kind):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        if not stat.S_ISREG(kind):
            raise OSError(errno.EINVAL, "no regular file")
        with os.fdopen(opened, "rb", closefd=False) as file:
            data = file.read(largest + 1)
    finally:
        os.close(opened)
    if len(data) > largest:
        raise OSError(errno.EFBIG, f"larger than {largest / MB:g} MB")
    return data
