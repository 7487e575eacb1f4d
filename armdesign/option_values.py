"""Values of options: poses, load cases, spans, priors and sizes as words of the command line."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import TYPE_CHECKING, Any, get_args

from armdesign.errors import ArmDesignError, choose

if TYPE_CHECKING:
    from armdesign.arrays import Array
    from armdesign.design.catalogue.sizes import Sizes
    from armdesign.frequency.bands import Bands
    from armdesign.machine.machine import Machine


NUMBER = "is no number; give it with a decimal point and without a unit, as 8.5"
NUMBERS = {  # as versions of typer call them
    "integer": "is no whole number; give one, as 3",
    "number": NUMBER,
    "float": NUMBER,
}


def refuse_empty(words: Sequence[str]) -> None:
    """Raise where a word of the command line is empty, as an unset variable of a shell is."""
    for before, word in pairwise(["armdesign", *words]):
        option, equals, value = word.partition("=")
        if not word or (option.startswith("--") and equals and not value):
            fault, remedy = "is followed by an empty word", "give a value, or leave it out"
            raise ArmDesignError(option or before, fault, remedy)


def plainly(error: Any, words: Sequence[str]) -> str:
    """What typer says of words of the command line, with the one that is wrong and a remedy."""
    message = str(error.format_message()).replace("Value error, ", "")
    if message.startswith("Missing") and error.ctx is not None:
        return f"{message.removesuffix('.')}; see {error.ctx.command_path} --help"
    kind = next((kind for kind in NUMBERS if f"valid {kind}" in message), None)
    if kind is None:
        return message
    names, typed = error.param.opts, ""
    for before, word in pairwise(["", *words]):
        option, equals, value = word.partition("=")
        typed = word if before in names else value if equals and option in names else typed
    return f'{names[0]}: "{typed}" {NUMBERS[kind]}'


def option_name(annotation: Any) -> str | None:
    """Name of an option, as ``--points``, by its parameter's annotation; None of an argument."""
    (info,) = get_args(annotation)[1:]
    names = map(str, (info.default, *(info.param_decls or ())))  # typer takes the first for it
    return next((name.partition("/")[0] for name in names if name.startswith("--")), None)


@contextmanager
def naming_options(names: Mapping[str, str]) -> Iterator[None]:
    """An error that blames an argument of a function names the option that was typed for it.

    Args:
        names: of the options on the command line, by their arguments.
    """
    try:
        yield
    except ArmDesignError as error:
        argument, *more = error.part.split(" ", 1)
        if argument in names:
            error.part = " ".join([names[argument], *more])
            error.tell_line(error.line)
        raise


def within(option: str, low: int, high: int | None = None) -> Callable[[int | None], int | None]:
    """Checks the whole number of an option: from ``low`` to ``high``, if there is one."""

    def checked(value: int | None) -> int | None:
        if value is not None and not low <= value <= (value if high is None else high):
            ends = f"of {low} or more" if high is None else f"from {low} to {high}"
            fault, remedy = f"{value} is not allowed", f"give a whole number {ends}"
            raise ArmDesignError(option, fault, remedy)
        return value

    return checked


def grid_points(points: str) -> int | list[int] | None:
    """Value of ``--points``."""
    try:
        counts = [int(word) for word in points.split(",")] if points else None
    except ValueError:
        fault = f'"{points}" is not a list of numbers'
        raise ArmDesignError("--points", fault, "give 21 or 21,21,61") from None
    return counts[0] if counts and len(counts) == 1 else counts


def pose_of(
    machine: Machine, text: str, option: str, last: Sequence[float] = ()
) -> tuple[float, ...]:
    """Joint positions (nq,) [rad, m] as ``boom=-20,stick=-90`` or in order, in deg and mm.

    Joints without ends may go a turn beyond their range. ``last``: positions of joints that are
    not named, if there are any.
    """
    joints = {joint.name: joint for joint in machine.arm.joints}
    units = {name: joint.file_unit for name, joint in joints.items()}
    remedy = f"give {','.join(f'{name}=… {unit}' for name, (unit, _) in units.items())}"
    pose = dict(zip(joints, last, strict=False))
    for name, number in _named(text, list(joints), option, remedy).items():
        try:
            pose[name] = float(number) * units[name][1]
        except ValueError:
            fault = f'"{number}" is no position of {name}'
            raise ArmDesignError(option, fault, remedy) from None
    if missing := [name for name in joints if name not in pose]:
        raise ArmDesignError(option, f"says nothing of {' and '.join(missing)}", remedy)
    for (name, joint), limits in zip(joints.items(), machine.known_ranges.tolist(), strict=True):
        further = 2 * math.pi * joint.without_ends  # a turn more, to go the short way
        low, high = limits[0] - further, limits[1] + further
        if not low <= (value := pose[name]) <= high:
            unit, factor = units[name]
            ends = math.ceil(10 * low / factor) / 10, math.floor(10 * high / factor) / 10
            nearest = f"the nearest within it is {ends[value > high]:g} {unit}"
            fault = f"{name} {value / factor:g} {unit} is outside its range"
            fault += f" [{ends[0]:g}, {ends[1]:g}] {unit}"
            remedy = f"give {name}=… in {unit}" if math.isnan(value) else nearest
            raise ArmDesignError(option, fault, remedy)
    return tuple(pose[name] for name in joints)


def _named(text: str, joints: Sequence[str], option: str, remedy: str) -> dict[str, str]:
    """Positions as they are written, by the names of their joints."""
    words = [word for word in listed(text) if word]
    named = [word.partition("=")[::2] for word in words if "=" in word]
    if not named and len(words) == len(joints):
        return dict(zip(joints, words, strict=True))
    if len(named) < len(words) or not words:
        fault = f'"{text}" is not one position per joint'
        raise ArmDesignError(option, fault, remedy)
    positions = dict[str, str]()
    for name, number in ((name.strip(), number) for name, number in named):
        if name not in joints:
            fault = f'there is no joint "{name}" in the pose'
            raise ArmDesignError(option, fault, choose(name, joints))
        if name in positions:
            raise ArmDesignError(option, f"names {name} twice", "give one position of each joint")
        positions[name] = number
    return positions


def drawn_pose(machine: Machine, text: str) -> Array:
    """Joint positions (nq,) [rad, m] of ``--pose``; joints that it does not name stand mid way."""
    import numpy as np

    from armdesign.drawing.joint_arcs import middle_pose

    middle = middle_pose(machine)
    return np.array(pose_of(machine, text, "--pose", middle.tolist())) if text else middle


def loaded(machine: Machine, text: str) -> Machine:
    """The machine under the load case of ``--payload``, its own without one."""
    load_case = payload_of(text)
    return machine if load_case is None else machine.with_payload(load_case)


def payload_of(text: str) -> str | float | None:
    """Value of ``--payload``: a mass [kg], or the name of a load case."""
    try:
        return float(text) if text else None
    except ValueError:
        return text


def spans(text: str, option: str) -> list[tuple[float, float]]:
    """Pairs of numbers as ``1.9:4.5,4:7``."""
    pairs = []
    for word in listed(text):
        try:
            low, high = map(float, word.split(":"))
        except ValueError:
            raise ArmDesignError(option, f'"{word}" is no span', "give it as 1.9:4.5") from None
        pairs.append((low, high))
    return pairs


def listed(text: str) -> tuple[str, ...]:
    """Words of an option that are separated by commas."""
    return tuple(word.strip() for word in text.split(",") if word.strip())


def stated_priors(text: str) -> dict[str, tuple[float, float]]:
    """Value of ``--prior``: value and standard deviation by key path."""
    priors = {}
    for word in listed(text):
        path, _, numbers = word.partition("=")
        try:
            value, deviation = (float(number) for number in numbers.split(":"))
        except ValueError:
            remedy = "give PATH=VALUE:DEVIATION, as fluid.bulk_modulus_MPa=1200:240"
            raise ArmDesignError("--prior", f'"{word}" is not understood', remedy) from None
        if path.strip() in priors:
            raise ArmDesignError("--prior", f"{path.strip()} is there twice", "leave one out")
        priors[path.strip()] = value, deviation
    return priors


def offered_sizes(catalogue: str, free: bool) -> str | Sizes | None:
    """Sizes that ``--catalogue`` and ``--free`` ask for; None for the machine file's."""
    from armdesign.design.catalogue.sizes import FREE, read_sizes

    if free:
        if catalogue:
            raise ArmDesignError("--free", "contradicts --catalogue", "give one of them")
        return FREE
    return read_sizes(catalogue) if catalogue.lower().endswith(".csv") else catalogue or None


def bands_to_use(nominal: bool) -> Bands | None:
    """None for the machine file's bands; no bands if ``--nominal`` is given."""
    from armdesign.frequency.bands import Bands

    return Bands() if nominal else None
