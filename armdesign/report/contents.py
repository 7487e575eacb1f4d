"""Contents of a report, in order: headline, sections with tables and pictures, and a drawn scene.

``report.json`` keeps all of it beside the pictures, so that the page can be written again from a
folder; nothing in it is code.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from armdesign import text_files
from armdesign.errors import ArmDesignError
from armdesign.plots.charts import Chart
from armdesign.report.scene import MapScene
from armdesign.report.sheet import Sheet
from armdesign.report.unreadable import AGAIN, lost_keys, unreadable

FILE = "report.json"
PAGE = "report.html"
FORMAT = 3  # of the file; a reader of another refuses it


@dataclass(frozen=True, kw_only=True)
class HeadlineNumber:
    """A number of the headline: its name, its value with unit, and where it holds."""

    name: str
    value: str
    words: str = ""


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A picture: its caption, and its file in the folder of the report."""

    caption: str
    file: str


@dataclass(frozen=True, kw_only=True)
class ReportSection:
    """A section of a report.

    Attributes:
        title: its heading.
        words: its paragraphs.
        sheets: its tables.
        pictures: its pictures.
        shows: "drawing" or "maps" of the scene; "" for none. On paper, and without scripts, the
            pictures stand in place of interactive maps and charts.
        charts: its interactive charts.
    """

    title: str
    words: tuple[str, ...] = ()
    sheets: tuple[Sheet, ...] = ()
    pictures: tuple[Picture, ...] = ()
    shows: str = ""
    charts: tuple[Chart, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Report:
    """A report: title, a sentence, numbers of the headline, sections, and the drawn scene.

    The scene is None where there is nothing to click on.
    """

    title: str
    lead: str
    headline: tuple[HeadlineNumber, ...] = ()
    sections: tuple[ReportSection, ...]
    scene: MapScene | None = None
    format: int = FORMAT

    def text(self) -> str:
        """All of it as the text of ``report.json``."""
        return json.dumps(asdict(self), ensure_ascii=False, separators=(",", ":")) + "\n"

    @classmethod
    def read(cls, folder: Path) -> Report:
        """The report that a folder keeps.

        Raises:
            ArmDesignError: the folder keeps none, one of another version, or a damaged one.
        """
        path = folder / FILE
        if folder.exists() and not folder.is_dir():
            raise ArmDesignError(str(folder), "is a file", f"give its folder: {folder.parent}")
        try:
            text = text_files.read(path, text_files.LARGEST_REPORT)
        except FileNotFoundError:
            fault = f"no {FILE} is there"
            commands = "write one by armdesign design, map, validate, control or paper"
            raise ArmDesignError(str(folder), fault, commands) from None
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or "not a text file"
            raise ArmDesignError(str(path), f"cannot be read ({reason})", AGAIN) from None
        return cls.of_text(text, str(path))

    @classmethod
    def of_text(cls, text: str, part: str = FILE) -> Report:
        """The report of a text that ``text`` gave; errors as of ``read``."""
        import pydantic

        try:
            report = pydantic.TypeAdapter(cls).validate_json(text)
        except pydantic.ValidationError as error:
            place = ".".join(map(str, error.errors()[0]["loc"]))
            raise unreadable(text, part, FORMAT, place) from None
        if report.format != FORMAT:
            raise unreadable(text, part, FORMAT, "")
        if lost := next(lost_keys(json.loads(text), asdict(report)), ""):
            raise unreadable(text, part, FORMAT, lost)
        return report
