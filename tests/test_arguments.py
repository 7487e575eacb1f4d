"""Arguments of public functions: whatever is of a wrong type is refused in one line."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypedDict, Unpack

import numpy as np
import pytest

import armdesign as ad
from armdesign.arguments import checked, with_options
from tests import machines

ONE = machines.named("paper_1dof")
HERE = [0.0]
HUGE = 10**400
TIME = np.arange(0.0, 10.0, 0.01)
GOOD = {  # what a function cannot do without, by name
    "machine": ONE,
    "workspace": ad.Workspace.grid(ONE, points=3),
    "q": HERE,
    "start": HERE,
    "end": [0.3],
    "command": {"lift": 0.1},
    "duration": 0.1,
    "frequency": 1.0,
    "changes": {"cylinder.lift.bore_mm": 100},
    "measured": "measured.csv",
    "fit": ["fluid.bulk_modulus_MPa"],
    "path": "x.csv",
    "time": TIME,
    "excitation": np.sin(TIME),
    "response": np.cos(TIME),
    "band": (1.0, 3.0),
    "segment": 2.0,
    "urdf": ad.load("excavator_20t").urdf_text,
    "cylinders": {},
}
DOORS = {
    name: getattr(ad, name) for name in ad.__all__ if inspect.isfunction(getattr(ad, name))
} | {"Workspace.grid": ad.Workspace.grid, "Machine.from_urdf": ad.Machine.from_urdf}
ARGUMENTS = [
    (door, parameter.name)
    for door, function in DOORS.items()
    for parameter in inspect.signature(function).parameters.values()
    if parameter.annotation not in ("bool", "bool | None")  # whatever is true or not
    and parameter.name not in ("part", "seed")  # a name in messages; asked for by some tasks only
]


def refusal(function: Any, name: str, value: object) -> str:
    """What the function says of this value, all that it cannot do without being right."""
    parameters = inspect.signature(function).parameters.values()
    needed = [p.name for p in parameters if p.default is p.empty]
    with pytest.raises(ad.ArmDesignError) as refused:
        function(**{key: GOOD.get(key) for key in needed} | {name: value})
    text = str(refused.value)
    assert "\n" not in text
    assert len(text) < 400
    return text


@pytest.mark.parametrize(("door", "name"), ARGUMENTS)
def test_a_wrong_type_is_refused(
    door: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An object that is nothing, and what no argument can be: lists of such objects."""
    monkeypatch.chdir(tmp_path)
    refusal(DOORS[door], name, object())
    refusal(DOORS[door], name, [object()])


@pytest.mark.parametrize("door", ["sweep", "optimize", "frequency_map", "linearize", "plan_move"])
def test_the_line_says_what_to_give(door: str) -> None:
    assert refusal(DOORS[door], "machine", 5) in (
        'machine: 5 is not allowed; give a Machine (as ad.load("excavator_20t"))',
        'machine: 5 is not allowed; give a Machine (as ad.load("excavator_20t")) or a text or a'
        ' path or a list, each a Machine (as ad.load("excavator_20t")) or a text or a path',
    )


@pytest.mark.parametrize(
    "call",
    [
        lambda: ONE.with_payload(HUGE),
        lambda: ONE.at([[HUGE]]),
        lambda: ad.Bands(structure=(0.0, HUGE)),
        lambda: ad.bandwidth_map(ONE, GOOD["workspace"], damping=HUGE),
        lambda: ad.pareto(ONE, GOOD["workspace"], values=[HUGE]),
        lambda: ad.sweep(ONE, points=3, workers=HUGE),
    ],
)
def test_a_whole_number_that_is_no_float_is_refused(call: Callable[[], object]) -> None:
    with pytest.raises(ad.ArmDesignError, match="is not a") as refused:
        call()
    assert len(str(refused.value)) < 200


@pytest.mark.parametrize("count", [-1, 0, 10**6, HUGE])
def test_starts_and_workers_that_keep_a_computer_busy_are_refused(count: int) -> None:
    """Some were taken for one; a million workers ended in an error of the pool's files."""
    doors = (("workers", ad.validate), ("workers", ad.optimize), ("starts", ad.optimize))
    for name, door in doors:
        with pytest.raises(ad.ArmDesignError, match=rf"^{name}: .* give a whole number from 1 to"):
            door(ONE, **{name: count})


@pytest.mark.parametrize("door", ["frequency_map", "optimize", "bandwidth_map", "sweep"])
def test_a_workspace_of_another_machine_is_refused(door: str) -> None:
    other = ad.Workspace.grid(machines.named("excavator_20t"), points=2)
    words = "its poses are of boom, stick, bucket of excavator_20t, paper_1dof has boom; make one"
    with pytest.raises(ad.ArmDesignError, match=f"^workspace: {words}"):
        getattr(ad, door)(machines.named("paper_1dof"), workspace=other)


def test_numbers_of_all_libraries_are_numbers() -> None:
    """The argument that is at fault is found among those that are not."""

    @checked
    def failing(number: float, count: int, several: list[float], pair: tuple[int, int]) -> None:
        raise TypeError("of something else")

    array = np.array([1.0, 2.0])
    for number, count, pair in ((1, 2, (1, 2)), (np.float32(1), np.int64(2), [1, 2])):
        with pytest.raises(TypeError, match="of something else"):
            failing(number, count, array, pair)  # type: ignore[arg-type]
    with pytest.raises(ad.ArmDesignError, match=r"^pair: "):
        failing(1.0, 2, [], (1, 2, 3))  # type: ignore[arg-type]


def test_a_wrong_call_is_pythons_own_error() -> None:
    with pytest.raises(TypeError, match=r"least\(\) missing 1 required keyword-only argument"):
        ad.least(ONE)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match=r"got an unexpected keyword argument 'x'"):
        ad.frequency_map(ONE, x=1)  # type: ignore[call-arg]


@pytest.mark.parametrize("door", ["optimize", "size_cylinders", "least", "pareto", "steps"])
def test_a_requirement_by_keyword_is_told_how_it_is_given(door: str) -> None:
    with pytest.raises(ad.ArmDesignError) as refused:
        DOORS[door](ONE, lift_share=0.9)
    assert str(refused.value) == (
        f"lift_share: is no argument of {door}; a requirement is given by"
        " requirements=ad.Requirements.of(machine, lift_share=0.9);"
        f" help(ad.{door}) lists the arguments"
    )


@pytest.mark.parametrize("door", ["optimize", "least", "pareto", "size_cylinders", "steps"])
def test_a_keyword_like_an_argument_may_be_either(door: str) -> None:
    """Some are like an argument, as ``speeds`` is like ``seed``."""
    with pytest.raises(ad.ArmDesignError) as refused:
        DOORS[door](ONE, catalog="iso")
    assert str(refused.value) == (
        f'catalog: is no argument of {door}; did you mean "catalogue"? A requirement is given by'
        " requirements=ad.Requirements.of(machine, catalog='iso');"
        f" help(ad.{door}) lists the arguments"
    )


@pytest.mark.parametrize(
    ("door", "meant", "wrong"),
    [
        ("simulate", "velocity", "velocities"),
        ("plan_move", "shaper", "shapers"),
        ("sweep", "workers", "worker"),
        ("Machine.from_urdf", "payloads", "payload"),
    ],
)
def test_an_unknown_option_is_told_the_nearest(door: str, meant: str, wrong: str) -> None:
    """Options that functions share are judged as if they stood in the signature."""
    function = DOORS[door]
    text = refusal(function, wrong, None)
    assert text == f'{wrong}: is no argument of {function.__name__}; did you mean "{meant}"?'
    assert "choose from: " in refusal(function, "xyz", None)


@pytest.mark.parametrize(
    ("left_out", "words"),
    [
        (("density",), "missing 1 required keyword-only argument: 'density'"),
        (("leakage", "density"), "2 required keyword-only arguments: 'leakage' and 'density'"),
        (("area", "leakage", "density"), "arguments: 'area', 'leakage', and 'density'"),
    ],
)
def test_a_missing_option_is_pythons_own_error(left_out: tuple[str, ...], words: str) -> None:
    function = ad.formulas.transfer_function
    given = dict.fromkeys(inspect.signature(function).parameters, 1.0)
    function(**given)
    with pytest.raises(TypeError, match=f"^transfer_function.*{words}$"):
        function(**{name: x for name, x in given.items() if name not in left_out})


def test_options_stand_in_the_signature() -> None:
    """With their types and defaults, as in a function that spells them out."""

    class Options(TypedDict, total=False):
        number: int
        word: str | None

    @checked
    @with_options(Options, {"number": 3, "word": None})
    def function(one: float, *, two: float = 2.0, **options: Unpack[Options]) -> Any:
        return one, two, options

    def spelled(
        one: float, *, two: float = 2.0, number: int = 3, word: str | None = None
    ) -> Any: ...

    assert inspect.signature(function) == inspect.signature(spelled)
    assert function(1.0, word="a") == (1.0, 2.0, {"number": 3, "word": "a"})
    with pytest.raises(ad.ArmDesignError, match=r"^numbr: .*did you mean \"number\"\?$"):
        function(1.0, numbr=2)  # type: ignore[call-arg]
    with pytest.raises(TypeError, match=r"missing 1 required positional argument: 'one'"):
        function(number=2)  # type: ignore[call-arg]


def test_conditions_of_a_run_are_fields_of_its_case() -> None:
    fields = {f.name: (f.type, f.default) for f in dataclasses.fields(ad.SimulationCase)}
    options = inspect.signature(ad.simulate).parameters.values()
    assert fields == {
        p.name: (p.annotation, dataclasses.MISSING if p.default is p.empty else p.default)
        for p in options
        if p.name != "tolerance"
    }
