"""The command ``armdesign report``."""

from __future__ import annotations

from armdesign.options import FolderArgument
from armdesign.output_reports import write_page
from armdesign.runs import Shown, command


@command
def report(run: Shown, folder: FolderArgument) -> None:
    """Write report.html again from a folder's data.

    Reads report.json and the pictures beside it, which may have been replaced.
    """
    from armdesign.report.contents import Report

    kept = Report.read(folder)
    with run.writing(folder) as place:
        write_page(kept, place, folder)
