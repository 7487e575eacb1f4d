"""`armdesign check`: what a file amounts to, what looks odd, and everything that is wrong at
once.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import armdesign as ad
from armdesign.inspection.inspection import inspect
from armdesign.inspection.oddities import DEAD_LENGTH_PER_BORE
from armdesign.machine.machine import Machine
from armdesign.report.inspections import check_sheets
from armdesign.report.performance import figures
from armdesign.units import SI, WORKSHOP, share_text
from tests import machines
from tests.commands import main
from tests.inspection.inspected import EXCAVATOR, inspected, odd, written
from tests.sprung import two_masses

# ---------------------------------------------------------------------------------------- oddities


def test_the_stick_cylinder_of_the_20_t_machine_is_too_short_for_its_parts() -> None:
    """1800 − 1504 = 296 mm between the pins must hold what takes 2.2 × 140 = 308 mm: the only
    oddity of the file.
    """
    assert DEAD_LENGTH_PER_BORE * 140 > 1800 - 1504
    oddities = odd({})
    assert set(oddities) == {"cylinder.stick.closed_length_mm"}
    assert "296.0 mm" in oddities["cylinder.stick.closed_length_mm"]


@pytest.mark.parametrize("name", ["mini_excavator_2t", "excavator_12t", "patu_boom"])
def test_real_machines_are_not_odd(name: str) -> None:
    assert odd({}, name) == {}


CASES = [
    (
        {"supply.pressure_bar": 150},
        "cylinder.boom",
        r"under full its cap needs 19\d bar to stand still, more than",
    ),
    (
        {"supply.pressure_bar": 210},
        "cylinder.boom",
        r"9\d % of what supply pressure holds \(requirement: 87 %\)",
    ),
    (
        {"payload.full.link": "boom", "payload.full.pitch_deg": [100, 120]},
        "payload.full.pitch_deg",
        "at no pose of the workspace",
    ),
    (
        {"payload.full.link": "boom", "payload.full.pitch_deg": [50, 90]},
        "payload.full.pitch_deg",
        r"of \[50\.0, 90\.0\]° the poses of the workspace reach only \[5\d\.\d, 6\d\.\d\]°",
    ),
    ({"fluid.bulk_modulus_MPa": 100}, "fluid.bulk_modulus_MPa", "outside"),
    ({"payload.full.mass_kg": 0}, "payload", "every load case is empty"),
    (
        {"bands.structure": [1.5, 3.0]},
        "bands.structure",
        r"own value of bucket, 0\.4, is not within \[1\.5, 3\]: what holds",
    ),
    (
        {"bands.structures.boom": [0.0, 0.3]},
        "bands.structures.boom",
        r"own value of boom, 0\.4, is not within \[0, 0\.3\]",
    ),
    (
        {"bands.bulk_modulus_share": [0.5, 0.8]},
        "bands.bulk_modulus_share",
        r"own value, 1, is not within \[0\.5, 0\.8\]",
    ),
    (
        {"bands.entrained_air_percent": [0.5, 1.5]},
        "bands.entrained_air_percent",
        r"own value, 0, is not within \[0\.5, 1\.5\]",
    ),
    (
        {"cylinder.stick.stroke_mm": 1000},
        "joint stick",
        r"its limits allow \[-155\.5, -33\.2\]°, the strokes cover only",
    ),
    ({"cylinder.boom.rod_mm": 40}, "cylinder.boom.rod_mm", "the rod buckles at"),
    (
        {"cylinder.boom.dead_volume_l.cap": 0},
        "cylinder.boom.dead_volume_l.cap",
        "infinitely stiff",
    ),
]


@pytest.mark.parametrize(("changes", "part", "words"), CASES, ids=[part for _, part, _ in CASES])
def test_what_looks_odd(changes: dict[str, object], part: str, words: str) -> None:
    assert re.search(words, odd(changes)[part])


def test_unstable_poses() -> None:
    """Oil as soft as foam under eight tonnes: gravity wins.

    Poses added on pitch limits do not count in the share.
    """
    inspection = inspected({"fluid.bulk_modulus_MPa": 5, "payload.full.mass_kg": 8000})
    words = {finding.part: finding.words for finding in inspection.findings()}["payload.full"]
    case, q, on_grid = inspection.machine.with_payload("full"), inspection.workspace.q, []
    for axis, values in zip(inspection.workspace.axes, q.T, strict=True):
        off = np.abs(values[:, None] - axis).min(axis=1) > 1e-9
        on_grid.append(
            np.where(off, 0, np.where((values == axis[0]) | (values == axis[-1]), 0.5, 1))
        )
    boxes, held = np.prod(on_grid, axis=0), case.holds(q)
    unstable = ad.natural_modes(case.at(q[held])).frequencies[:, 0] == 0
    share = 100 * boxes[held][unstable].sum() / boxes[held].sum()
    assert abs(share - 100 * unstable.mean()) > 0.1
    assert f"{share_text(share / 100)} of the poses are unstable (0 Hz)" in words


def test_a_moment_arm_that_nearly_vanishes() -> None:
    """Base to joint 500 mm, joint to rod end 150 mm: at 350 mm all three are in line; 351 mm is
    just before that.

    By hand: r = |b × p|/ℓ at ℓ = 351 mm, cos θ = (500² + 150² − 351²)/(2·500·150), r = 500·150 sin
    θ/351 = 20.6 mm.
    """
    paper = machines.named("paper_1dof")
    urdf = re.sub(r'lower="[^"]*" upper="[^"]*"', 'lower="-1.57" upper="1.57"', paper.urdf_text)
    text = paper.text.replace("closed_length_mm = 422.015325", "closed_length_mm = 351")
    machine = Machine.from_text(text, urdf, Path("x.toml"))
    inspection = inspect(machine, ad.Workspace.grid(machine, 20))
    cosine = (500**2 + 150**2 - 351**2) / (2 * 500 * 150)
    assert inspection.levers[0].least == pytest.approx(
        0.5 * 0.15 * np.sqrt(1 - cosine**2) / 0.351, rel=1e-9
    )
    words = {finding.part: finding.words for finding in inspection.findings()}["cylinder.lift"]
    assert re.search(
        r"moment arm falls to 1\d % of its largest at boom -?8\d\.\d° \(below 15 %\)", words
    )


def test_a_spring_on_a_slide_that_rests_aside() -> None:
    """Its ``at_mm`` is a number, no point."""
    machine = two_masses(1e6, more="at_mm = 2.0\n")
    found = inspect(machine, ad.Workspace.grid(machine, 3)).findings()
    assert not [finding for finding in found if "at_mm" in finding.part]


def test_a_link_without_mass() -> None:
    urdf = re.sub(
        r'(<link name="stick">.*?)<inertial>.*?</inertial>',
        r"\1",
        EXCAVATOR.urdf_text,
        count=1,
        flags=re.DOTALL,
    )
    machine = Machine.from_text(EXCAVATOR.text, urdf, Path("x.toml"))
    parts = {f.part for f in inspect(machine, ad.Workspace.grid(machine, 4)).findings()}
    assert "link stick" in parts


# ------------------------------------------------------------------------------------------- facts


def test_facts_of_the_20_t_machine() -> None:
    """Masses as in the URDF; ranges end on the strokes; reach and depth of the sheet (9.86 m and
    6.72 m) within 9 %.
    """
    inspection = inspect(EXCAVATOR, ad.Workspace.grid(EXCAVATOR, points=15))
    assert inspection.masses == {"platform": 16520, "boom": 2310, "stick": 1010, "bucket": 660}
    ends = [[inspection.ended_by(j, end) for end in (0, 1)] for j in range(3)]
    assert ends == [
        ["boom in", "boom out"],
        ["stick out", "stick in"],
        ["bucket out", "bucket in"],
    ]
    assert inspection.tool.max(axis=0)[0] == pytest.approx(9.86, rel=0.02)
    assert -inspection.tool.min(axis=0)[1] == pytest.approx(6.72, rel=0.09)
    assert inspection.stroke_used(0) == pytest.approx(1, abs=1e-4)


@pytest.mark.parametrize("units", [WORKSHOP, SI], ids=["workshop", "si"])
@pytest.mark.parametrize(
    "name", ["excavator_20t", "loader_crane", "paper_1dof", "redundant", "branched"]
)
def test_sheets_of_every_kind_of_machine(name: str, units: object) -> None:
    machine = machines.named(name)
    sheets = check_sheets(inspect(machine, ad.Workspace.grid(machine, 3)), units)  # type: ignore[arg-type]
    for sheet in sheets:
        assert all(len(row) == (len(sheet.columns) or 2) for row in sheet.rows)
        assert "nan" not in str(sheet.rows)


def test_where_valves_leak_simulations_begin_at_other_pressures() -> None:
    """It was said of every machine that they begin at those of the table."""
    leak = {"cylinder.lift.valve.leakage_l_per_min_per_bar": 0.01}
    for machine in (ad.load("paper_1dof"), ad.load("paper_1dof").replace(leak)):
        start = ad.simulate(machine, [0.0], {}, duration=0.01).pressures[0, 0]
        held = machine.cylinders[0].static_pressures(
            machine.at([0.0]).cylinder_forces[:, 0], machine.supply
        )
        leaking = machine.cylinders[0].valve is not None and machine.cylinders[0].valve.leaks
        sheets = check_sheets(inspect(machine, ad.Workspace.grid(machine, 3)), WORKSHOP)
        notes = " ".join(sheet.note for sheet in sheets)
        assert ("as at the start of a simulation (not of lift: flow" in notes) == leaking
        assert np.allclose(start, np.ravel(held), rtol=1e-6) != leaking


@pytest.mark.slow
def test_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["check", "excavator_20t"], monkeypatch) == 0
    printed = capsys.readouterr().out
    for words in (
        "Cylinders [mm]",
        "296.0",
        "link boom",
        "boom out",
        "350 bar",
        "Implausible values",
        "50 % of the poses",
    ):
        assert words in printed
    lines = printed.splitlines()
    assert max(len(line) for line in lines if set(line.strip()) == {"─"}) <= 100  # of tables
    assert not any(line.endswith(" ") for line in lines)
    files = {path.name for path in tmp_path.rglob("*.*")}
    assert files == {"machine.png", "lift_chart.csv", "lift_chart.png"}


def test_a_pin_outside_its_outline_is_told(tmp_path: Path) -> None:
    """The boom's upper edge 400 mm lower near the rod-end pin of the boom cylinder, x 2233.7 and
    z 950.5 mm: from (2350, 775) over (2000, 770) mm to (905, 656) the pin is 177.1 mm above it by
    hand: 950.5 − 770 − 5 · 233.7/350 = 177.2 mm straight up, cos 0.82° of that square to the edge.
    """
    edge = "[2350, 1175], [2000, 1170], [905, 656]"
    file = written(tmp_path, (edge, "[2350, 775], [2000, 770], [905, 656]"))
    machine = ad.load(file)
    sheet = check_sheets(inspect(machine, ad.Workspace.grid(machine, 3)))[-1]
    (words,) = [words for part, words in sheet.rows if part == "requirements.outline.boom"]
    assert "rod_end pin of the boom cylinder at x 2233.7, z 950.5 mm: it is 177.1 mm out" in words
    assert "move the edge there out by 287.1 mm; until then designs are refused" in words


@pytest.mark.parametrize("points", [3, 9])
def test_a_cylinder_across_joints_that_ends_their_motion_uses_its_stroke(points: int) -> None:
    """80 mm, where the joints would take it from 2958.2 to 3643.3 mm (an independent script over
    1681 poses) of 3337.7 mm; whatever the workspace's grid.
    """
    wide = machines.named("crossing")
    (k,) = [k for k, one in enumerate(wide.cylinders) if one.name == "long"]
    assert inspect(wide, ad.Workspace.grid(wide, points)).stroke_used(k) == pytest.approx(
        (3643.3 - 2958.2) / 3337.7, abs=1e-4
    )
    ends = {"cylinder.long.closed_length_mm": 3300, "cylinder.long.stroke_mm": 80}
    short = wide.replace(ends)
    assert inspect(short, ad.Workspace.grid(short, points)).stroke_used(k) == pytest.approx(1)


@pytest.mark.parametrize("points", [3, 9])
def test_moment_arms_across_joints_do_not_depend_on_the_grid(points: int) -> None:
    """By differences of the pin-to-pin length at those of 401 × 401 poses over both ranges that
    are within a short stroke; the usual grid has 115 × 172, which end as much inside.
    """
    ends = {"cylinder.long.closed_length_mm": 3300, "cylinder.long.stroke_mm": 80}
    machine = machines.named("crossing").replace(ends)
    (k,) = [k for k, one in enumerate(machine.cylinders) if one.name == "long"]
    found = inspect(machine, ad.Workspace.grid(machine, points)).levers
    axes = np.meshgrid(*(np.linspace(*span, 401) for span in machine.ranges))
    q = np.column_stack([axis.ravel() for axis in axes])
    q = q[machine.margins(q).min(axis=1) >= -1e-9]
    for lever in (one for one in found if one.cylinder == k):
        step = 1e-6 * np.eye(2)[lever.joint]
        ahead, back = (
            machine.linkages[k].length(machine.arm.kinematics(x)) for x in (q + step, q - step)
        )
        arms = np.abs(ahead - back) / 2e-6
        assert (lever.least, lever.most) == pytest.approx((arms.min(), arms.max()), rel=2e-3)


def test_a_catalogue_that_the_machine_cannot_take_is_told() -> None:
    """Four cylinders on two joints; designs refuse what `check` tells."""
    machine = machines.demanding(machines.named("redundant"), 'catalogue = "iso"')
    workspace = ad.Workspace.grid(machine, 3)
    sheet = check_sheets(inspect(machine, workspace))[-1]
    (words,) = [words for part, words in sheet.rows if part == "requirements.catalogue"]
    assert "4 cylinders on 2 joints: their static forces depend on the sizes" in words
    assert words.endswith("until then designs are refused")
    with pytest.raises(ad.ArmDesignError, match="4 cylinders on 2 joints"):
        ad.size_cylinders(machine, workspace)


def test_arms_of_slides_are_no_lengths_also_where_they_change() -> None:
    """A cylinder aslant of its slide: its arm, the cosine of their angle, changes on the way."""
    slide = machines.Joint("out", "root", axis=(1, 0, 0), kind="prismatic", limits=(-0.2, 0.2))
    push = machines.CylinderSpec("push", ("root", (-1.0, 0, 0.0)), ("out", (0.2, 0, 0.1)))
    machine = machines.build([slide], [push])
    sheets = check_sheets(inspect(machine, ad.Workspace.grid(machine, 3)))
    (arms,) = (sheet for sheet in sheets if sheet.title == "Moment arms")
    assert "everywhere" not in arms.rows[0]
    assert arms.note == "of a sliding joint: cylinder travel per joint travel"


@pytest.mark.parametrize(
    ("stroke", "first"), [("1.26", "Implausible values"), ("1260", "20 t crawler excavator")]
)
def test_what_all_else_may_follow_from_comes_first(
    stroke: str, first: str, tmp_path: Path
) -> None:
    """A number in another unit makes nonsense of what is worked out with it, so it is told
    before.
    """
    file = written(tmp_path, ("stroke_mm = 1260", f"stroke_mm = {stroke}"))
    sheets = check_sheets(inspect(ad.load(file), ad.Workspace.grid(ad.load(file), 3)))
    assert sheets[0].title.startswith(first)
    assert [sheet.title for sheet in sheets].count("Implausible values") == 1
    if stroke == "1.26":
        assert "1.26 mm looks like metres: write stroke_mm = 1260" in sheets[0].rows[0][1]


@pytest.mark.parametrize(
    ("rod_end", "joint", "dead"),
    [([300.0, 0.0, 200.0], "stick", True), ([1000.0, 0.0, -500.0], "boom", False)],
)
def test_where_a_moment_arm_changes_sign(rod_end: list[float], joint: str, dead: bool) -> None:
    """The long cylinder across both joints holds the stick alone, the boom beside the lift. Signs
    by differences of lengths.
    """
    keys = {"rod_end.at_mm": rod_end, "closed_length_mm": 600.0, "stroke_mm": 5000.0}
    machine = machines.named("crossing").replace(
        {f"cylinder.long.{k}": v for k, v in keys.items()}
    )
    inspection = inspect(machine, ad.Workspace.grid(machine, 5))
    j, q, step = machine.joints.index(joint), inspection.workspace.q, np.zeros(2)
    step[j] = 1e-6
    steps = (machine.arm.kinematics(q + way) for way in (step, -step))
    ahead, behind = (machine.linkages[1].length(poses) for poses in steps)
    assert (ahead - behind).min() < 0 < (ahead - behind).max()
    (lever,) = (one for one in inspection.levers if one.cylinder == 1 and one.joint == j)
    assert (lever.turns, lever.follows) == (True, not dead)
    words = [one.words for one in inspection.findings() if "changes sign" in one.words]
    assert bool(words) == dead
    parts = {one.words for one in figures(machine) if one.part == f"long.{joint}"}
    assert ("largest joint speed" in parts) == dead


def test_a_tool_beside_its_arm() -> None:
    """Reach and tipping lines count where the arm points: not 2 m aside of it."""
    assert "tool" not in odd({}, "paper_1dof")
    aside = odd({"tool.at_mm": [1000, 2000, 150]}, "paper_1dof")["tool"]
    assert aside.startswith("at 100 % of the poses is not ahead of the slew axis")


def test_what_does_not_follow_an_arm_along_y() -> None:
    """Designs move pins along x and z of their link, and ``[stability]`` lies along the arm."""
    boom = replace(machines.BOOM, rpy=(0, 0, math.pi / 2))
    cylinders = [replace(machines.LIFT, base=("root", (0, 0.7, 0.1))), machines.FOLD]
    standing = "[stability]\nmass_kg = 9000\nat_mm = [0, -500, 0]\nfront_mm = 900\nrear_mm = 900"
    machine = machines.build([boom, machines.STICK], cylinders, more=standing)
    found = inspect(machine, ad.Workspace.grid(machine, 3)).findings()
    words = {one.part: one.words for one in found}
    assert "those on root leave the plane" in words["cylinder.lift"]
    assert not any("leave the plane" in one for part, one in words.items() if "fold" in part)
    assert "where the arm points, 90.0° from the root's x axis" in words["stability.at_mm"]
    assert "tool" not in words
