"""Pictures of the documentation are what the commands of its pages draw.

``python -m tests.pictures`` runs the pages and writes their pictures to ``docs/pictures``.
"""

from __future__ import annotations

import contextlib
import io
import math
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from tests import chromium
from tests.pages import DOCS, page

PICTURES = {  # of pages: each picture, and the file in the page's folder that it shows
    "own_machine": {
        "lb28_machine.png": "out/check_lb28/machine.png",
        "lb28_map.png": "map_lb28/map_reach.png",
    },
    "report": {"loader_map.png": "map/map_reach.png", "loader_report.png": "design/report.html"},
}
FOLDER = DOCS / "pictures"
WIDTH, HEAD = 1000, 1760  # [px] of pictures, and of a report's head
SQUARE = 10  # [px]: pictures are compared by the means of squares
LEVEL, FEW = 30.0, 5  # of 255, by which a square differs; squares that may: one word is ten


def drawn(path: Path) -> Image.Image:
    """A picture as a page shows it, from a file that a command has written."""
    picture = _head_of(path) if path.suffix == ".html" else Image.open(path).convert("RGB")
    height = round(picture.height * WIDTH / picture.width)
    return picture.resize((WIDTH, height), Image.Resampling.LANCZOS)


def _head_of(report: Path) -> Image.Image:
    """The upper part of a report in the browser."""
    for browser in chromium.launched():
        tab, _ = chromium.opened(browser, report, WIDTH)
        clip = {"x": 0, "y": 0, "width": WIDTH, "height": HEAD}
        shot = tab.screenshot(full_page=True, clip=clip)
    return Image.open(io.BytesIO(shot)).convert("RGB")


def stale(name: str, folder: Path) -> list[str]:
    """Pictures of a page that are not what its commands have drawn in a folder."""
    files = PICTURES.get(name, {}).items()
    there = [(picture, folder / file) for picture, file in files if (folder / file).exists()]
    return [picture for picture, path in there if differing(FOLDER / picture, drawn(path)) > FEW]


def differing(kept: Path, now: Image.Image) -> float:
    """Squares of a kept picture that differ; ∞ where the sizes do."""
    before = Image.open(kept).convert("RGB")
    if before.size != now.size:
        return math.inf
    change = np.abs(np.asarray(before, float) - np.asarray(now, float)).mean(axis=2)
    rows, columns = (size // SQUARE for size in change.shape)
    squares = change[: rows * SQUARE, : columns * SQUARE].reshape(rows, SQUARE, columns, SQUARE)
    return float((squares.mean(axis=(1, 3)) > LEVEL).sum())


def write() -> None:
    """Run the pages, and write their pictures anew."""
    for name, pictures in PICTURES.items():
        with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
            for example in page(DOCS / f"{name}.md").examples():
                example.evaluate()
            for picture, file in pictures.items():
                drawn(Path(folder) / file).save(FOLDER / picture, optimize=True)


if __name__ == "__main__":
    write()
