"""Public names: what tutorials need and what it answers with is public, the rest is not."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import armdesign as ad
from tests.pages import PAGES, ROOT

LISTS = ("docs/api.md", "docs/changelog.md", "docs/house.md")  # name all, and show none


def shown() -> str:
    """What users read: pages, the notebook's cells, studies."""
    pages = [path for path in PAGES if str(path.relative_to(ROOT)) not in LISTS]
    texts = [path.read_text("utf-8") for path in [*pages, *(ROOT / "studies").glob("*.py")]]
    for notebook in (ROOT / "docs").glob("*.ipynb"):
        cells = json.loads(notebook.read_text("utf-8"))["cells"]
        texts += ["".join(cell["source"]) for cell in cells]
    return "\n".join(texts)


SHOWN = set(re.findall(r"\bad\.(\w+)", shown()))


def annotations(public: Any) -> Iterator[str]:
    """What a public name answers with, and what its fields hold."""
    if inspect.isfunction(public):
        yield str(public.__annotations__["return"])
    elif inspect.isclass(public):
        yield from map(str, vars(public).get("__annotations__", {}).values())
        for member in vars(public).values():
            function = getattr(member, "fget", getattr(member, "func", member))
            function = getattr(function, "__func__", function)
            yield str(getattr(function, "__annotations__", {}).get("return", ""))


def answers() -> set[str]:
    """Names that others than themselves answer with."""
    return {
        word
        for name in ad.__all__
        for text in annotations(getattr(ad, name))
        for word in re.findall(r"\w+", text)
        if word != name
    }


ANSWERS = answers()


@pytest.mark.parametrize("name", ad.__all__)
def test_it_is_shown_to_users_or_answers_them(name: str) -> None:
    if inspect.isclass(getattr(ad, name)):
        assert name in SHOWN | ANSWERS
    else:
        assert name in SHOWN


def test_what_is_shown_is_public() -> None:
    assert set(ad.__all__) | {"__version__"} >= SHOWN


# What is given, not answered; and numbers that are told, not drawn.
GIVEN = {"Bands", "Requirements", "SimulationCase", "Step", "SweptSine", "Table", "Workspace"}
TOLD = {"ArmDesignError", "InfeasibleError", "WorstPose", "Controller"}
CLASSES = {name for name in ad.__all__ if inspect.isclass(getattr(ad, name))}


@pytest.mark.parametrize("name", sorted(CLASSES - GIVEN - TOLD))
def test_every_result_draws_itself(name: str) -> None:
    """Without being told anything more."""
    inspect.signature(getattr(ad, name).plot).bind(None)


def written_to(value: Any, path: str, seen: set[int]) -> Iterator[str]:
    """Paths of arrays that can be written to, in a result of the package and all that it holds."""
    if id(value) in seen:
        return
    seen.add(id(value))
    if isinstance(value, np.ndarray):
        if value.flags.writeable:
            yield path
    elif isinstance(value, tuple | list):
        for one in value:
            yield from written_to(one, f"{path}[]", seen)
    elif isinstance(value, dict):
        for one in value.values():
            yield from written_to(one, f"{path}{{}}", seen)
    elif type(value).__module__.startswith("armdesign."):
        for name, held in tuple(vars(value).items()):
            if not name.startswith("_"):
                yield from written_to(held, f"{path}.{name}", seen)


def test_arrays_of_machines_maps_and_charts_are_read_only() -> None:
    """Written to by mistake, as for other units, they would change later answers."""
    machine = ad.load("excavator_20t")
    workspace = ad.Workspace.grid(machine, points=3)
    frequencies = ad.frequency_map(machine, workspace)
    poses = machine.at(machine.ranges.mean(axis=1))
    assert poses.stiffness_matrix.shape == (1, 3, 3)  # kept, as are other cached ones
    results = (frequencies, frequencies.reach_map(9), poses, ad.natural_modes(poses))
    for result in (*results, ad.lift_chart(machine), workspace.rigid):
        assert list(written_to(result, type(result).__name__, set())) == []


def test_arrays_of_users_stay_theirs_to_write_to() -> None:
    """They were locked in place: a reach plane with pitch limits failed on its own poses."""
    machine = ad.load("excavator_20t")
    q = machine.ranges.mean(axis=1)[None].copy()
    weights = np.array([0.4, 0.6])
    ad.Shaper(times=np.arange(2.0), amplitudes=weights, name="two", low=1, high=2)
    assert machine.arm.kinematics(q)
    assert machine.at(q)
    assert q.flags.writeable
    assert weights.flags.writeable
