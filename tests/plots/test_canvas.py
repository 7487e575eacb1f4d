"""The door to matplotlib: where it keeps its list of fonts."""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

import pytest

from armdesign import user_folders
from armdesign.errors import ArmDesignError
from armdesign.plots import canvas


@pytest.fixture
def homeless(monkeypatch: pytest.MonkeyPatch) -> pytest.MonkeyPatch:
    """A first figure, by a user whose home cannot be written."""
    monkeypatch.delitem(sys.modules, "matplotlib", raising=False)
    monkeypatch.setenv("MPLCONFIGDIR", "")
    monkeypatch.delenv("MPLCONFIGDIR")
    monkeypatch.setenv("XDG_CONFIG_HOME", "relative")
    return monkeypatch


def test_memory_is_the_last_temporary_folder(homeless: pytest.MonkeyPatch) -> None:
    """Read-only disks: the folder of shared memory is left."""
    homeless.setattr(user_folders, "made_private", lambda folder: "/dev/shm" in str(folder))
    homeless.setattr(user_folders, "writable", lambda folder: True)
    canvas.choose_font_cache()
    name = f"armdesign-{os.getuid()}"
    assert Path(os.environ["MPLCONFIGDIR"]) == Path("/dev/shm") / name / "matplotlib"


def test_no_folder_at_all_is_one_line(homeless: pytest.MonkeyPatch) -> None:
    def none() -> str:
        raise FileNotFoundError

    homeless.setattr(user_folders, "made_private", lambda folder: False)
    homeless.setattr(tempfile, "gettempdir", none)
    with pytest.raises(ArmDesignError, match="matplotlib: no folder can be written"):
        canvas.choose_font_cache()
