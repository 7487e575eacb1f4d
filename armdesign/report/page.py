"""The page of a report: one HTML file that needs no network, for screens, phones and paper.

The only door to jinja2.
"""

from __future__ import annotations

import base64
import io
import json
import warnings
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from armdesign import text_files
from armdesign.errors import printable
from armdesign.report.contents import Picture, Report
from armdesign.report.interactive import interactive
from armdesign.report.sheet import Sheet

if TYPE_CHECKING:
    from PIL.Image import Image

WIDEST = 1500  # [pixels] of a picture on the page, as wide as ``plots.save`` writes them
COLOURS = 128  # of one that has no palette
PAPER = 95  # letters in a line of a printed table
GROUPED = ("→", "″", " ")  # how the first cell of a row begins that belongs to the one above


class EmbeddedPicture(NamedTuple):
    """A picture on the page; no data where the folder lacks its file."""

    caption: str
    file: str
    data: str


def page(report: Report, folder: Path) -> str:
    """HTML text of a report, with its pictures of a folder; words stand for those that lack."""
    import jinja2

    home = Path(__file__).parent
    environment = jinja2.Environment(
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
        finalize=_plain,
        loader=jinja2.FileSystemLoader(home),
    )
    environment.filters |= {"sortable": sortable, "dense": dense}
    scene = report.scene
    charts = [one for section in report.sections for one in section.charts]
    return environment.get_template("page.html.j2").render(
        report=report,
        picture=lambda one: _embedded(one, folder),
        figures=interactive(scene, charts) if scene or charts else None,
        scene=_as_script(asdict(scene)) if scene else "",
        style=(home / "page.css").read_text(encoding="utf-8"),
        code=(home / "page.js").read_text(encoding="utf-8"),
    )


def sortable(sheet: Sheet) -> bool:
    """Whether the rows of a sheet stand for themselves, so that any order is as good."""
    grouped = any(not row[0] or row[0].startswith(GROUPED) for row in sheet.rows)
    named = bool(sheet.columns) and bool(sheet.columns[0])
    return len(sheet.rows) > 2 and named and not sheet.bold and not grouped


def dense(sheet: Sheet) -> bool:
    """Whether a sheet is too wide for paper in the usual size of letters, words unbroken."""
    rows = [row for row in (sheet.columns, *sheet.rows) if row]
    count = max(map(len, rows), default=0)
    words = ([w for row in rows for w in row[k : k + 1] for w in w.split()] for k in range(count))
    return sum(max(map(len, column), default=0) + 2 for column in words) > PAPER


def _plain(value: object) -> object:
    """Text without control characters; markup as it is."""
    return printable(value) if isinstance(value, str) and not hasattr(value, "__html__") else value


def _as_script(data: object) -> str:
    """JSON that can stand in a script element: nothing in it ends the element."""
    return json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")


def _embedded(picture: Picture, folder: Path) -> EmbeddedPicture:
    """A picture of the folder with few colours, as base64."""
    from PIL import Image

    path = folder / Path(picture.file).name  # of no other folder
    try:
        dots = text_files.read_bytes(path, text_files.LARGEST_REPORT)
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(dots)) as image:
                image.load()
                small = image.format == "PNG" and image.mode == "P" and image.width <= WIDEST
                dots = dots if small else _few_dots(image)
    except Exception:  # of any kind, as each format's reader has its own of a damaged file
        return EmbeddedPicture(picture.caption, picture.file, "")
    return EmbeddedPicture(picture.caption, picture.file, base64.b64encode(dots).decode("ascii"))


def _few_dots(image: Image) -> bytes:
    """A picture as small PNG."""
    from PIL.Image import Quantize

    plain, stream = _on_white(image), io.BytesIO()
    plain.thumbnail((WIDEST, 4 * WIDEST))
    few = plain.quantize(COLOURS, Quantize.FASTOCTREE)
    white = (255 if value == 254 else value for value in few.getpalette() or ())
    few.putpalette(list(white))  # the octree's brightest is one step below
    few.save(stream, format="PNG")
    return stream.getvalue()


def _on_white(image: Image) -> Image:
    """A picture without transparency."""
    from PIL.Image import new

    if image.mode == "RGB":
        return image
    rgba = image.convert("RGBA")
    alpha = rgba.getchannel("A")
    if alpha.getextrema() == (255, 255):
        return rgba.convert("RGB")
    plain = new("RGB", image.size, "white")
    plain.paste(rgba, mask=alpha)
    return plain
