"""Every study answers its question, and the answer in its docstring is what it finds."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest

STUDIES = Path(__file__).parents[1] / "studies"


def study(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"study_{name[:2]}", STUDIES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_baseline_map_finds_its_headline() -> None:
    module = study("01_baseline_map")
    headline = float(re.search(r"At ([\d.]+) Hz", module.__doc__ or "").group(1))  # type: ignore[union-attr]
    worst = module.run(fast=True).worst
    assert worst.frequency == pytest.approx(headline, abs=5e-4)  # the printed digits; refined off any grid
    assert worst.cylinder == "boom"


def test_pins_and_areas_finds_its_headline() -> None:
    module = study("04_pins_and_areas")
    printed = [float(n) / 100 for n in re.findall(r"\+([\d.]+) %", module.__doc__ or "")]
    gains = module.run(fast=True)[0]["gain"]
    # printed without decimals; the coarse grid of the fast run and rounding to 0.1 mm cost up to a per cent
    assert gains[["sizes", "pins", "both"]].to_list() == pytest.approx(printed, abs=0.015)


@pytest.mark.parametrize("path", sorted(STUDIES.glob("*.py")), ids=lambda p: p.stem)
def test_study_is_short_and_asks_one_question(path: Path) -> None:
    lines = path.read_text(encoding="utf-8").splitlines()
    assert len(lines) < 80
    assert lines[0].startswith('"""')
    assert lines[0].endswith("?")
