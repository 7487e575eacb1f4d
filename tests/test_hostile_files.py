"""Files made to harm: each is refused in one line, or read, within seconds and a gigabyte.

Every case runs in a process of its own whose memory the system bounds.
"""

from __future__ import annotations

import csv
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest

import armdesign as ad
from armdesign.csv_rows import plain_text, read_rows
from armdesign.machine.machine import Machine
from armdesign.mechanism import urdf_faults
from armdesign.output import write_csv
from armdesign.report.contents import Picture, Report, ReportSection
from armdesign.text_files import LARGEST_MACHINE_FILE, LARGEST_URDF
from tests import machines
from tests.commands import Refused, main

SECONDS, BYTES = 5, 10**9  # of processor time and memory for any file
ONE = machines.named("paper_1dof")


def written(folder: Path, text: str = ONE.text, urdf: str = ONE.urdf_text) -> Path:
    (folder / ONE.section.urdf).write_text(urdf, encoding="utf-8")
    (folder / "x.toml").write_text(text, encoding="utf-8")
    return folder / "x.toml"


def with_links(count: int, *, behind: bool = True, kind: str = "revolute") -> str:
    """The URDF with so many more links, one behind the other or all on one."""
    parts = []
    before = last = next(reversed(ONE.arm.links))
    for k in range(count):
        parts.append(
            f'<link name="l{k}"/><joint name="j{k}" type="{kind}"><parent link="{before}"/>'
            f'<child link="l{k}"/><axis xyz="0 1 0"/>'
            '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        )
        before = f"l{k}" if behind else last
    return ONE.urdf_text.replace("</robot>", "".join(parts) + "</robot>")


# ------------------------------------------------------------------------------- what is no file

ODD = (("machine", "pipe"), ("machine", "device"), ("report", "pipe"))  # quick


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes in the file system")
@pytest.mark.parametrize(
    ("what", "kind"),
    [
        pytest.param(what, kind, marks=() if (what, kind) in ODD else pytest.mark.slow)
        for what in ("machine", "urdf", "catalogue", "csv", "report")
        for kind in ("pipe", "device", "folder", "large")
    ],
)
def test_what_is_no_regular_file_of_some_size(
    what: str, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A pipe would be waited for, a device behind a link read until the memory is full."""
    path = written(tmp_path)
    suffixes = {"machine": "toml", "urdf": "urdf"}
    place = tmp_path / f"odd.{suffixes.get(what, 'csv')}"
    if what == "report":
        place = tmp_path / "report.json"
    if kind == "pipe":
        os.mkfifo(place)
    elif kind == "device":
        place.symlink_to("/dev/zero")
    elif kind == "folder":
        place.mkdir()
    else:
        with place.open("wb") as file:
            file.truncate(10**12)  # a hole: it takes no room on the disk
    words = ["map", str(path), "--out", str(tmp_path / "out"), "--allow-outside"]
    if what == "machine":
        words[1] = str(place)
    elif what == "urdf":
        text = path.read_text(encoding="utf-8").replace(ONE.section.urdf, place.name)
        path.write_text(text, encoding="utf-8")
    elif what == "catalogue":
        words = ["optimize", *words[1:-1], "--catalogue", str(place)]
    elif what == "report":
        words = ["report", str(tmp_path)]
    else:
        words = ["calibrate", str(path), str(place), "--fit", "fluid.bulk_modulus_MPa"]
    run = subprocess.run(
        [sys.executable, "-c", BOUNDED, *words], capture_output=True, text=True, timeout=60
    )
    assert run.returncode == 2, run.stderr
    assert run.stderr.count("\n") == 1, run.stderr
    expected = {
        "pipe": "no regular file",
        "device": "no regular file|outside",
        "folder": "Is a directory|holds no",
        "large": "larger than",
    }
    assert re.search(expected[kind], run.stderr), run.stderr


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes in the file system")
def test_pictures_of_a_report_that_are_no_regular_files(tmp_path: Path) -> None:
    """The page says that they lack."""
    pictures = tuple(Picture(caption="C", file=file) for file in ("pipe.png", "device.png"))
    report = Report(title="", lead="", sections=(ReportSection(title="", pictures=pictures),))
    (tmp_path / "report.json").write_text(report.text(), encoding="utf-8")
    os.mkfifo(tmp_path / "pipe.png")
    (tmp_path / "device.png").symlink_to("/dev/zero")
    words = [sys.executable, "-c", BOUNDED, "report", str(tmp_path)]
    run = subprocess.run(words, capture_output=True, text=True, timeout=60)
    assert (run.returncode, run.stderr) == (0, "")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count("the folder has no picture") == 2


BOUNDED = f"""
import resource, sys
resource.setrlimit(resource.RLIMIT_CPU, ({SECONDS + 5}, {SECONDS + 5}))
import armdesign.cli
sys.argv[0] = "armdesign"
armdesign.cli.main()
"""


# ------------------------------------------------------------------------------- what is too much


def of_size(unit: str, bytes_: int, end: str = "") -> str:
    return unit * ((bytes_ - len(ONE.text) - 200) // len(unit)) + end


TOO_MUCH: dict[str, tuple[Callable[[], str], str]] = {
    "a key of many parts": (lambda: f"{ONE.text}\n[a]\n{'a.' * 20_000}b = 1\n", "32 parts"),
    "a header of many parts": (lambda: f"{ONE.text}\n[{'a.' * 20_000}b]\n", "32 parts"),
    "quoted parts": (lambda: ONE.text + '\n[a]\n"\\"" . ' + '"\\"".' * 20_000 + "b=1", "32 parts"),
    "deep lists": (lambda: f"a = {'[' * 100}{']' * 100}\n{ONE.text}", "within each other"),
    "deeper lists": (lambda: "a = " + of_size("[", LARGEST_MACHINE_FILE), "nested too deeply"),
    "many values": (
        lambda: f"a = [{of_size('1,', LARGEST_MACHINE_FILE)}]\n{ONE.text}",
        "values, more than",
    ),
    "many tables": (
        lambda: ONE.text + "".join(f"\n[cylinder.c{k}]" for k in range(15_000)),
        "tables, more than 1000",
    ),
    "long name": (lambda: of_size("a", LARGEST_MACHINE_FILE, " = 1\n") + ONE.text, "aaaaa…"),
    "large": (lambda: ONE.text + "#" * LARGEST_MACHINE_FILE, "larger than 1 MB"),
}
URDFS: dict[str, tuple[Callable[[], str], str]] = {
    "many links": (
        lambda: ONE.urdf_text.replace("</robot>", "<link/>" * 50_000 + "</robot>"),
        "links, more than 5000",
    ),
    "deep elements": (
        lambda: ONE.urdf_text.replace(
            "</link>", f"{'<mass>' * 100_000}{'</mass>' * 100_000}</link>", 1
        ),
        "more than 50 elements within each other",
    ),
    "many elements": (
        lambda: ONE.urdf_text.replace("</link>", "<a/>" * 300_000 + "</link>", 1),
        "more than 100000 elements",
    ),
    "many attributes": (
        lambda: ONE.urdf_text.replace(
            "<robot ", "<robot " + " ".join(f"a{k}='1'" for k in range(300_000)) + " ", 1
        ),
        "element robot with more than 100 attributes",
    ),
    "many visuals": (
        lambda: ONE.urdf_text.replace("</link>", "<visual/>" * 40_000 + "</link>", 1),
        "visuals, more than 5000",
    ),
    "links behind each other": (lambda: with_links(1_500), "joints are one behind the other"),
    "links beside each other": (lambda: with_links(1_500, behind=False), ""),
    "wrong links": (
        lambda: with_links(1_500).replace('<child link="', '<child link="x'),
        "does not exist",
    ),
    "entities": (
        lambda: (
            '<!DOCTYPE robot [<!ENTITY a0 "aaaaaaaaaa">'
            + "".join(f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 12))
            + f"]>{ONE.urdf_text[ONE.urdf_text.index('<robot') :]}"
        ).replace("</robot>", "<x>&a11;</x></robot>"),
        "not well-formed XML",
    ),
    "a file of the system": (
        lambda: (
            '<!DOCTYPE robot [<!ENTITY a SYSTEM "file:///etc/passwd">]>'
            + ONE.urdf_text[ONE.urdf_text.index("<robot") :]
        ).replace("</robot>", "<x>&a;</x></robot>"),
        "not well-formed XML",
    ),
    "large": (lambda: ONE.urdf_text + " " * LARGEST_URDF, "larger than 4 MB"),
}
ASKED = f"""
import resource, sys
resource.setrlimit(resource.RLIMIT_CPU, ({2 * SECONDS}, {2 * SECONDS}))
import armdesign as ad
from armdesign.inspection.file_faults import faults
before = resource.getrusage(resource.RUSAGE_SELF)
try:
    ad.load(sys.argv[1])
    print("")
except ad.ArmDesignError as error:
    print(error)
middle = resource.getrusage(resource.RUSAGE_SELF)
print(len(faults(sys.argv[1])))
after = resource.getrusage(resource.RUSAGE_SELF)
words = open("/proc/self/status").read().split()  # ru_maxrss is the parent's where that is larger
memory = 1024 * int(words[words.index("VmHWM:") + 1])
print(middle.ru_utime - before.ru_utime, after.ru_utime - middle.ru_utime, memory)
"""
QUICK = ("deep lists", "entities")
EVERY = [("x.toml", key) for key in TOO_MUCH] + [("urdf", key) for key in URDFS]


@pytest.mark.parametrize(
    ("where", "what"),
    [
        pytest.param(*case, marks=() if case[1] in QUICK else pytest.mark.slow, id="-".join(case))
        for case in EVERY
    ],
)
def test_too_much(where: str, what: str, tmp_path: Path) -> None:
    make, message = (TOO_MUCH if where == "x.toml" else URDFS)[what]
    path = written(tmp_path, make()) if where == "x.toml" else written(tmp_path, urdf=make())
    run = subprocess.run(
        [sys.executable, "-c", ASKED, str(path)], capture_output=True, text=True, check=True
    )
    line, count, figures = run.stdout.splitlines()
    assert message in line
    assert bool(line) == bool(int(count)) == bool(message)
    assert len(line) < 13_000
    load, check, memory = map(float, figures.split())
    assert max(load, check) < SECONDS
    assert memory < BYTES


def test_checks_of_a_urdf_grow_linearly() -> None:
    """Counts, not seconds: sixteen times the links take sixteen times the calls."""
    counts = []
    for count in (25, 400):
        calls = 0

        def count_calls(*_: object) -> None:
            nonlocal calls
            calls += 1

        text = with_links(count)
        sys.setprofile(count_calls)
        try:
            assert urdf_faults.faults(text, ["boom"], {}, "x.urdf") == []
        finally:
            sys.setprofile(None)
        counts.append(calls)
    assert counts[1] < 16 * counts[0]


# ------------------------------------------------------------------------------------ what is text


EVIL = {
    "=cmd|' /C calc'!A0": "'=cmd|' /C calc'!A0",
    "+1+cmd": "'+1+cmd",
    "-2+3": "'-2+3",
    "@SUM(A1)": "'@SUM(A1)",
    "\t=1": r"\t=1",  # a control character is shown, and what begins with "\" is no formula
    "＝1": "'＝1",
}
FIRST, *OTHERS = EVIL


@pytest.mark.parametrize(
    "name", [FIRST, *(pytest.param(one, marks=pytest.mark.slow) for one in OTHERS)]
)
def test_no_name_is_a_formula(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A joint's name is a column's; the column keeps its name for whoever reads it as a text."""
    joint = next(iter(ONE.section.joints))
    xml = name.replace("\t", "&#9;").replace("'", "&apos;")
    toml = name.replace("\t", "\\t")
    path = written(
        tmp_path,
        ONE.text.replace(f'joints = ["{joint}"]', f'joints = ["{toml}"]'),
        ONE.urdf_text.replace(f'<joint name="{joint}"', f'<joint name="{xml}"'),
    )
    assert ad.load(path).arm.names == (name,)
    assert (
        main(["map", str(path), "--points", "3", "--out", str(tmp_path / "o")], monkeypatch) == 0
    )
    for file in (tmp_path / "o").glob("*.csv"):
        with file.open(newline="", encoding="utf-8") as text:
            cells = [cell for row in csv.reader(text) for cell in row]
        assert all(plain_text(cell) == cell for cell in cells)
    with (tmp_path / "o" / "map.csv").open(newline="", encoding="utf-8") as text:
        assert next(csv.reader(text))[0] == EVIL[name]
    if name == name.strip():
        assert read_rows(tmp_path / "o" / "map.csv")[0][0] == name


def test_numbers_and_ordinary_names_stay(tmp_path: Path) -> None:
    frame = pd.DataFrame({"boom": [-1.5, 2.0], "payload": ["-", "-1.5e3"], "'tis": ["a=b", None]})
    write_csv(frame, tmp_path / "x.csv")
    text = (tmp_path / "x.csv").read_text(encoding="utf-8")
    assert text == "boom,payload,'tis\n-1.5,-,a=b\n2,-1.5e3,\n"


def test_no_name_is_a_formula_behind_a_semicolon(tmp_path: Path) -> None:
    """A spreadsheet whose separator of lists it is begins another cell there."""
    names = ["x;=1+1;y", "a;-3;b", "@a;+b"]
    write_csv(pd.DataFrame({"title": names, "n": [1, 2, 3]}), tmp_path / "x.csv")
    text = (tmp_path / "x.csv").read_text(encoding="utf-8")
    assert text.splitlines()[1:] == ["x;'=1+1;y,1", "a;-3;b,2", "'@a;'+b,3"]
    assert [fields[0] for _, fields in read_rows(tmp_path / "x.csv")[1]] == names


@pytest.mark.slow
def test_a_urdf_of_text_is_bounded_too(refused: Refused) -> None:
    with pytest.raises(ad.ArmDesignError, match="5001 links, more than 5000"):
        Machine.from_text(ONE.text, with_links(4_999), Path("x.toml"))


@pytest.mark.parametrize(
    ("table", "keys", "most"),
    [
        ("payload.p", 'mass_kg = 100\nlink = "bucket"\nat_mm = [500, 0, 200]', 50),
        ("requirements.lift.l", "reach_mm = 3000\nheight_mm = 0\nmass_kg = 10", 100),
    ],
)
def test_each_of_which_is_a_map_or_a_search_are_counted(table: str, keys: str, most: int) -> None:
    """A load case takes a tenth of a second and more of ``check``, a lift a search of its own."""
    machine = ad.load("excavator_20t")
    text = machine.text + "".join(f"\n[{table}{k}]\n{keys}\n" for k in range(most + 1))
    said = (
        rf"{table.rpartition('.')[0]}: a table of \d+ entries is not allowed; give .* most {most} "
    )
    with pytest.raises(ad.ArmDesignError, match=said):
        ad.Machine.from_text(text, machine.urdf_text, machine.source)
