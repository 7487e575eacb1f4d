"""Names and titles are shown as they are: no command to the terminal, no markup, no formula."""

from __future__ import annotations

import io
import re
import unicodedata
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.text import Text
from rich.cells import cell_len
from rich.console import Console

import armdesign as ad
from armdesign import plots
from armdesign.errors import ArmDesignError, MachineFileError, printable, raise_together
from armdesign.machine import template
from armdesign.machine.poses import pose_text
from armdesign.output import show, tell, write_csv
from armdesign.report.contents import HeadlineNumber, Report, ReportSection
from armdesign.report.page import page
from armdesign.report.sheet import Sheet
from armdesign.report.terminal_table import LEAST, terminal_table
from armdesign.units import SI, deg
from tests import machines
from tests.commands import assert_one_line, main

EVIL = "\x1b]0;x\x07\x1b[2J\r\n\x9b\x7f\u202e\u2066\u2028 [red]r[/red] :smile: $a_{ $ b_c^d"
SHOWN = r"\x1b]0;x\x07\x1b[2J\r\n\x9b\x7f\u202e\u2066\u2028 [red]r[/red] :smile: $a_{ $ b_c^d"


def controls(text: str) -> list[str]:
    """Characters that a terminal or a reader may take for commands, but for ends of lines."""
    turns = {*map(chr, range(0x202A, 0x202F)), *map(chr, range(0x2066, 0x206A))}
    turns |= set("\u061c\u200e\u200f\u200b\u2060\ufeff")  # marks of direction, of no width
    return [
        c
        for c in text
        if (unicodedata.category(c) in ("Cc", "Cs", "Zl", "Zp") and c != "\n") or c in turns
    ]


def titled(folder: Path) -> str:
    """The paper's machine with a title that would do things."""
    machine = machines.named("paper_1dof")
    quoted = "".join(f"\\u{ord(c):04x}" if controls(c) or c == "\n" else c for c in EVIL)
    text, count = re.subn(r"^title .*$", lambda _: f'title = "{quoted}"', machine.text, flags=re.M)
    assert count == 1
    (folder / "own.toml").write_text(text, encoding="utf-8")
    (folder / machine.section.urdf).write_text(machine.urdf_text, encoding="utf-8")
    return str(folder / "own.toml")


def test_every_control_character_is_escaped_and_nothing_else() -> None:
    for code in range(0x3000):
        shown = printable(chr(code))
        assert (shown == chr(code)) == (not controls(chr(code)) and chr(code) != "\n"), hex(code)
        assert not controls(shown)
    assert printable("é µ € 漢 🚜 \\x1b") == "é µ € 漢 🚜 \\x1b"
    assert printable(printable(EVIL)) == printable(EVIL) == SHOWN


def test_errors() -> None:
    """The message is for people, the attributes are the facts."""
    error = MachineFileError(EVIL, EVIL, EVIL)
    assert str(error) == f"{SHOWN}: {SHOWN}; {SHOWN}"
    assert error.part == EVIL
    with pytest.raises(MachineFileError) as caught:
        raise_together([error, ArmDesignError("b", "c")])
    assert str(caught.value) == f"{SHOWN}: {SHOWN}; {SHOWN}; also: b: c"


def test_the_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    show([EVIL, Sheet(title=EVIL, columns=(EVIL, "b [mm]"), rows=((EVIL, EVIL),), note=EVIL)])
    tell(EVIL)
    out = capsys.readouterr().out
    assert not controls(out)
    assert "".join(out.split()).count("".join(SHOWN.split())) == 6  # the table's, not wrapped, too
    assert out.count("[red]r[/red]") >= 5


@given(
    st.lists(
        st.tuples(
            st.text("ab._é漢", min_size=1, max_size=60),
            st.floats(-1e6, 1e6).map("{:.6g}".format),
            st.lists(st.text("cd", min_size=1, max_size=15), max_size=12).map(" ".join),
            st.integers(0, 9999).map(str),
        ),
        min_size=1,
        max_size=4,
    ),
    st.integers(20, 150),
)
def test_numbers_stay_whole_in_narrow_terminals(rows: list[tuple[str, ...]], room: int) -> None:
    """They were cut to "-…" where words beside them are long: words wrap, numbers never do."""
    sheet = Sheet(title="", columns=("key", "change [mHz]", "where", "count of it"), rows=(*rows,))
    console = Console(width=room, file=io.StringIO(), legacy_windows=False)
    console.print(terminal_table(sheet, room), crop=False)
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    least = 2 * LEAST + max(len("change"), *(len(row[1]) for row in rows)) + len("count") + 3 * 2
    assert max(map(cell_len, lines)) <= max(room, least + 2)
    shown = "".join(lines)
    assert "…" not in shown
    for number in (cell for row in rows for cell in row[1::2]):
        assert re.search(rf"(?<= ){re.escape(number)}(?= )", shown)
    everything = "".join(cell for row in (sheet.columns, *rows) for cell in row)
    for letter in "ab._é漢cd":  # none is lost
        assert shown.count(letter) == everything.count(letter)


def test_the_page() -> None:
    sheet = Sheet(title=EVIL, columns=(EVIL,), rows=((EVIL,),), note=EVIL)
    section = ReportSection(title=EVIL, words=(EVIL,), sheets=(sheet,))
    headline = (HeadlineNumber(name=EVIL, value=EVIL, words=EVIL),)
    report = Report(title=EVIL, lead=EVIL, headline=headline, sections=(section,))
    text = page(Report.of_text(report.text()), Path())
    assert not controls(text)
    # head, heading, lead, three of the headline, two of the section, and the sheet's, whose
    # title is its label too
    assert text.count(SHOWN) == 3 + 3 + 2 + 5


@pytest.mark.parametrize(
    "command", ["check", "map", pytest.param("compare", marks=pytest.mark.slow)]
)
def test_commands(
    command: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = {
        "check": ["--out", str(tmp_path / "b")],
        "map": ["--out", str(tmp_path / "a")],
        "compare": ["paper_1dof", "--out", str(tmp_path)],
    }
    drawn: list[Any] = []
    real = plots.save
    monkeypatch.setattr(plots, "save", lambda fig, path: drawn.append(fig) or real(fig, path))
    assert main([command, titled(tmp_path), *words[command], "--points", "5"], monkeypatch) == 0
    out, err = capsys.readouterr()
    assert not controls(out)
    assert err == ""
    assert r"\x1b]0;x" in out
    for text in (text for fig in drawn for text in fig.findobj(Text)):
        assert not controls(text.get_text())
    titles = [ax.get_title() for fig in drawn for ax in fig.axes]
    assert command != "map" or any(SHOWN in title for title in titles)


@pytest.mark.parametrize(
    "words",
    [
        [EVIL],
        ["map", EVIL],
        ["map", f"{EVIL}.toml"],
        ["map", "paper_1dof", f"--{EVIL}"],
        ["map", "paper_1dof", EVIL],
        ["map", "paper_1dof", "--points", EVIL],
        ["map", "paper_1dof", "--units", EVIL],
        ["map", "paper_1dof", "--out", f"/proc/{EVIL}"],
        ["optimize", "paper_1dof", "--points", "3", "--least", EVIL, "--frequency", "1"],
        ["optimize", "paper_1dof", "--points", "3", "--vary", EVIL],
        ["optimize", "paper_1dof", "--points", "3", "--catalogue", EVIL],
        ["optimize", "paper_1dof", "--points", "3", "--catalogue", f"{EVIL}.csv"],
        ["pareto", "paper_1dof", "--points", "3", "--against", EVIL],
        ["pareto", "paper_1dof", "--points", "3", "--values", EVIL],
        ["new", EVIL],
        ["map", "\udc9b\udcff.toml"],
    ],
    ids=lambda words: " ".join(word for word in words if word.isascii() and word.isprintable()),
)
def test_arguments(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words, monkeypatch) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert_one_line(err, "")
    assert not controls(err)


def test_keys_of_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = Path(titled(tmp_path))
    path.write_text(
        '"\\u001b[2J\\u009b" = 1\n' + path.read_text(encoding="utf-8"), encoding="utf-8"
    )
    for command in ("map", "check"):
        assert main([command, str(path)], monkeypatch) == 2
        err = capsys.readouterr().err
        assert not controls(err)
        assert r"own.toml: \x1b[2J\x9b: unknown key" in err


def _with_joint(name: str, folder: Path) -> ad.Machine:
    """The paper's machine, its joint and its title of this name."""
    machine = machines.named("paper_1dof")
    urdf = machine.urdf_text.replace('joint name="boom"', f'joint name="{name}"')
    written = name.replace("\x9b", "\\u009b").replace("\u202e", "\\u202e")
    text = machine.text.replace('joints = ["boom"]', f'joints = ["{written}"]')
    text = text.replace('title  = "One-joint mechanism of the paper"', f'title = "{written}"')
    assert text.count(written) == 2
    return ad.Machine.from_text(text, urdf, folder / "own.toml")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", ["$a_{$", "$$", "挖掘机"])
def test_a_drawing_takes_every_name(name: str, tmp_path: Path) -> None:
    """A formula that cannot be drawn, an empty one, a script that the font lacks."""
    drawn = _with_joint(name, tmp_path).plot()
    assert any(name in text.get_text() for text in drawn.texts)
    plots.save(drawn.figure, tmp_path / "machine.png")


def test_no_table_turns_the_direction_of_writing(tmp_path: Path) -> None:
    machine = _with_joint("\u202e\u200fx", tmp_path)
    write_csv({machine.joints[0]: np.zeros(2), "b": np.array(["\u061cy"] * 2)}, tmp_path / "a.csv")
    text = (tmp_path / "a.csv").read_text(encoding="utf-8")
    assert text.splitlines() == [r"\u202e\u200fx,b", *[r"0,\u061cy"] * 2]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["bo_om^2", "$x", "$a_{$", "a$b$c", "[red]x[/red]", "x\x9by"])
def test_names_of_joints_are_no_formulas(name: str, tmp_path: Path) -> None:
    """XML holds C1 characters; `$a_{$` is a formula that cannot be drawn."""
    named = _with_joint(name, tmp_path)
    frequencies = ad.frequency_map(named, ad.Workspace.grid(named, 5))
    for drawn in (frequencies.plot(), plots.holding_pressure(frequencies)):
        drawn.figure.savefig(tmp_path / "a.png")
        assert printable(name) in drawn.xaxis.label.get_text()
    plots.save(
        plots.moment_arm_curves({name: frequencies.machine, "b": frequencies.machine}),
        tmp_path / "b.png",
    )


def test_powers_of_ten_on_an_axis_stay_formulas(tmp_path: Path) -> None:
    fig, (ax,) = plots.figure()
    ax.semilogy([1, 2], [1, 1000])
    ax.set(title="a $b$")
    plots.save(fig, tmp_path / "a.png")
    assert any(
        label.get_parse_math() and "10^" in label.get_text() for label in ax.get_yticklabels()
    )
    assert not ax.title.get_parse_math()


# --------------------------------------------------------------------------------- how many joints


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "words"), [("paper_1dof", "over the joint"), ("excavator_20t", "over two joints")]
)
def test_a_caption_says_what_is_drawn(name: str, words: str, tmp_path: Path) -> None:
    from armdesign.output import write_design

    machine = machines.named(name)
    workspace = ad.Workspace.grid(machine, 3)
    captions = [
        caption for caption, _ in write_design(ad.size_cylinders(machine, workspace), tmp_path)
    ]
    assert next(caption for caption in captions if "joint" in caption).endswith(words)


@pytest.mark.parametrize(("links", "words"), [(2, "all loads"), (3, "all other joints and loads")])
def test_a_title_counts_the_joints_that_are_not_drawn(links: int, words: str) -> None:
    """Two are drawn."""
    machine = ad.Machine.from_text(template.new("x", links=links), "", Path("x.toml"))
    frequencies = ad.frequency_map(machine, ad.Workspace.grid(machine, 3))
    assert frequencies.plot().get_title() == f"lowest over {words}"
    assert plots.holding_pressure(frequencies).get_title() == f"largest over {words}"


def test_a_long_word_is_folded_and_numbers_stay_whole(capsys: pytest.CaptureFixture[str]) -> None:
    path, number = "spring." + 90 * "s" + ".stiffness_N_m_per_rad", "1.302e+06 … 1.591e+06"
    columns = ("key path", "within")
    show([Sheet(title="", columns=columns, words=("key path",), rows=((path, number),))])
    printed = capsys.readouterr().out
    assert number in printed
    assert path in "".join(printed.replace(number, "").split())


def test_a_pose_in_words_has_the_units_of_a_workshop_or_si() -> None:
    machine = machines.named("paper_1dof")
    assert pose_text(machine, np.array([-10 * deg]), SI) == "boom -0.1745 rad"
    assert pose_text(machine, np.array([-10 * deg])) == "boom -10.0°"
