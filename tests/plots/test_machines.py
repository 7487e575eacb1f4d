"""Drawings of machines: what is in them, of which names and where."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest
from matplotlib.colors import to_hex

from armdesign import load, plots
from armdesign.drawing.colours import ACTUATORS, actuator_colours
from armdesign.drawing.moved_pins import changed_bars, moved_pins
from armdesign.drawing.side_view import side_view
from armdesign.errors import ArmDesignError
from armdesign.plots import canvas
from armdesign.plots.machine_words import IDLE, ends
from tests.commands import main
from tests.machines import BOOM, LIFT, Joint, build, named
from tests.slewing_tables import MOTOR

MOVED = {
    "cylinder.boom.base.at_mm": [520.0, 0.0, -650.0],
    "cylinder.bucket.four_bar.rocker_mm": 570.0,
}


def words(ax) -> str:
    texts = [*(text.get_text() for text in ax.texts), ax.get_title(loc="left")]
    legend = ax.get_legend()
    return "\n".join([*texts, *(text.get_text() for text in legend.get_texts())])


def test_a_drawing_names_every_pin_with_its_coordinates() -> None:
    """Names and numbers as in the machine file."""
    drawn = words(named("excavator_20t").plot())
    for name, at in (
        ("boom.base", "chassis: 461.5, −602.5 mm"),
        ("boom.rod_end", "boom: 2233.7, 950.5 mm"),
        ("bucket.lug", "bucket: −80.7, 461.6 mm"),
        ("bucket.knee", "rocker meets coupler"),
        ("joint stick", "range −155.5 to −33.2°"),
    ):
        assert name in drawn
        assert at in drawn
    assert "boom: 2 × Ø120/85 × 1260 mm" in drawn


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "suffix"),
    [("spatial", "svg"), ("slewing", "pdf"), ("rocking", "svg"), ("rotator", "png")],
)
def test_any_machine_is_drawn_in_any_format(name: str, suffix: str, tmp_path: Path) -> None:
    machine = named(name)
    fig = machine.plot().figure
    path = plots.save(fig, tmp_path / f"a.{suffix}")
    assert path.stat().st_size > 5_000
    if suffix == "svg":
        text = path.read_text()
        assert all(f"{cylinder.name}.base" in text for cylinder in machine.cylinders)


def test_no_line_of_a_label_is_covered_by_the_other() -> None:
    ax = plots.machine_drawing(named("excavator_20t"))
    ax.figure.canvas.draw()
    pairs: dict[tuple[float, float], list[Any]] = {}
    for text in ax.texts:
        if text.get_bbox_patch():
            pairs.setdefault(text.xy, []).append(text)
    for head, below in pairs.values():
        white = head.get_bbox_patch().get_window_extent()
        assert white.y0 >= below.get_window_extent().y1


def test_the_same_figure_is_the_same_file(tmp_path: Path) -> None:
    one, other = (
        plots.save(named("paper_1dof").plot().figure, tmp_path / f"{name}.svg") for name in "ab"
    )
    assert one.read_bytes() == other.read_bytes()


def test_an_unknown_format_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ArmDesignError, match=r"is no format of pictures"):
        plots.save(plots.figure()[0], tmp_path / "a.jpg")


def test_a_misplaced_pin_is_said_in_words() -> None:
    machine = load("excavator_20t")
    text = machine.text.replace("[2233.7, 0, 950.5]", "[2233.7, 0, -950.5]")
    drawn = words(type(machine).unchecked(text, machine.urdf_text, machine.source).plot())
    assert "boom.rod_end lies outside the outline of its link" in drawn
    low = side_view(machine, machine.ranges[:, 0] - 0.05)
    assert low.out_of_stroke.any()
    assert "beyond its open length" in words(machine.plot(machine.ranges[:, 0] - 0.05))


def test_moved_pins_have_arrows_in_mm() -> None:
    """The boom's base moves by (58.5, −47.5) mm, 75.4 mm; a rocker gets shorter."""
    old = named("excavator_20t")
    new = old.replace(MOVED)
    q = old.ranges.mean(axis=1)
    views = side_view(old, q), side_view(new, q)
    (move,) = moved_pins(*views)
    assert (move.name, move.link) == ("boom.base", "chassis")
    assert move.by == pytest.approx([0.0585, 0, -0.0475])
    assert move.distance == pytest.approx(0.075358, abs=1e-5)
    assert move.after[0] - move.before[0] == pytest.approx([0.0585, -0.0475])
    ((before, after),) = changed_bars(*views)
    assert (before.length, after.length) == pytest.approx((0.5787, 0.570))
    ax = plots.machine_overlay(old, new, q)
    drawn = words(ax)
    assert "boom.base: 75 mm" in drawn
    assert "x +58.5, z −47.5 mm in chassis" in drawn
    assert "bucket.rocker 578.7 → 570.0 mm" in drawn
    arrows = [text.arrow_patch for text in ax.texts if text.arrow_patch is not None]
    assert any(arrow.get_edgecolor() == (*_rgb(canvas.MARK), 1.0) for arrow in arrows)


def _rgb(colour: str) -> tuple[float, ...]:
    return tuple(int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))


def test_an_actuator_keeps_its_colour() -> None:
    """Whatever is frozen: its place in the file decides."""
    machine = named("excavator_20t")
    colours = actuator_colours(machine)
    assert list(colours) == ["boom", "stick", "bucket", "swing"]
    assert list(colours.values()) == list(ACTUATORS[:4])
    fewer = machine.text.replace('["boom", "stick", "bucket"]', '["boom", "bucket"]')
    fewer = fewer.replace("frozen = { swing = 0.0 }", "frozen = { swing = 0.0, stick = -1.5 }")
    frozen = type(machine).from_text(fewer, machine.urdf_text, machine.source)
    assert actuator_colours(frozen) == colours
    idle = [shape.name for shape in side_view(frozen, [0.0, -0.5]).cylinders if shape.idle]
    assert idle == ["stick"]


def test_modes_are_drawn_with_frequency_and_amplitude() -> None:
    fig = plots.mode_shapes(named("excavator_20t"))
    titles = [ax.get_title(loc="left") for ax in fig.axes]
    assert len(titles) == 3
    for ax, title in zip(fig.axes, titles, strict=True):
        tips = [np.ravel(line.get_xydata()) for line in ax.lines if line.get_marker() == "*"][-2:]
        tool = float(title.partition("± ")[2].partition(" mm at the tool")[0])
        assert tool == pytest.approx(500 * math.dist(*tips), abs=0.51)  # half the way
    assert titles[0].startswith("mode 1: ")
    assert "% in boom" in titles[0]


def test_what_is_frozen_and_what_falls_are_said() -> None:
    """The colour of a frozen actuator is in no picture; a pose that falls has no frequency."""
    machine = named("excavator_20t")
    legend = plots.machine_drawing(machine).get_legend()
    assert legend is not None
    words = [text.get_text() for text in legend.get_texts()]
    assert words[-1] == "swing: motor, frozen"
    assert not any("frozen" in word for word in words[:-1])
    paints = [to_hex(patch.get_facecolor()) for patch in legend.get_patches()]
    assert paints[-1] == IDLE not in paints[:-1]
    fallen = plots.mode_shapes(named("paper_1dof").with_payload(1e9))
    assert "mode 1: unstable on trapped oil\n" in fallen.axes[0].get_title(loc="left")


@pytest.mark.parametrize("name", ["excavator_20t", "loader_crane", "paper_1dof", "patu_boom"])
def test_the_range_of_the_tool_reaches_as_far_as_the_figures(name: str) -> None:
    """Against reach, depth and height by optimisation (inspection), to 5 mm of chords."""
    from armdesign.drawing.tool_range import tool_range
    from armdesign.inspection.reach_figures import reach_figures

    lines = np.concatenate(tool_range(named(name)))
    figures = reach_figures(named(name))
    drawn = lines[:, 0].max(), lines[:, 1].max(), -lines[:, 1].min()
    assert drawn == pytest.approx((figures.reach, figures.height, figures.depth), abs=5e-3)


def test_draw_writes_its_pictures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["draw", "paper_1dof", "--pose", "boom=10", "--pictures", "svg"], monkeypatch) == 0
    assert {path.name for path in (tmp_path / "out/draw_paper_1dof").iterdir()} == {
        *("machine.png", "machine.svg"),
        *("modes.png", "modes.svg"),
    }
    assert "boom 10.0°" in (tmp_path / "out/draw_paper_1dof/machine.svg").read_text()
    assert main(["draw", "paper_1dof", "paper_1dof"], monkeypatch) == 0
    assert (tmp_path / "out/draw_paper_1dof_paper_1dof/overlay.png").exists()
    assert main(["draw", "paper_1dof", "--pose", "boom=80"], monkeypatch) == 2
    assert "outside its range" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("option", "marked"),
    [([], ["full"]), (["--payload", "full"], ["full"]), (["--payload", "empty"], [])],
)
def test_draw_shows_the_chosen_load_alone(
    option: list[str], marked: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["draw", "loader_crane", "loader_crane", *option, "--out", "a", "--pictures", "svg"]
    assert main(words, monkeypatch) == 0
    drawn = (tmp_path / "a/machine.svg").read_text()
    assert [name for name in ("empty", "full") if f"payload {name}" in drawn] == marked
    chosen = option[1] if option else "empty"
    assert f"load case {chosen}" in (tmp_path / "a/modes.svg").read_text()


def test_an_unusable_machine_is_drawn_and_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A base pin on the wrong side of the joint: no pose fits, and the picture shows why."""
    machine = named("paper_1dof")
    (tmp_path / "paper_1dof.urdf").write_text(machine.urdf_text)
    text = machine.text.replace("at_mm = [-500, 0, 0]", "at_mm = [-500, 0, 900]")
    assert text != machine.text
    (tmp_path / "wrong.toml").write_text(text)
    monkeypatch.chdir(tmp_path)
    assert main(["draw", "wrong.toml"], monkeypatch) == 2
    assert {path.name for path in (tmp_path / "out/draw_wrong").iterdir()} == {"machine.png"}
    assert "armdesign: wrong.toml" in capsys.readouterr().err


def test_a_pin_that_set_mirrors_is_drawn_and_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    mirrored = ["draw", "excavator_20t", "--set", "cylinder.stick.base.at_mm.0=-3416.5"]
    assert main([*mirrored, "--pictures", "svg"], monkeypatch) == 2
    drawn = (tmp_path / "out/draw_excavator_20t/machine.svg").read_text()
    assert "stick.base lies outside the outline of its link" in drawn
    assert "cylinder.stick.stroke_mm" in capsys.readouterr().err
    unknown = ["draw", "excavator_20t", "--set", "cylinder.boom.bor=1", "--out", "none"]
    assert main(unknown, monkeypatch) == 2
    assert 'did you mean "cylinder.boom.bore_mm"?' in capsys.readouterr().err
    assert not (tmp_path / "none").exists()


def test_check_ends_with_a_drawing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["check", "paper_1dof", "--out", "drawn"], monkeypatch) == 0
    assert (tmp_path / "drawn" / "machine.png").stat().st_size > 5_000


def test_titles_and_legends_are_on_the_paper() -> None:
    """Also with many faults to tell, and with bars that changed."""
    today = load("excavator_20t")
    mirrored = today.replace(
        {
            "cylinder.boom.rod_end.at_mm": [2233.7, 0, -950.5],
            "cylinder.stick.base.at_mm": [3416.5, 0, -1147.5],
            "cylinder.bucket.base.at_mm": [393.5, 0, -669.1],
        }
    )
    pictures = [
        plots.machine_drawing(mirrored),
        plots.machine_drawing(load("paper_1dof")),
        plots.machine_overlay(today, load("excavator_12t")),
    ]
    for ax in pictures:
        ax.figure.canvas.draw()
        legend = ax.get_legend().get_window_extent()
        high, inch = ax.figure.bbox.height, ax.figure.dpi
        assert 0 <= legend.y0 <= 0.6 * inch, "nor is there much white below"
        assert ax._left_title.get_window_extent().y1 <= high


def test_machines_of_other_joints_are_not_drawn_over_each_other() -> None:
    with pytest.raises(ArmDesignError, match=r"has other joints \(.*\); give one with boom"):
        plots.machine_overlay(load("patu_boom"), load("loader_crane"))


@pytest.mark.parametrize("name", ["slewing", "spatial", "rotator", "branched", "loader_crane"])
def test_every_joint_is_labelled_and_no_label_covers_another(name: str) -> None:
    """Also joints that slew or move out of the plane, in the middle pose and at an end."""
    machine = named(name)
    for q in (None, machine.ranges[:, 1]):
        ax = plots.machine_drawing(machine, q)
        ax.figure.canvas.draw()
        texts = [text for text in ax.texts if text.get_text()]
        heads = {text.get_text() for text in texts}
        assert {f"joint {joint}" for joint in machine.joints} <= heads
        boxes, frame = [text.get_window_extent() for text in texts], ax.get_window_extent()
        dot = ax.figure.dpi / 72  # [px] a point: descenders of one line may touch the next one
        for k, one in enumerate(boxes):
            assert one.y0 > frame.y0 - dot
            assert one.y1 < frame.y1 + dot
            for other in boxes[:k]:
                beside = one.x0 > other.x1 or other.x0 > one.x1
                assert beside or min(one.y1, other.y1) - max(one.y0, other.y0) < 2 * dot


@pytest.mark.parametrize(
    "name", ["mini_excavator_2t", "excavator_12t", "excavator_20t", "loader_crane", "rotator"]
)
def test_lines_from_labels_to_their_points_do_not_cross(name: str) -> None:
    """As they are drawn, on the screen, by the determinants of a segment's ends about another."""
    ax = plots.machine_drawing(named(name))
    ax.figure.canvas.draw()
    lines = []
    for text in ax.texts:
        if text.arrow_patch is not None:
            path = text.arrow_patch.get_path()
            lines.append(text.arrow_patch.get_transform().transform(path.vertices)[[0, -1]])
    assert len(lines) == len([text for text in ax.texts if text.get_weight() == "bold"])

    def sides(line: Any, other: Any) -> float:
        along = line[1] - line[0]
        return float(np.prod([along[0] * w[1] - along[1] * w[0] for w in other - line[0]]))

    for one, other in itertools.combinations(lines, 2):
        assert not (sides(one, other) < 0 and sides(other, one) < 0)


def test_modes_show_the_load_at_work_and_the_tool_at_rest_apart_from_the_ends() -> None:
    """The empty bucket has no load; the tool is at rest once, and red and blue at the ends."""
    machine = named("excavator_20t")
    for case, loads in (("empty", 0), ("full", 1)):
        fig = plots.mode_shapes(machine.with_payload(case))
        for ax in fig.axes:
            marks = [line for line in ax.lines if np.size(line.get_xdata())]
            assert sum(line.get_marker() == "s" for line in marks) == loads
            stars = [line for line in marks if line.get_marker() == "*"]
            colours = [line.get_markerfacecolor() for line in stars]
            assert colours == ["white", canvas.MARK, canvas.COMPUTED]
    slewing = [ax.get_title(loc="left") for ax in plots.mode_shapes(named("slewing")).axes]
    assert ["across the picture" in title for title in slewing] == [True, False, False]
    assert "100 % in swing" in slewing[0]
    words = [text.get_text() for text in fig.legends[0].get_texts()]
    assert words[0] == "at rest"
    assert len(words) == 3


@pytest.mark.parametrize("turn", [0.0, 50.0, -120.0])
def test_the_tool_is_named_at_its_reach(turn: float) -> None:
    """Of a slew 0.6 m ahead of the root's axis and 0.2 m aside: the tool's distance in space."""
    column = Joint("column", "root", (0.6, 0.2, 0.8), axis=(0, 0, 1), limits=(-3, 3))
    lift = replace(LIFT, base=("column", (0.7, 0, 0.1)))
    machine = build([column, replace(BOOM, parent="column")], [lift], more=MOTOR)
    q = np.array([math.radians(turn), 0.1])
    x, y, z = machine.at([q]).tool[0]
    said = {label.head: label.below for label in ends(machine, side_view(machine, q))}
    (words,) = (below for head, below in said.items() if head.startswith("tool"))
    assert words == f"{math.hypot(x, y):.3f}, {z:.3f} m"


@pytest.mark.parametrize("name", ["excavator_20t", "paper_1dof", "loader_crane"])
def test_drawings_end_below_what_they_show(name: str, tmp_path: Path) -> None:
    """Less than 0.16 inches of white below; drawings of one machine had 0.38 and more."""
    machine = named(name)
    for ax in (plots.machine_drawing(machine), plots.machine_overlay(machine, machine)):
        pixels = matplotlib.image.imread(plots.save(ax.figure, tmp_path / "drawn.png"))
        inked = np.flatnonzero((pixels[..., :3] < 0.99).any(axis=(1, 2)))
        white = 1 - (inked[-1] + 1) / len(pixels)
        assert white * ax.figure.get_size_inches()[1] < 0.16
