"""Arguments of public functions: a wrong type is an error of one line that names it.

Options that several functions share are a ``TypedDict``, and ``with_options`` makes its keys
arguments of each function, as if they stood in its signature.
"""

from __future__ import annotations

import ast
import functools
import inspect
import numbers
import os
import reprlib
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, ParamSpec, TypeVar

from armdesign.errors import ArmDesignError, choose, nearest

P = ParamSpec("P")
R = TypeVar("R")

TYPES: dict[str, tuple[type | tuple[type, ...], str]] = {  # by name in annotations, and in words
    "None": (type(None), "None"),
    "bool": (object, "True or False"),  # whatever is true or not
    "int": (numbers.Integral, "a whole number"),
    "float": (numbers.Real, "a number"),
    "str": (str, "a text"),
    "Path": ((str, os.PathLike), "a path"),
    "Sequence": (Iterable, "a list"),  # arrays and series are none of Python's sequences
    "Iterable": (Iterable, "a list"),
    "tuple": (Iterable, "a tuple"),
    "Mapping": (Mapping, "a dict"),
    "Callable": (Callable, "a function"),  # type: ignore[dict-item]
}
MADE_BY = {  # classes of the package, which are known by their names
    "Machine": 'ad.load("excavator_20t")',
    "Workspace": "ad.Workspace.grid(machine)",
    "Requirements": "ad.Requirements(lift_share=0.95)",
    "Bands": "ad.Bands(structure=(0.0, 0.4))",
    "Poses": "machine.at(q)",
    "FrequencyMap": "ad.frequency_map(machine)",
    "BandwidthMap": "ad.bandwidth_map(machine)",
    "LiftChart": "ad.lift_chart(machine)",
    "Design": "ad.optimize(machine)",
    "SimulationCase": "ad.SimulationCase(machine, q, command, duration=1.0)",
    "Shaper": "ad.workspace_shaper(frequencies)",
    "RigidPoses": "machine.rigid_poses(q)",
    "DataFrame": 'pd.read_csv("measured.csv")',
    "Measured": "",
    "Recording": "",
}
MOST = {"workers": 256, "starts": 10_000}  # more keep a computer busy without an answer
LISTS = (list, tuple, str, dict)  # whose items may be looked at without using them up


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """The function, which fails on an argument of a wrong type in one line that names it.

    The function itself judges first, because it knows more of its values. If it ends in an error
    that is not the package's, an argument that its annotations do not allow is at fault; without
    such an argument the error stays as it is. Annotations that are neither a plain type nor a
    class of the package, as aliases and arrays, allow everything. An unknown keyword of a function
    that takes requirements is answered by the nearest argument, or by how a requirement is given.
    The function is given a workspace with the links of the machine beside it.

    Raises:
        ArmDesignError: from the function made, for an argument of another type, for keywords of
            ``MOST`` that are not from 1 to it, and for a workspace of a machine with other joints.
    """
    signature = inspect.signature(function)
    written = {n: p.annotation for n, p in signature.parameters.items() if p.annotation != p.empty}

    @functools.wraps(function)
    def judged(*words: P.args, **named: P.kwargs) -> R:
        _refuse_too_many(named)
        own: Any = _on_the_machine(list(signature.parameters), words, named)
        try:
            return function(*own[0], **own[1])
        except ArmDesignError:
            raise
        except Exception:
            try:
                given = signature.bind(*words, **named).arguments
            except TypeError:
                given = {}  # one is missing or unknown, as Python says
                if takes_requirements(signature):
                    refuse_unknown(named, signature, function.__name__)
            for name, kind in written.items():
                if name in given:
                    refuse_unless(name, given[name], kind)
            raise

    return judged


def _refuse_too_many(named: Mapping[str, Any]) -> None:
    for name, most in MOST.items():
        value = named.get(name, 1)
        if isinstance(value, numbers.Integral) and not 1 <= int(value) <= most:
            fault = f"{reprlib.repr(value)} is not allowed"
            raise ArmDesignError(name, fault, f"give a whole number from 1 to {most}")


def _is_a(value: Any, name: str) -> bool:
    """Whether a value is of a class of this name."""
    return any(of.__name__ == name for of in type(value).__mro__)


def _on_the_machine(
    names: list[str], words: tuple[Any, ...], named: dict[str, Any]
) -> tuple[tuple[Any, ...], dict[str, Any]]:
    """Arguments, in which a workspace has the links of the machine beside it.

    Raises:
        ArmDesignError: that machine has other joints.
    """
    given = dict(zip(names, words, strict=False)) | named
    workspace, machine = given.get("workspace"), given.get("machine")
    if not (_is_a(workspace, "Workspace") and _is_a(machine, "Machine")):
        return words, named
    own = workspace.on(machine)  # type: ignore[union-attr]
    if "workspace" in named:
        return words, named | {"workspace": own}
    at = names.index("workspace")
    return (*words[:at], own, *words[at + 1 :]), named


def with_options(
    options: type, defaults: Mapping[str, Any]
) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """A decorator of functions that end in ``**name: Unpack[options]``.

    The keys of the ``TypedDict`` are keyword arguments like all others: they stand in the
    signature, which ``help`` and the documentation show, and the function receives all of them.

    Args:
        options: the ``TypedDict``.
        defaults: of its keys; those without one must be given.

    Raises:
        ArmDesignError: from the function made, for an unknown keyword, with the nearest argument.
        TypeError: from the function made, for a missing one, in Python's words.
    """

    def decorated(function: Callable[P, R]) -> Callable[P, R]:
        signature = _spelled_out(inspect.signature(function), options, defaults)

        @functools.wraps(function)
        def complete(*words: P.args, **named: P.kwargs) -> R:
            refuse_unknown(named, signature, function.__name__)
            given = {**defaults, **named}
            if missing := [name for name in options.__annotations__ if name not in given]:
                _refuse_missing(missing, function.__qualname__)
            return function(*words, **given)

        complete.__signature__ = signature  # type: ignore[attr-defined]
        return complete

    return decorated


def _spelled_out(
    signature: inspect.Signature, options: type, defaults: Mapping[str, Any]
) -> inspect.Signature:
    """A signature with the keys of options in place of ``**``."""
    keys = [
        inspect.Parameter(
            name,
            inspect.Parameter.KEYWORD_ONLY,
            default=defaults.get(name, inspect.Parameter.empty),
            annotation=getattr(kind, "__forward_arg__", kind),  # as it is written
        )
        for name, kind in options.__annotations__.items()
    ]
    others = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
    return signature.replace(parameters=[*others, *keys])


def _refuse_missing(names: Sequence[str], door: str) -> None:
    """Raise for keywords that must be given, in the words of Python for those of a signature."""
    *others, last = map(repr, names)
    comma = "," if len(others) > 1 else ""
    said = f"{', '.join(others)}{comma} and {last}" if others else last
    arguments = "arguments" if others else "argument"
    raise TypeError(f"{door}() missing {len(names)} required keyword-only {arguments}: {said}")


def takes_requirements(signature: inspect.Signature) -> bool:
    """Whether an argument is the requirements of a design."""
    return any("Requirements" in str(one.annotation) for one in signature.parameters.values())


def refuse_unknown(named: Mapping[str, Any], signature: inspect.Signature, door: str) -> None:
    """Raise for a keyword that is none of the arguments: it may be meant as a requirement."""
    known = [name for name in signature.parameters if name != "cls"]
    for name in named:
        if name in known:
            continue
        remedy = choose(name, known)
        if takes_requirements(signature):
            said = f"requirements=ad.Requirements.of(machine, {name}={reprlib.repr(named[name])})"
            said = f"requirement is given by {said}; help(ad.{door}) lists the arguments"
            remedy = f"{remedy} A {said}" if nearest(name, known) else f"a {said}"
        raise ArmDesignError(name, f"is no argument of {door}", remedy) from None


def refuse_unless(name: str, value: Any, annotation: str) -> None:
    """Raise for the argument of this name if its annotation does not allow the value."""
    kind = ast.parse(annotation, mode="eval").body
    if not _fits(value, kind):
        remedy = f"give {' or '.join(dict.fromkeys(_in_words(kind)))}"
        raise ArmDesignError(name, f"{reprlib.repr(value)} is not allowed", remedy) from None


def refuse_unless_seed(seed: object) -> None:
    """Raise for what no random numbers can begin with."""
    whole = isinstance(seed, numbers.Integral) and not isinstance(seed, bool)
    if not (whole and seed >= 0):  # type: ignore[operator]
        raise ArmDesignError("seed", f"{seed!r} is not allowed", "give a whole number ≥ 0")


def _fits(value: Any, kind: ast.expr) -> bool:
    """Whether the value is of the type; items are looked at where that does not use them up."""
    match kind:
        case ast.BinOp(left=left, right=right):
            return _fits(value, left) or _fits(value, right)
        case ast.Constant(value=None):
            return value is None
        case ast.Name(id=name) if name in TYPES:
            if name in ("int", "float") and isinstance(value, bool):
                return False
            huge = isinstance(value, int) and abs(value) > sys.float_info.max  # is no float
            return isinstance(value, TYPES[name][0]) and not (huge and name == "float")
        case ast.Name(id=name) | ast.Attribute(attr=name) if name in MADE_BY:
            return _is_a(value, name)
        case ast.Subscript(value=ast.Name(id="Sequence" | "Iterable")) if isinstance(value, str):
            return False  # though it is a sequence of letters
        case ast.Subscript(value=of, slice=ast.Tuple(elts=[key, item])) if isinstance(value, dict):
            return _fits(value, of) and all(_fits(k, key) and _fits(value[k], item) for k in value)
        case ast.Subscript(value=of, slice=ast.Tuple(elts=items)) if isinstance(value, LISTS):
            same = _fits(value, of) and len(value) == len(items)
            return same and all(map(_fits, value, items))
        case ast.Subscript(value=of, slice=item) if isinstance(value, LISTS):
            return _fits(value, of) and all(_fits(one, item) for one in value)
        case ast.Subscript(value=of):
            return _fits(value, of)
    return True


def _in_words(kind: ast.expr) -> list[str]:
    """What the type allows, in words for each of its alternatives."""
    match kind:
        case ast.BinOp(left=left, right=right):
            return _in_words(left) + _in_words(right)
        case ast.Constant(value=None):
            return [TYPES["None"][1]]
        case ast.Subscript(value=ast.Name(id="Sequence" | "Iterable"), slice=item):
            return [f"a list, each {' or '.join(_in_words(item))}"]
        case ast.Subscript(value=of):
            return _in_words(of)
        case ast.Name(id=name) if name in TYPES:
            return [TYPES[name][1]]
        case ast.Name(id=name) | ast.Attribute(attr=name) if name in MADE_BY:
            return [f"a {name}" + (f" (as {MADE_BY[name]})" if MADE_BY[name] else "")]
    return [ast.unparse(kind)]
