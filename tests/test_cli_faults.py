"""Bad input of the command line: one line, exit code 2 and nothing written."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests import machines
from tests.commands import COMMANDS, Refused, assert_one_line, main, run

# --------------------------------------------------------------------------------------- bad input


def broken(folder: Path, old: str, new: str) -> str:
    """A copy of the excavator with one text changed, as `broken.toml` in the folder."""
    machine = machines.named("excavator_20t")
    assert old in machine.text
    (folder / "broken.toml").write_text(machine.text.replace(old, new, 1), encoding="utf-8")
    (folder / "excavator_20t.urdf").write_text(machine.urdf_text, encoding="utf-8")
    return "broken.toml"


BAD = [
    (["excavater_20t"], 'did you mean "excavator_20t"'),
    (["none.toml"], "none.toml: no such file"),
    ([""], "is followed by an empty word"),
    (["."], "holds no"),
    (
        ["excavator_20t", "--points", "x"],
        '--points: "x" is not a list of numbers; give 21 or 21,21,61',
    ),
    (["excavator_20t", "--points", "1"], "points: 1 is not allowed"),
    (["excavator_20t", "--points", "3,3"], "points: [3, 3] is not allowed"),
    (["excavator_20t", "--points", "3,3,3,3"], "is not allowed; give one number ≥ 2, or 3"),
    (["excavator_20t", "--points", "-5"], "points: -5 is not allowed"),
    (["excavator_20t", "--points", "3.5"], "is not a list of numbers"),
    (
        ["excavator_20t", "--units", "inch"],
        "Invalid value for '--units': 'inch' is not one of 'workshop', 'si'.",
    ),
    (["excavator_20t", "--points", "999999"], "poses are too many; give at most 5"),
]


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(("words", "message"), BAD, ids=[" ".join(words) for words, _ in BAD])
def test_bad_arguments_are_one_line(
    command: str, words: list[str], message: str, refused: Refused
) -> None:
    refused([command, *words, "--out", "out"], message)


@pytest.mark.parametrize(("words", "message"), BAD, ids=[" ".join(words) for words, _ in BAD])
def test_bad_arguments_of_check(words: list[str], message: str, refused: Refused) -> None:
    refused(["check", *words], message)


FILES = [
    (
        "bore_mm = 120",
        "bore = 120",
        'broken.toml: cylinder.boom.bore: unknown key; did you mean "bore_mm"?',
    ),
    (
        "bore_mm = 120\n",
        "",
        "broken.toml: cylinder.boom.bore_mm: missing; add bore_mm: a number in (0, 100000] mm",
    ),
    (
        "bore_mm = 120",
        "bore_mm = nan",
        "cylinder.boom.bore_mm: nan is not allowed; give a number in (0, 100000] mm",
    ),
    (
        "bore_mm = 120",
        'bore_mm = "120"',
        'cylinder.boom.bore_mm: "120" is not allowed; give a number',
    ),
    (
        "bore_mm = 120",
        "bore_mm = -120",
        "cylinder.boom.bore_mm: -120 is not allowed; give a number in (0, 100000] mm",
    ),
    (
        'link = "chassis"',
        'link = "chasis"',
        'cylinder.boom.base.link: no link "chasis" in the URDF; did you mean',
    ),
    ("closed_length_mm = 1825", "closed_length_mm = 9000", "cylinder.boom.stroke_mm: over joint"),
    ("rocker_mm = 578.7", "rocker_mm = 5000", "cylinder.bucket.four_bar: does not close at any"),
    (
        'link = "bucket"\nat_mm = [645',
        "at_mm = [645",
        "payload.full.link: missing: a mass must sit somewhere; add link",
    ),
    ("[461.5, 0, -602.5]", "[0, 0, 0]", "cylinder.boom: is at its dead centre"),
    ("excavator_20t.urdf", "none.urdf", 'urdf: "none.urdf": no such file; check the path'),
    ("[fluid]", "[fluid", "broken.toml: not valid TOML"),
]


@pytest.mark.parametrize(
    ("old", "new", "message"), FILES, ids=[message[:40] for *_, message in FILES]
)
def test_a_broken_file_is_one_line(
    old: str,
    new: str,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """The list of the requirement, each with key, value, range and remedy."""
    monkeypatch.chdir(tmp_path)
    before = {path.name for path in tmp_path.iterdir()} | {
        broken(tmp_path, old, new),
        "excavator_20t.urdf",
    }
    assert main(["map", "broken.toml", "--out", "out", "--points", "3"], monkeypatch) == 2
    out, err = capfd.readouterr()
    assert out == ""
    assert_one_line(err, message)
    assert {path.name for path in tmp_path.iterdir()} == before
    assert main(["check", "broken.toml"], monkeypatch) == 2
    assert message in capfd.readouterr().err


@pytest.mark.parametrize(
    "command", ["map", *(pytest.param(c, marks=pytest.mark.slow) for c in COMMANDS if c != "map")]
)
def test_a_process_of_its_own_says_the_same(command: str, tmp_path: Path) -> None:
    """Nothing on the way to the terminal: no warning, no C++ parser, no progress display."""
    name = broken(tmp_path, "rod_mm = 85", "rod_mm = 850")
    done = run(command, name, folder=tmp_path, PYTHONWARNINGS="error")
    assert done.returncode == 2
    assert done.stdout == ""
    assert_one_line(
        done.stderr,
        "broken.toml: cylinder.boom.rod_mm: 850 mm does not fit the bore; give a rod in (0, 120)",
    )
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "broken.toml",
        "excavator_20t.urdf",
    ]


@pytest.mark.parametrize("out", ["/proc/none", "/dev/null/x", "notes.txt", "l" * 300])
def test_a_place_that_cannot_be_written(
    out: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "notes.txt").write_text("mine")
    assert main(["map", "paper_1dof", "--out", out, "--points", "5"], monkeypatch) == 2
    assert_one_line(capfd.readouterr().err, f"--out {out[:40]}")
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]
    assert (tmp_path / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize("within", ["", "/x"])
@pytest.mark.parametrize(
    ("end", "said"), [("nowhere", "a link to nothing"), ("link", "a link in a circle")]
)
@pytest.mark.parametrize("command", [["check"], ["map"], ["draw"], ["sweep", "study.toml"]])
def test_a_link_without_an_end_is_said(
    command: list[str],
    end: str,
    said: str,
    within: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """It "cannot be written (File exists)", as the last word after all the work."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "link").symlink_to(end)
    (tmp_path / "study.toml").write_text('machine = "paper_1dof"\npoints = 3\n')
    words = [*command, "paper_1dof"][:2]
    assert main([*words, "--out", f"link{within}"], monkeypatch) == 2
    printed = capfd.readouterr()
    place = tmp_path / "link" if within else Path("link")
    assert_one_line(printed.err, f"--out link{within}: {place} is {said}; remove it or mend it")
    assert printed.out == ""
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link", "study.toml"]


@pytest.mark.parametrize(
    "words",
    [
        ["check"],
        ["draw"],
        ["export"],
        ["sensitivity"],
        ["tolerances"],
        ["control"],
        ["what-if", "--set", "supply.pressure_bar=200"],
        ["compare", "paper_1dof"],
        ["pareto"],
        ["steps"],
        ["optimize"],
        ["validate"],
        ["design"],
    ],
    ids=" ".join,
)
def test_places_are_tried_before_work(
    words: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """Of a folder that is a file nothing but its refusal is printed."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "notes.txt").write_text("mine")
    command, *more = words
    assert main([command, "paper_1dof", *more, "--out", "notes.txt"], monkeypatch) == 2
    printed = capfd.readouterr()
    assert printed.out == ""
    assert_one_line(printed.err, "--out notes.txt")


@pytest.mark.parametrize(
    "words", [["map"], ["nothing"], ["map", "a", "b"], ["map", "a", "--nothing"]]
)
def test_wrong_usage_is_code_2(words: list[str], tmp_path: Path) -> None:
    done = run(*words, folder=tmp_path)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())


def test_an_unknown_vary_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["optimize", "excavator_20t", "--points", "4", "--out", str(tmp_path), "--vary"]
    assert main([*words, "areas,cylinder.boom.bore"], monkeypatch) == 2
    assert capsys.readouterr().err.splitlines() == [
        "armdesign: --vary cylinder.boom.bore: nothing of this name can vary; "
        'did you mean "cylinder.boom.bore_mm"?'
    ]  # fmt: skip


OPTIONS = [  # named as they were typed, not as the arguments that they become
    ("optimize --least money --frequency 7", '--least: "money" is not allowed; give one of oil'),
    ("optimize --least oil --frequency -7", "--frequency: -7 Hz is not allowed"),
    ("optimize --objective speed", "--objective: 'speed' is not allowed; choose from: gain"),
    ("optimize --starts 0", "--starts: 0 is not allowed; give a whole number from 1 to 10000"),
    ("optimize --frequency fast --least oil", '--frequency: "fast" is no number; give it with a'),
    (
        "optimize --frequency=8,5 --least oil",
        '--frequency: "8,5" is no number; give it with a dec',
    ),
    (
        "control --delay 10ms",
        '--delay: "10ms" is no number; give it with a decimal point and with',
    ),
    ("move", "Missing option '--from'; see armdesign move --help"),
    ("tolerances --seed -1", "--seed: -1 is not allowed; give a whole number of 0 or more"),
    ("view --port 99999", "--port: 99999 is not allowed; give a whole number from 1024 to 65535"),
    ("view --port many", '--port: "many" is no whole number; give one, as 3'),
]


@pytest.mark.parametrize(("words", "message"), OPTIONS)
def test_options_are_named_as_they_were_typed(words: str, message: str, refused: Refused) -> None:
    command, *options = words.split()
    refused([command, "paper_1dof", *options], message)


def test_what_was_not_typed_is_no_option(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A catalogue that the file names is not the option of that name."""
    machine = machines.demanding(machines.named("redundant"), 'catalogue = "iso"')
    path = machine.save(tmp_path / "redundant.toml")
    words = ["optimize", str(path), "--points", "3", "--out", str(tmp_path / "out")]
    assert main(words, monkeypatch) == 2
    assert capsys.readouterr().err.startswith("armdesign: catalogue: odd has 4 cylinders on 2")
