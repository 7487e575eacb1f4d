"""The door to matplotlib: where it keeps its list of fonts, and titles that wrap."""

from __future__ import annotations

import itertools
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest

import armdesign as ad
from armdesign import plots, user_folders
from armdesign.errors import ArmDesignError
from armdesign.plots import canvas
from tests.machines import named


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


LONG = {
    "Latin": "Bagger mit sehr langem Ausleger und Stiel, zweiter Prototyp nach dem Umbau " * 2,
    "Cyrillic": "Экскаватор гусеничный с удлинённой стрелой, опытный образец после переработки "
    * 2,
    "one word": "W" * 120,
}


@pytest.mark.parametrize("script", LONG)
def test_long_titles_stay_within_their_part_of_the_figure(script: str) -> None:
    """Whole, on paper, clear of the axes beside them, on all pictures of a machine."""
    machine = named("excavator_20t")
    text = machine.text.replace("20 t crawler excavator", LONG[script].strip())
    machine = type(machine).from_text(text, machine.urdf_text, machine.source)
    frequencies = ad.frequency_map(machine, ad.Workspace.grid(machine, points=2))
    chart = ad.lift_chart(machine)
    title = plots.title_of(machine)
    figures = [
        plots.machine_drawing(machine).figure,
        plots.machine_overlay(machine, machine).figure,
        plots.mode_shapes(machine),
        plots.lift_charts({title: chart}),
        plots.lift_charts({title: chart, "new": chart}),
        plots.map_figure(frequencies, "joints"),
        plots.side_by_side({title: frequencies, "new": frequencies}),
    ]
    for fig in figures:
        fig.canvas.draw()
        heads = [] if fig._suptitle is None else [fig._suptitle]
        heads += [head for ax in fig.axes for head in (ax.title, ax._left_title)]
        boxes = [head.get_window_extent() for head in heads if head.get_text()]
        assert any(title.replace(" ", "") in _joined(head) for head in heads)
        assert all(box.x0 >= 0 and box.x1 <= fig.bbox.width for box in boxes)
        assert all(box.y1 <= fig.bbox.height for box in boxes)
        assert not any(one.overlaps(other) for one, other in itertools.combinations(boxes, 2))
        for ax in fig.axes:
            assert ax.get_window_extent().height > 0.3 * fig.bbox.height


def _joined(text: Any) -> str:
    return "".join(text.get_text().split())


def test_titles_that_fit_stay_as_they_are() -> None:
    assert canvas.wrapped("two  words\n and a line", 3.0, 9.0) == ["two  words", " and a line"]
    assert canvas.wrapped("", 3.0, 9.0) == [""]
    assert canvas.wrapped("one two", 0.5, 9.0) == ["one", "two"]
    assert canvas.wrapped("delay 1.47 s", 0.6, 9.0) == ["delay", "1.47 s"]


@pytest.mark.parametrize("setting", ["text.usetex: True", "axes.facecolor: red", "hatch.color: r"])
def test_pictures_are_the_same_whatever_a_user_sets(setting: str, tmp_path: Path) -> None:
    """In a ``matplotlibrc``, also of the current folder; without LaTeX the first was an error."""
    import matplotlib

    (tmp_path / "matplotlibrc").write_text(setting)
    usual = _picture()
    with matplotlib.rc_context(fname=tmp_path / "matplotlibrc"):
        assert _picture() == usual


def _picture() -> bytes:
    shown: Any = named("paper_1dof").plot()
    return bytes(shown._repr_png_())
