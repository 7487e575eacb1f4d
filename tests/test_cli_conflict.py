"""Conflicts on the command line: what a refusal asks for is given by ``--set``, word for word."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from tests.commands import ARMDESIGN, assert_one_line, main

SETTING = re.compile(r"requirements\.([a-z_]+(?:\.\w+)?) = ([\d.e+-]*\d)")

OPTION = re.compile(r"--set requirements\.(\S+)=(\S+)")  # below the table where there are many


def of(folder: Path, *words: str, set_to: dict[str, str]) -> tuple[int, str]:
    """Exit code and what is written to the terminal under other requirements."""
    options = [
        w for key, value in set_to.items() for w in ("--set", f"requirements.{key}={value}")
    ]
    run = subprocess.run(
        [*ARMDESIGN, *words, *options], cwd=folder, capture_output=True, text=True, check=False
    )
    return run.returncode, run.stdout + run.stderr


@pytest.fixture(scope="module")
def boomer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a new machine of two links."""
    folder = tmp_path_factory.mktemp("new") / "boomer"
    with pytest.MonkeyPatch.context() as patch:
        assert main(["new", "boomer", "--links", "2", "--out", str(folder)], patch) == 0
    return folder


@pytest.mark.parametrize("key", ["lift_share", "holding_share", "buckling_share"])
def test_a_share_that_a_file_states_for_all_is_set_for_one_actuator(
    key: str, boomer: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The file may state one number, or none: the other actuators keep what held before."""
    monkeypatch.chdir(boomer)
    words = ["check", "boomer.toml", "--quiet", "--set", f"requirements.{key}.boom=0.5"]
    assert main(words, monkeypatch) == 0, capsys.readouterr().err


def test_a_share_for_all_alone_or_for_nobody_is_refused(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for word, message in (
        ("requirements.oil_total_share.boom=1", "the machine file has no such number"),
        ("requirements.lift_share.nobody=0.8", 'no actuator "nobody"; choose from: boom'),
    ):
        assert main(["check", "excavator_20t", "--set", word], monkeypatch) == 2
        assert_one_line(capsys.readouterr().err, message)


@pytest.mark.slow
@pytest.mark.parametrize(
    "requirements",
    [
        {"moment_arm_share": "1.1", "pin_box_mm": "20"},
        # oil of the boom is asked for, and later again as enough: what was asked stays asked
        {"lift_share": "1.2", "oil_each_share": "0.8"},
    ],
)
def test_what_a_refusal_asks_for_gives_a_design(
    requirements: dict[str, str], boomer: Path, tmp_path: Path
) -> None:
    words = ("optimize", str(boomer / "boomer.toml"), "--points", "4", "--starts", "1", "--quiet")
    code, refusal = of(tmp_path, *words, set_to=requirements)
    line = refusal.splitlines()[0]
    assert code == 2, refusal
    assert "; relax " in line, refusal
    settings = dict(SETTING.findall(line.partition("; relax ")[2]) or OPTION.findall(refusal))
    assert settings
    code, text = of(tmp_path, *words, set_to=requirements | settings)
    assert code == 0, text
