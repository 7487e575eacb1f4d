"""The command ``armdesign report``."""

from __future__ import annotations

from armdesign.options import FolderArgument
from armdesign.output import outputs, write_page


def report(folder: FolderArgument) -> None:
    """Write report.html again from a folder's data.

    Reads report.json and the pictures beside it, which may have been replaced.
    """
    from armdesign.report.contents import Report

    kept = Report.read(folder)
    with outputs(folder) as place:
        write_page(kept, place, folder)
