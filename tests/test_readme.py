"""The README does what it says: its Python block runs, its figures are today's."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, flags=re.S)


@pytest.mark.slow
def test_python_blocks_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert blocks("python")
    names: dict[str, object] = {}
    for block in blocks("python"):
        exec(compile(block, "README.md", "exec"), names)
    printed = capsys.readouterr().out
    for expected in re.findall(r"# → (.*)", "".join(blocks("python"))):
        assert expected in printed


def test_two_commands_do_all_the_set_up() -> None:
    commands = [line for block in blocks("sh") for line in block.splitlines() if "-m venv" in line]
    assert len(commands) == 2
    assert "armdesign design excavator_20t" in commands[0]
    assert "pytest" in commands[1]


def test_files_it_names_exist() -> None:
    root = Path(__file__).parents[1]
    for name in re.findall(r"\]\(((?!http)[^)#]+)\)", README):
        assert (root / name).exists(), name
