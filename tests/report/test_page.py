"""Reports as data and as pages: nothing is lost on the way, nothing from a file becomes markup."""

from __future__ import annotations

import base64
import dataclasses
import functools
import hashlib
import json
import re
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import armdesign as ad
from armdesign.arrays import Array
from armdesign.drawing.colours import actuator_colours
from armdesign.drawing.side_view import side_view
from armdesign.drawing.swing import Swings, picture_joints
from armdesign.errors import ArmDesignError
from armdesign.machine.poses import pose_text
from armdesign.plots.charts import Chart, Curve
from armdesign.report.contents import FORMAT, HeadlineNumber, Picture, Report, ReportSection
from armdesign.report.map_reports import map_report
from armdesign.report.maps import map_sheets
from armdesign.report.packed import Packed
from armdesign.report.page import page, sortable
from armdesign.report.provenance import Origin
from armdesign.report.scene import (
    CellAxis,
    CellPlane,
    DrawnMachine,
    MapScene,
    bandwidth_scene,
    scene_of,
)
from armdesign.report.sheet import Sheet
from armdesign.units import SI, WORKSHOP, Units
from tests.commands import main


@cache
def two_joints() -> ad.FrequencyMap:
    machine = ad.load("excavator_20t")
    return ad.frequency_map(machine, ad.Workspace.grid(machine, [5, 4, 6]))


def unpacked(table: Packed) -> Array:
    """As the page's script reads it."""
    whole = np.frombuffer(base64.b64decode(table.base64), f"<i{table.bits // 8}")
    numbers: Array = whole.reshape(-1, len(table.scale)) * np.array(table.scale)
    return numbers


def exact(frequencies: ad.FrequencyMap, drawn: DrawnMachine) -> Array:
    """Poses (n, nq) [rad] whose positions are packed as printed [deg]."""
    printed = np.radians(unpacked(drawn.positions)[:, : len(frequencies.machine.joints)])
    known = frequencies.frame[list(frequencies.machine.joints)].to_numpy(float)
    away = np.abs(printed[:, None] - known).max(axis=2)
    q = known[away.argmin(axis=1)]
    q[0] = frequencies.worst.q
    assert np.degrees(np.abs(printed - q).max()) <= 0.05 + 1e-9
    return q


@pytest.mark.parametrize("units", [WORKSHOP, SI])
def test_cells_hold_the_lowest_frequency_and_its_pose(units: Units) -> None:
    """By brute force over the rows of the map, for every plane, load case and cell."""
    frequencies = two_joints()
    scene, factor = scene_of({"today": frequencies}, units), units.table["rad"][0]
    (drawn,), frame = scene.machines, frequencies.frame
    cells, values, positions = (
        unpacked(table) for table in (drawn.cells, drawn.frequencies, drawn.positions)
    )
    joints = [name for name, *_ in scene.joints]
    checked = 0
    for k, (x, y) in enumerate((plane.x, plane.y) for plane in scene.planes):
        assert y is not None
        near = {}
        for axis in (x, y):
            shown = frame[axis.name].to_numpy() / factor
            near[axis.name] = np.abs(shown[:, None] - np.array(axis.middles)).argmin(axis=1)
        place = near[x.name] * len(y.middles) + near[y.name]
        for case, name in enumerate(["", *scene.cases]):
            of_case = (frame["payload"] == name) if name else np.ones(len(frame), bool)
            rows = (cells[:, 0] == k) & (cells[:, 1] == case)
            assert set(cells[rows, 2]) == set(place[of_case])
            for row in np.flatnonzero(rows):
                least = frame["f1_hz"][of_case & (place == cells[row, 2])]
                printed = f"{least.min():.3f}"  # the same digits as in the tables
                assert f"{values[row, 0]:.3f}" == printed
                assert values[row, 0] <= values[row, 1] <= values[row, 2]
                pose = positions[int(cells[row, 3])]
                assert f"{pose[len(joints)]:.3f}" == printed
                words = (
                    f"{name} {value:.{digits}f}{unit if unit == '°' else ' ' + unit}"
                    for (name, unit, digits), value in zip(scene.joints, pose, strict=False)
                )
                q = frame.loc[least.idxmin(), joints].to_numpy(float)
                assert ", ".join(words) == pose_text(frequencies.machine, q, units)
                checked += 1
    assert checked > 100


def test_drawn_cylinders_have_the_colours_of_the_pictures() -> None:
    frequencies = two_joints()
    (drawn,) = scene_of({"today": frequencies}).machines
    known = actuator_colours(frequencies.machine)
    assert {one["name"]: one["colour"] for one in drawn.cylinders} == {
        name: known[name] for name in ("boom", "stick", "bucket")
    }


def test_drawings_place_every_pin_within_2_mm() -> None:
    """From the packed numbers as the page's script reads them, against the side view."""
    frequencies = two_joints()
    (drawn,) = scene_of({"today": frequencies}).machines
    q = exact(frequencies, drawn)
    view, numbers = side_view(frequencies.machine, q), unpacked(drawn.placements)
    standing = np.broadcast_to(np.array(drawn.standing), (len(q), 6))
    bodies = len(drawn.bodies)
    matrices = np.concatenate([standing, numbers[:, : 6 * bodies - 6]], axis=1)
    placed, loose = matrices.reshape(-1, bodies, 2, 3), 6 * bodies - 6
    for k, point in enumerate(drawn.points):
        if point["at"] is None:
            at, loose = numbers[:, loose : loose + 2], loose + 2
        else:
            body = placed[:, point["body"]]
            at = body[:, :, :2] @ np.array(point["at"]) + body[:, :, 2]
        expected = view.tool if point["name"] == "tool" else view.points[:, k]
        assert np.abs(at - expected).max() < 2e-3, point["name"]
    assert loose == numbers.shape[1]


def test_cells_of_bandwidth_hold_the_least_of_their_poses() -> None:
    """By brute force over the rows of the map; no cell has a pose at which no loop works."""
    machine = ad.load("paper_1dof")
    bandwidths = ad.bandwidth_map(machine, ad.Workspace.grid(machine, 6), damping=0.02)
    frame = bandwidths.frame[bandwidths.frame["works"]]
    scene = bandwidth_scene({"today": bandwidths})
    assert scene is not None
    assert scene.quantity.startswith("bandwidth")
    ((drawn,), (plane,)) = scene.machines, scene.planes
    assert drawn.loops is not None
    cells, values, loops = map(unpacked, (drawn.cells, drawn.frequencies, drawn.loops))
    everywhere = cells[:, 1] == 0
    at = np.degrees(frame["boom"].to_numpy())
    nearest = np.abs(at[:, None] - np.array(plane.x.middles)).argmin(axis=1)
    assert set(cells[everywhere, 2]) == set(nearest)
    for cell, pose, value in zip(
        cells[everywhere, 2], cells[everywhere, 3], values[everywhere, 0], strict=True
    ):
        own = frame[nearest == cell].sort_values("own_hz").iloc[0]
        assert f"{value:.3f}" == f"{own['own_hz']:.3f}"
        reached = own[["own_hz", "damped_hz", "proportional_hz"]]
        assert [f"{one:.3f}" for one in loops[int(pose), :3]] == [f"{one:.3f}" for one in reached]
    assert f"{loops[0, 0]:.3f}" == f"{frame['own_hz'].min():.3f}"


@pytest.mark.slow
def test_machines_of_other_joints_have_no_common_scene() -> None:
    one, other = (
        ad.bandwidth_map(machine, ad.Workspace.grid(machine, 2), damping=0.02)
        for machine in map(ad.load, ("paper_1dof", "excavator_20t"))
    )
    assert bandwidth_scene({"today": one, "new": other}) is None


@pytest.mark.slow
def test_the_first_pose_is_the_worst_of_all() -> None:
    frequencies = two_joints()
    (drawn,) = scene_of({"today": frequencies}).machines
    assert f"{unpacked(drawn.positions)[0, 3]:.3f}" == f"{frequencies.worst.frequency:.3f}"
    limiting = drawn.parts[int(unpacked(drawn.poses)[0, 1])]
    assert limiting == frequencies.worst.cylinder


@pytest.mark.slow
def test_three_modes_have_their_frequencies_and_motions() -> None:
    """By the modes of every pose, under each load case: what joints and the tool do in them."""
    frequencies = two_joints()
    (drawn,) = scene_of({"today": frequencies}).machines
    positions, cases = unpacked(drawn.positions), unpacked(drawn.poses)[:, 0]
    count = len(drawn.joints) + 1
    swings = unpacked(drawn.swings).reshape(len(positions), -1, count)
    poses = exact(frequencies, drawn)
    view = side_view(frequencies.machine, poses[:1])
    for case, payload in enumerate(frequencies.machine.payloads, 1):
        machine, rows = frequencies.machine.with_payload(payload.name), cases == case
        q = poses[rows]
        modes = ad.natural_modes(machine.at(q))
        assert positions[rows, 3:] == pytest.approx(modes.frequencies[:, :3], abs=5.1e-4)
        turns = picture_joints(machine, q).turns
        scale = Swings(machine=machine, bodies=view.bodies, size=view.size)
        for mode in range(3):
            expected = scale.of(q, modes.shapes[:, :, mode])
            steps, tool = swings[rows, mode, :-1] / turns, swings[rows, mode, -1]
            same = np.minimum(
                *(np.abs(steps - sign * expected.steps).max(axis=1) for sign in (1, -1))
            )
            assert same.max() < 0.005 * np.abs(expected.steps).max()
            assert tool == pytest.approx(expected.tool, abs=1e-4)


# ------------------------------------------------------------------------------------- the page


@pytest.mark.slow
def test_nothing_of_a_report_becomes_markup(tmp_path: Path) -> None:
    evil = '</script><img src=x onerror="alert(1)">&{{ 7 * 7 }}'
    sheet = Sheet(title=evil, columns=(evil,), rows=((evil,),), note=evil)
    picture = Picture(caption=evil, file=evil)
    section = ReportSection(title=evil, words=(evil,), sheets=(sheet,), pictures=(picture,))
    report = Report(
        title=evil,
        lead=evil,
        headline=(HeadlineNumber(name=evil, value=evil, words=evil),),
        sections=(section,),
    )
    text = page(Report.of_text(report.text()), tmp_path)
    assert "<img" not in text
    assert "49" not in text.partition("<body>")[2].partition("<script>")[0]
    machine = two_joints().machine.replace({"title": evil})
    scene = scene_of({evil: ad.frequency_map(machine, ad.Workspace.grid(machine, 2))})
    drawing = ReportSection(title="", shows="drawing")
    maps = ReportSection(title="", shows="maps")
    text = page(Report(title="", lead="", sections=(drawing, maps), scene=scene), tmp_path)
    assert "</script><img" not in text
    assert "<img src=x" not in text


@pytest.mark.parametrize(
    ("sheet", "expected"),
    [
        (Sheet(title="", columns=("a",), rows=(("1",), ("2",), ("3",))), True),
        (Sheet(title="", columns=("a",), rows=(("boom",), ("→ new",), ("stick",))), False),
        (Sheet(title="", columns=("a",), rows=(("boom",), ("",), ("stick",))), False),
        (Sheet(title="", rows=(("a", "1"), ("b", "2"), ("c", "3"))), False),
        (Sheet(title="", columns=("a",), rows=(("1",), ("2",), ("gain",)), bold=(2,)), False),
    ],
)
def test_rows_that_belong_together_are_not_sorted(sheet: Sheet, expected: bool) -> None:
    assert sortable(sheet) is expected


# ---------------------------------------------------------------------------------- report.json


@pytest.mark.slow
def test_report_writes_the_same_page_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    assert main(["map", "paper_1dof", "--out", str(out), "--points", "5"], monkeypatch) == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    body = before["report.html"].decode().partition("<body>")[2].partition("<script>")[0]
    (out / "report.html").unlink()
    assert main(["report", str(out)], monkeypatch) == 0
    after = {path.name: path.read_bytes() for path in out.iterdir()}
    again = after["report.html"].decode().partition("<body>")[2].partition("<script>")[0]
    ids = r'data-root-id="[^"]*"|id="[^"]*"'
    assert re.sub(ids, "", again) == re.sub(ids, "", body)
    assert {name: after[name] for name in before if name != "report.html"} == {
        name: data for name, data in before.items() if name != "report.html"
    }


def written(**changes: object) -> str:
    """A report.json of another version, or of this one where the title is wrong."""
    writer = version("armdesign") if "title" in changes else "0.0.0"
    provenance = {"title": "", "rows": [["armdesign", writer], ["command", "x"], ["y"]]}
    plain = {"title": "", "lead": "", "sections": [{"title": "", "sheets": [provenance]}]}
    return json.dumps({**plain, "format": FORMAT, **changes})


def test_the_format_has_a_new_number_where_what_is_kept_changes() -> None:
    """Pinned: a field more or less, or of another type, is another format."""
    kinds = Report, HeadlineNumber, Picture, ReportSection, Sheet, Chart, Curve, MapScene
    fields = [
        f"{kind.__name__}.{field.name}: {field.type}"
        for kind in (*kinds, DrawnMachine, Packed, CellPlane, CellAxis)
        for field in dataclasses.fields(kind)
    ]
    digest = hashlib.sha256("\n".join(fields).encode()).hexdigest()[:16]
    assert {FORMAT: digest} == {3: "11d8ebf06dcd7f8e"}


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (None, "no report.json is there; write one by armdesign design"),
        ("{", "is damaged: it ends or breaks off at line 1, column 2; run the command"),
        ("[1]", "is damaged: it is no report; run the command that wrote the folder again"),
        (f"{200_000 * '['}", "is damaged: "),
        (written(title=3), "is damaged: title is not what armdesign writes there; make it anew"),
        (written(format=1), "(0.0.0, format 1); this one, {ours}, reads format 3; make it anew"),
        (written(format=1, sections=[{"sheets": {"rows": 1.5}}]), "wrote it (format 1); this"),
        (written(scene=0), "another version of armdesign wrote it (0.0.0); this one, {ours}, "),
        ('{"title": "", "lead": "", "sections": [], "format": 9}', "wrote it (format 9); this"),
    ],
)
def test_report_refuses_in_one_line(
    text: str | None,
    fault: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if text is not None:
        (tmp_path / "report.json").write_text(text, encoding="utf-8")
    assert main(["report", str(tmp_path)], monkeypatch) == 2
    said = capsys.readouterr().err
    assert fault.format(ours=version("armdesign")) in said
    assert said.count("\n") == 1
    assert not (tmp_path / "report.html").exists()


def test_provenance_hashes_the_files_as_they_are_on_disk() -> None:
    """As sha256sum would."""
    machine = ad.load("excavator_20t")
    rows = dict(Origin.begin("armdesign map x", {"points": ""}).sheet({"": machine}).rows)
    for row, file in (
        ("machine file", machine.source),
        ("URDF", machine.source.with_suffix(".urdf")),
    ):
        assert hashlib.sha256(file.read_bytes()).hexdigest() in rows[row]
    assert rows["options"] == "points = not given"


@pytest.mark.slow
def test_the_report_of_a_design_hashes_the_files_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ["design", "paper_1dof", "--points", "5", "--out", str(tmp_path)]
    assert main(words, monkeypatch) == 0
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    for name in ("paper_1dof_optimized.toml", "paper_1dof.urdf"):
        digest = hashlib.sha256((tmp_path / name).read_bytes()).hexdigest()
        assert f"{name}, SHA-256 {digest}" in text


def test_a_report_survives_its_file() -> None:
    origin = Origin.begin("armdesign map x", {})
    frequencies = two_joints()
    provenance = origin.sheet({"": frequencies.machine})
    report = map_report(frequencies, map_sheets(frequencies), (), provenance)
    again = Report.of_text(report.text())
    assert again.text() == report.text()
    titles = [section.title for section in report.sections]
    assert titles[:2] == ["The machine in its worst pose", "Map of frequencies"]
    assert titles[-1] == "Provenance"
    assert [number.name for number in report.headline] == ["rigid", "nominal", "softest"]
    data: dict[str, Any] = json.loads(report.text())
    assert data["format"] == FORMAT


def test_no_key_of_a_report_may_be_lost() -> None:
    """Those that have a default too: a map without its drawing, a headline without numbers."""
    frequencies = two_joints()
    provenance = Origin.begin("armdesign map x", {}).sheet({"": frequencies.machine})
    report = map_report(frequencies, map_sheets(frequencies), (), provenance)
    for path in ("scene", "headline", "sections.0.shows", "sections.1.sheets.0.note"):
        data: Any = json.loads(report.text())
        *above, key = path.split(".")
        part = functools.reduce(lambda one, k: one[int(k) if k.isdigit() else k], above, data)
        del part[key]
        with pytest.raises(ArmDesignError, match=f"is damaged: {path} is not what armdesign"):
            Report.of_text(json.dumps(data))


def test_a_row_has_a_cell_below_each_head() -> None:
    sheet = {"title": "", "columns": ["a"], "rows": [["1"], ["2", "3"]], "note": "", "bold": []}
    section = {"title": "", "words": [], "sheets": [{**sheet, "words": []}]}
    text = json.dumps({"title": "", "lead": "", "sections": [section], "format": FORMAT})
    with pytest.raises(ArmDesignError, match=r"is damaged: sections\.0\.sheets\.0 is not what"):
        Report.of_text(text)


@pytest.mark.parametrize(
    ("place", "value"),
    [
        ("sections.0.charts.0.curves.0.words", [["a"]]),
        ("sections.0.charts.0.curves.0.words", [["a"], ["b", "c"]]),
        ("sections.0.charts.0.curves.0.y", [1.0]),
        ("scene.planes", []),
        ("scene.planes.0.x.middles", []),
        ("scene.quantity", "none"),
    ],
)
def test_what_cannot_be_drawn_is_damaged(place: str, value: object) -> None:
    curve = Curve(name="", colour="#000000", x=(1.0, 2.0), y=(3.0, 4.0), words=(("a",), ("b",)))
    chart = Chart(title="", x="", y="", heads=("",), curves=(curve,))
    sections, scene = (ReportSection(title="", charts=(chart,)),), scene_of({"": two_joints()})
    report = Report(title="", lead="", sections=sections, scene=scene)
    *above, key = (int(word) if word.isdigit() else word for word in place.split("."))
    data: Any = json.loads(report.text())
    functools.reduce(lambda one, k: one[k], above, data)[key] = value
    part = re.escape(".".join(map(str, above)))
    with pytest.raises(ArmDesignError, match=rf"is damaged: {part} is not what armdesign"):
        Report.of_text(json.dumps(data))


def test_a_report_is_named_by_its_folder(tmp_path: Path) -> None:
    (tmp_path / "report.json").touch()
    with pytest.raises(ArmDesignError, match="is a file; give its folder: "):
        Report.read(tmp_path / "report.json")
