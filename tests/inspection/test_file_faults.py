"""All faults of a machine file, its URDF and their machine at once."""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest

import armdesign as ad
from armdesign.inspection.file_faults import faults
from armdesign.inspection.inspection import inspect
from armdesign.mechanism import urdf_faults
from armdesign.report.inspections import check_sheets
from tests.commands import main
from tests.inspection.inspected import EXCAVATOR, odd, written
from tests.machine.file.bad_files import URDF
from tests.machine.file.damage import damaged
from tests.sprung import rocking
from tests.sprung import written as saved

# -------------------------------------------------------------------------------- everything wrong


def test_all_problems_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Schema, cross-checks, unknown links and joints, each on its own line, in one run."""
    name = written(
        tmp_path,
        ("bore_mm = 120", "bore = 120"),
        ("rod_mm = 100", "rod_mm = 300"),
        ("return_pressure_bar = 5", "return_pressure_bar = 500"),
        ('link = "chassis"', 'link = "chasis"'),
        ('joints = ["boom"', 'joints = ["bom"'),
        ('knee = "left"', 'knee = "up"'),
        ("swing = 0.0", 'swing = "a"'),
    )
    assert main(["check", name], monkeypatch) == 2
    out, err = capfd.readouterr()
    assert out == ""
    lines = err.splitlines()
    assert all(line.startswith("armdesign: ") for line in lines)
    expected = [
        'cylinder.boom.bore: unknown key; did you mean "bore_mm"?',
        "cylinder.boom.bore_mm: missing",
        "cylinder.stick.rod_mm: 300 mm does not fit the bore",
        "supply.return_pressure_bar: 500 bar is not below",
        'cylinder.boom.base.link: no link "chasis" in the URDF; did you mean "chassis"?',
        'joint bom: is not in the URDF (named in joints); did you mean "boom"?',
        'cylinder.bucket.four_bar.knee: "up" is not allowed; give one of "left", "right"',
        'frozen.swing: "a" is not allowed',
    ]
    for words in expected:
        assert sum(words in line for line in lines) == 1, (words, err)
    assert len(lines) == len(expected), err


def test_problems_of_the_assembled_machine(tmp_path: Path) -> None:
    """Two joints that no pose suits are both said."""
    name = written(
        tmp_path,
        ("closed_length_mm = 1825", "closed_length_mm = 9000"),
        ("closed_length_mm = 1800", "closed_length_mm = 9"),
    )
    parts = [fault.part for fault in faults(name)]
    assert parts == ["x.toml: cylinder.boom.stroke_mm", "x.toml: cylinder.stick.stroke_mm"]


def test_problems_of_the_urdf(tmp_path: Path) -> None:
    """Two joints and a link that cannot be: all three are said, beside a misspelt link of the
    machine file.
    """
    name = written(tmp_path, ('link = "chassis"', 'link = "chasis"'))
    urdf = EXCAVATOR.urdf_text.replace('mass value="1010"', 'mass value="-1010"')
    urdf = re.sub(r'(<joint name="stick" type=)"revolute"', r'\1"floating"', urdf)
    urdf = re.sub(r'(<joint name="boom" type="revolute">)', r'\1<mimic joint="bucket"/>', urdf)
    (tmp_path / "excavator_20t.urdf").write_text(urdf, encoding="utf-8")
    words = [str(fault) for fault in faults(name)]
    assert len(words) == 4, words
    for part in (
        'no link "chasis"',
        'joint stick: type "floating"',
        "joint boom: mimics",
        "link stick: mass -1010 kg",
    ):
        assert any(part in word for word in words), (part, words)


def fault_lines(folder: Path, urdf: str, *pairs: tuple[str, str]) -> list[str]:
    name = written(folder, *pairs)
    (folder / "excavator_20t.urdf").write_text(urdf, encoding="utf-8")
    return [str(fault) for fault in faults(name)]


FAULTS_OF_THE_URDF = [
    ('("boom" type=)"revolute"', r'\1"planar"'),
    ('(<joint name="stick" type="revolute">)', r'\1<mimic joint="boom"/>'),
    ('(name="stick".*?)lower="[^"]*"', r'\1lower="x"'),
    ('(name="stick".*?)effort="[^"]*"', r'\1effort="-3"'),
    ('(joint name="bucket".*?)axis xyz="[^"]*"', r'\1axis xyz="0 0 0"'),
    ('(link name="boom".*?)mass value="2310"', r'\1mass value="-1"'),
    ('(link name="boom".*?)ixx="[^"]*"', r'\1ixx="1e30"'),
    ('(link name="bucket".*?)iyy="[^"]*"', r'\1iyy="1e6"'),
    ('(joint name="bucket".*?)parent link="stick"', r'\1parent link="stik"'),
    (
        "</robot>",
        '<link name="bucket"/><joint type="fixed"><parent link="bucket"/></joint></robot>',
    ),
]
LINES = [
    "x.toml: cylinder.boom.bore_mm: -1 is not allowed",
    'x.toml: cylinder.boom.base.link: no link "chasis" in the URDF; did you mean "chassis"?',
    'urdf: joint swingg: is not in the URDF (named in frozen); did you mean "swing"?',
    'urdf: two links are named "bucket"',
    "urdf: a joint has no name (number 6 of the file)",
    'urdf: joint boom: type "planar" cannot be used',
    "urdf: joint stick: mimics another joint",
    'urdf: joint stick: lower="x" is not 1 finite number',
    "urdf: joint stick: effort -3 is negative",
    "urdf: joint bucket: the axis has no length",
    "urdf: link boom: mass -1 kg is negative",
    'urdf: link boom: ixx="1e30" is not 1 finite number(s) up to 1e+09',
    "urdf: link bucket: no body has principal inertias",
    'urdf: joint bucket: parent link "stik" does not exist; did you mean "stick"?',
    "urdf: joint number 6: has no child",
]


def test_faults_of_everything_at_once(tmp_path: Path) -> None:
    """Schema, links, joints, and in the URDF names, types, numbers, limits, inertia, tree: a line
    for each, no more.
    """
    urdf = EXCAVATOR.urdf_text
    for old, new in FAULTS_OF_THE_URDF:
        urdf, count = re.subn(old, new, urdf, count=1, flags=re.DOTALL)
        assert count == 1, old
    lines = fault_lines(
        tmp_path,
        urdf,
        ("bore_mm = 120", "bore_mm = -1"),
        ("swing = 0.0", "swingg = 0.0"),
        ('link = "chassis"', 'link = "chasis"'),
    )
    for words in LINES:
        assert sum(words in line for line in lines) == 1, (words, lines)
    assert len(lines) == len(LINES), lines


def test_two_roots_and_a_ring(tmp_path: Path) -> None:
    """The stick carried by the bucket makes a ring; a link that hangs nowhere is a second root:
    both are said.
    """
    ring = EXCAVATOR.urdf_text.replace('<parent link="boom"/>', '<parent link="bucket"/>')
    assert ring != EXCAVATOR.urdf_text
    lines = fault_lines(tmp_path, ring.replace("</robot>", '<link name="lost"/></robot>'))
    assert [line.partition(": ")[2].partition(";")[0] for line in lines] == [
        "2 root links (ground, lost)",
        "links stick, bucket are not connected to the root",
    ]


def test_no_root_at_all() -> None:
    """Two links that carry each other, by hand: no joint and no link is at fault alone."""
    joint = '<joint name="{0}" type="fixed"><parent link="{0}"/><child link="{1}"/></joint>'
    urdf = (
        '<robot><link name="a"/><link'
        f' name="b"/>{joint.format("a", "b")}{joint.format("b", "a")}</robot>'
    )
    assert [str(fault) for fault in urdf_faults.faults(urdf, [], {}, "x.urdf")] == [
        "x.urdf: 0 root links; one link must have no parent",
        (
            "x.urdf: links a, b are not connected to the root; a URDF is one tree: no link may"
            " carry itself"
        ),
    ]


def test_ranges_are_looked_at_beside_faults_elsewhere(tmp_path: Path) -> None:
    """A wrong key of the boom cylinder, no pins on the bucket's: the stick's stroke is wrong all
    the same.
    """
    lines = fault_lines(
        tmp_path,
        EXCAVATOR.urdf_text,
        ("bore_mm = 120", "bore_mm = -1"),
        ("closed_length_mm = 1800", "closed_length_mm = 9"),
        ('lug = { link = "bucket"', 'lug = { link = "stick"'),
    )
    assert [line.partition(" ")[2].partition(": ")[0] for line in lines] == [
        "cylinder.boom.bore_mm",
        "cylinder.bucket",
        "cylinder.stick.stroke_mm",
    ]


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ("return_pressure_bar = 5", "return_pressure_bar = 500", "supply.return_pressure_bar"),
        ("mass_kg = 1600", "mass_kg = -1", "payload.full.mass_kg"),
        ('tool   = { link = "bucket"', 'tool   = { link = "buckt"', "tool.link"),
        (
            "digging = { cylinders = [",
            'digging = { cylinders = ["spade", ',
            "requirements.digging.cylinders",
        ),
        ('name   = "excavator_20t"', 'name   = "2 t"', "name"),
    ],
)
def test_ranges_are_looked_at_beside_any_other_fault(
    old: str, new: str, part: str, tmp_path: Path
) -> None:
    lines = fault_lines(
        tmp_path,
        EXCAVATOR.urdf_text,
        (old, new),
        ("closed_length_mm = 1800", "closed_length_mm = 9"),
    )
    assert [line.split(": ")[1] for line in lines] == [part, "cylinder.stick.stroke_mm"]


def test_ranges_are_looked_at_beside_wrong_masses(tmp_path: Path) -> None:
    """Where the pins are does not depend on what the links weigh."""
    urdf = EXCAVATOR.urdf_text.replace('mass value="1010"', 'mass value="-1010"')
    lines = fault_lines(tmp_path, urdf, ("closed_length_mm = 1800", "closed_length_mm = 9"))
    assert "link stick: mass -1010 kg" in lines[0]
    assert "cylinder.stick.stroke_mm" in lines[1]
    assert len(lines) == 2


def test_both_cylinders_of_a_joint(tmp_path: Path) -> None:
    """Each of two cylinders on the boom can never be in stroke: reading says the first, `check`
    both.
    """
    section = re.search(
        r"\[cylinder\.boom\].*?(?=\n\[cylinder\.stick\])", EXCAVATOR.text, re.DOTALL
    )
    assert section
    wrong = section[0].replace("closed_length_mm = 1825", "closed_length_mm = 9")
    second = wrong.replace("cylinder.boom", "cylinder.help")
    lines = fault_lines(tmp_path, EXCAVATOR.urdf_text, (section[0], f"{wrong}\n\n{second}"))
    assert [line.split(": ")[1] for line in lines] == [
        "cylinder.boom.stroke_mm",
        "cylinder.help.stroke_mm",
    ]


def test_macros_must_be_expanded(tmp_path: Path) -> None:
    """An unexpanded xacro file is no URDF; one expanded from it may still name the namespace."""
    space = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
    declared = EXCAVATOR.urdf_text.replace("<robot ", f"<robot {space} ")
    assert fault_lines(tmp_path, declared) == []
    with_macro = declared.replace("</robot>", '<xacro:include filename="a"/></robot>')
    (line,) = fault_lines(tmp_path, with_macro)
    assert "holds a macro (<xacro:include>); expand it: xacro FILE" in line


def test_a_urdf_outside_the_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Said beside the other faults; allowed, it is read like any other."""
    (tmp_path / "machine").mkdir()
    (tmp_path / "arm.urdf").write_text(EXCAVATOR.urdf_text, encoding="utf-8")
    name = written(
        tmp_path / "machine",
        ('"excavator_20t.urdf"', '"../arm.urdf"'),
        ("bore_mm = 120", "bore_mm = 0"),
    )
    assert main(["check", name], monkeypatch) == 2
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 2
    assert "cylinder.boom.bore_mm" in lines[0]
    assert "--allow-outside" in lines[1]
    assert main(["check", name, "--allow-outside"], monkeypatch) == 2
    assert len(capfd.readouterr().err.splitlines()) == 1


@pytest.mark.parametrize("name", ["excavator_20t", "paper_1dof", "loader_crane"])
def test_no_problems(name: str) -> None:
    assert faults(name) == []


@pytest.mark.slow
@pytest.mark.parametrize("what", ["toml", "urdf"])
def test_whatever_is_refused_has_a_problem_and_the_other_way_round(
    what: str, tmp_path: Path
) -> None:
    """Seeded damage: what `load` refuses, `check` lists among others, each once; no other
    exception comes.
    """
    files = {"toml": tmp_path / "x.toml", "urdf": tmp_path / "excavator_20t.urdf"}
    texts = {"toml": EXCAVATOR.text, "urdf": URDF}
    for kind, file in files.items():
        file.write_text(texts[kind], encoding="utf-8")
    for seed in range(100):
        files[what].write_text(damaged(texts[what], random.Random(seed)), encoding="utf-8")
        all_faults = faults(files["toml"])
        assert all(
            "\n" not in str(problem) and "stand_in" not in str(problem) for problem in all_faults
        ), all_faults
        assert len({str(problem) for problem in all_faults}) == len(all_faults), all_faults
        refused = None
        try:
            machine = ad.load(files["toml"])
        except ad.ArmDesignError as error:
            refused = (error.part, error.fault)
        if refused:
            assert refused in [(problem.part, problem.fault) for problem in all_faults], seed
            continue
        assert not all_faults or "workspace" in str(all_faults[0]), (seed, all_faults)
        if not all_faults and seed % 4 == 0:
            check_sheets(inspect(machine, ad.Workspace.grid(machine, 3)))


def test_a_supply_that_cannot_pull() -> None:
    """Return pressure on the bore side outweighs supply pressure on the rod side: nothing holds a
    pull.
    """
    oddities = odd({"supply.pressure_bar": 300, "supply.return_pressure_bar": 299})
    assert "more than the supply's 300 bar can hold" in oddities["cylinder.stick"]


# ----------------------------------------------------------------------------------------- springs


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('joint = "rocking"', "joint = 3", "spring.carriage.joint: 3 is not allowed; give a text"),
        (
            'joint = "rocking"',
            'joint = "rocking"\nat_deg = 20',
            'spring.carriage.at_deg: 20 is outside the limits of "rocking"',
        ),
        (
            "[spring.carriage]",
            "[spring]",
            "spring: has no name beside the keys of one spring, joint, stiffness_N_m_per_rad;"
            " write [spring.…] with a name",
        ),
        (
            "[cylinder.stick]",
            "[cylinder]",
            "cylinder: has no name beside the keys of one cylinder, bore_mm, rod_mm, stroke_mm,",
        ),
    ],
)
def test_one_fault_one_line(tmp_path: Path, old: str, new: str, words: str) -> None:
    """Of `load` and `check`: neither tables nor joints that stand in are complained of."""
    path = saved(rocking(), tmp_path)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new).replace('["stick", "bucket"]', '["bucket"]'))
    (fault,) = faults(path)
    assert words in str(fault)
    with pytest.raises(ad.ArmDesignError, match=re.escape(words)):
        ad.load(path)


def test_check_tells_of_a_spring_too_soft_within_its_band(tmp_path: Path) -> None:
    """Stiff enough in the file, not at a tenth of it where structure is soft too."""
    path = saved(rocking(stiffness=4e6), tmp_path)
    assert faults(path) == []
    text = path.read_text()
    path.write_text(
        re.sub(r"(?m)^\[bands\].*", "[bands]\nspring_stiffness_share = [0.1, 1.0]", text)
    )
    (fault,) = faults(path)
    assert "(0.1 of it, within the bands) does not hold the machine upright" in str(fault)
    enough = float(fault.remedy.removeprefix("give more than ").removesuffix(" N m/rad"))
    path.write_text(path.read_text().replace("4000000.0", repr(1.001 * enough)))
    assert faults(path) == []


def test_the_least_stiffness_is_that_of_all_poses_and_loads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """However few poses a chunk has, maps and `check` name what is enough for all of them."""
    machine = rocking(stiffness=1e5)
    workspace = ad.Workspace.grid(machine, points=5)
    monkeypatch.setattr("armdesign.arrays.CHUNK", 30)
    with pytest.raises(ad.ArmDesignError, match="upright") as caught:
        ad.frequency_map(machine, workspace)
    enough = float(caught.value.remedy.removeprefix("give more than ").removesuffix(" N m/rad"))
    path = "spring.carriage.stiffness_N_m_per_rad"
    ad.frequency_map(machine.replace({path: 1.001 * enough}), workspace)
    with pytest.raises(ad.ArmDesignError, match="upright"):
        ad.frequency_map(machine.replace({path: 0.999 * enough}), workspace)
