"""Pictures of a report's folder on its page: what cannot be shown is told."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import pytest

from armdesign.report.contents import Picture, Report, ReportSection
from armdesign.report.page import page


def test_a_picture_that_lacks_is_told_and_others_are_of_the_folder_alone(tmp_path: Path) -> None:
    outside = tmp_path / "outside.png"
    outside.write_bytes(b"no picture")
    folder = tmp_path / "folder"
    folder.mkdir()
    pictures = tuple(Picture(caption="C", file=f) for f in ("a.png", "../outside.png"))
    report = Report(title="", lead="", sections=(ReportSection(title="", pictures=pictures),))
    assert page(report, folder).count("the folder has no picture") == 2


def black_png(side: int) -> bytes:
    """A square picture of one bit a dot, by hand: Pillow would hold a byte for each."""
    head = struct.pack(">IIBBBBB", side, side, 1, 0, 0, 0, 0)
    lines = zlib.compress(bytes((-(-side // 8) + 1) * side))
    chunks = ((b"IHDR", head), (b"IDAT", lines), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )


@pytest.mark.parametrize(
    ("data", "shown"),
    [
        (black_png(100), True),
        (black_png(10_000), False),  # Pillow warns
        (black_png(15_000), False),  # Pillow refuses
        (black_png(100).replace(b"IDAT", b"<???"), False),
        (black_png(100)[:50], False),
    ],
    ids=["whole", "large", "larger", "damaged", "cut"],
)
def test_a_picture_that_is_damaged_or_too_large_lacks(
    data: bytes, shown: bool, tmp_path: Path
) -> None:
    (tmp_path / "a.png").write_bytes(data)
    section = ReportSection(title="", pictures=(Picture(caption="C", file="a.png"),))
    text = page(Report(title="", lead="", sections=(section,)), tmp_path)
    assert ("the folder has no picture" in text) is not shown
