"""The notebook of the documentation holds what its cells print today, and no path of a machine."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

NOTEBOOK = Path(__file__).resolve().parents[1] / "docs" / "notebook.ipynb"
EXECUTE = """
import sys, nbformat
from nbclient import NotebookClient
notebook = nbformat.read(sys.argv[1], 4)
NotebookClient(notebook, timeout=300).execute()
nbformat.write(notebook, sys.argv[2])
"""


def cells_of(path: Path) -> list[dict[str, Any]]:
    cells = json.loads(path.read_text("utf-8"))["cells"]
    return [cell for cell in cells if cell["cell_type"] == "code"]


def printed(cell: dict[str, Any]) -> list[str]:
    return ["".join(output["text"]) for output in cell["outputs"] if "text" in output]


def pictures(cell: dict[str, Any]) -> int:
    return sum("image/png" in output.get("data", {}) for output in cell["outputs"])


def test_every_cell_was_executed_and_names_no_folder() -> None:
    assert all(cell["outputs"] for cell in cells_of(NOTEBOOK))
    text = NOTEBOOK.read_text("utf-8")
    assert str(NOTEBOOK.parents[1]) not in text
    assert "/home/" not in text
    assert len(text) < 1e6


@pytest.mark.slow
def test_its_cells_print_what_it_holds(tmp_path: Path) -> None:
    again = tmp_path / "again.ipynb"
    words = [sys.executable, "-c", EXECUTE, str(NOTEBOOK), str(again)]
    done = subprocess.run(words, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr[-2000:]
    for kept, new in zip(cells_of(NOTEBOOK), cells_of(again), strict=True):
        assert printed(kept) == printed(new)
        assert pictures(kept) == pictures(new)
