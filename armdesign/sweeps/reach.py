"""Identity of a user's function: its code, and all of the user's that it reaches.

That is the functions, classes, modules and values which it names, and what these name in turn, as
they are in memory: a file edited after it was loaded decides nothing. Objects are known by their
class and by what pickle writes down of them. For one that has nothing to write down, such as a
lock, the files of the user's modules stand, if one of these holds it. Of what is installed the
name is enough.
"""

from __future__ import annotations

import copyreg
import hashlib
import re
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import cached_property, lru_cache, partial, singledispatch
from pathlib import Path
from types import CodeType, FunctionType, MappingProxyType, MethodType, ModuleType
from typing import Any, cast

import numpy as np

from armdesign import _BEGAN
from armdesign.errors import ArmDesignError
from armdesign.journal.keys import canonical, digest
from armdesign.sweeps.names import (
    called,
    file_of,
    found_by,
    home_of,
    imported_by,
    installed,
    module_of,
    name_to_others,
    names_read_by,
)

ATOMS = bool, int, float, complex, str, bytes, type(None)
PARTS: dict[type, tuple[str, ...]] = {  # of kinds of objects: all that decides what they do
    CodeType: (
        *("co_code", "co_exceptiontable", "co_consts", "co_names", "co_varnames", "co_freevars"),
        *("co_cellvars", "co_flags", "co_argcount", "co_posonlyargcount", "co_kwonlyargcount"),
    ),
    MethodType: ("__func__", "__self__"),
    cached_property: ("func",),
    classmethod: ("__func__",),
    np.vectorize: ("pyfunc", "otypes", "signature", "excluded"),
    partial: ("func", "args", "keywords"),
    property: ("fget", "fset", "fdel"),
    staticmethod: ("__func__",),
    type(lru_cache(len)): ("__dict__",),
}
DISPATCHER = cast(FunctionType, singledispatch(len)).__code__  # of all generic functions
BESIDE = {  # what Python and pydantic keep in a class or module beside what its text says
    *("__builtins__", "__cached__", "__dict__", "__doc__", "__file__", "__firstlineno__"),
    *("__loader__", "__name__", "__package__", "__path__", "__slotnames__", "__spec__"),
    *("__static_attributes__", "__warningregistry__", "__weakref__", "_abc_impl"),
    *("__pydantic_core_schema__", "__pydantic_serializer__", "__pydantic_setattr_handlers__"),
    "__pydantic_validator__",
}
GLOBAL_GENERATOR = np.random.mtrand._rand  # of another state in every process
ADDRESS = re.compile(r"(?<!\d)\d{9,20}(?!\d)")  # as pydantic writes one behind a class's name
HEAP = 1 << 9  # flag of a class that no extension has as a constant


def identity_of_function(function: Callable[..., Any]) -> str:
    """Everything of the user's that decides what a function answers, as JSON.

    Raises:
        ArmDesignError: it holds or names a value that cannot be written down.
    """
    reached = _Reached(function)
    with _within_bounds(reached.name):
        return canonical([reached.all_of(function, reached.name), reached.texts()])


def names_reached(task: Callable[..., Any]) -> list[str]:
    """Names, as ``module:name``, of what a task reaches in modules of the user's.

    What is to be looked at first comes first: a function comes after what it names. Other
    processes find all of it by name, in the files that they load; not so what was typed.
    """
    reached = _Reached(task, strict=False)
    with _within_bounds(reached.name):
        reached.all_of(task, reached.name)
    return list(reached.named)[::-1]


def digests_of(names: Iterable[str]) -> dict[str, str]:
    """Digests of what makes up functions, classes and modules as this process has them, in words.

    Raises:
        ArmDesignError: one reaches what only its file tells, and that is not what was loaded.
        ImportError: a module is not there or cannot be loaded.
    """
    values = {name: found_by(name) for name in names}  # all, as modules know what is loaded
    reached = _Reached(None, strict=False)
    parts: dict[str, list[Any]] = {}
    for name, value in values.items():
        reached.name = name.replace(":", ".").removesuffix(".")
        with _within_bounds(reached.name):
            first, *things = reached.all_of(value, name)
            rest = [first, reached.texts(others=False)]
        for _, owner, *inside in things:
            known_as = owner if isinstance(owner, str) else ".".join(owner)
            for part in inside:
                parts.setdefault(_in_words(part, known_as), []).append(part)
        parts.setdefault(reached.name, []).append(rest)
    return {words: digest(part) for words, part in parts.items()}


def _in_words(part: Any, owner: str) -> str:
    """What a part of a function, class or module is: a value that it names, or itself."""
    is_named = isinstance(part, list) and len(part) == 2 and isinstance(part[0], str)
    return f"{part[0]} in {owner}" if is_named else owner


@contextmanager
def _within_bounds(name: str) -> Iterator[None]:
    try:
        yield
    except RecursionError:
        fault, remedy = "reaches values within values without end", "give numbers as options"
        raise ArmDesignError(name, fault, remedy) from None


class _Reached:
    """What a task reaches; each thing is looked at once, and is a number from then on.

    Args:
        task: a function.
        seen: things with their numbers.
        strict: whether a value that nothing stands for is refused; otherwise its class stands.
    """

    def __init__(
        self, task: Any, seen: dict[int, tuple[int, Any]] | None = None, *, strict: bool = True
    ) -> None:
        self.name = getattr(task, "__qualname__", "task")
        self.named: dict[str, None] = {}  # what other processes find by its name
        self._task, self._strict = task, strict
        self._seen = seen or {}  # with the things, lest another one gets the address
        self._files: set[str] = set()
        self._waiting: deque[tuple[Any, str, str]] = deque()  # functions, classes and modules

    def all_of(self, value: Any, name: str, file: str = "") -> list[Any]:
        """Identity of a value, then of the functions, classes and modules that it reaches."""
        found = [self.of(value, name, file)]
        while self._waiting:  # one after another: they may form long chains
            one, *how = self._waiting.popleft()
            found.append([self._seen[id(one)][0], *self._inside(one, *how)])
        return found

    def of(self, value: Any, name: str, file: str = "") -> Any:
        """Identity of a value that is known by a name, in a module of the user's with a file."""
        kind = type(value)
        if kind in ATOMS:
            return hex(value) if kind is int else repr(self._without_addresses(value))
        if value is GLOBAL_GENERATOR:
            return ["numpy.random"]
        if kind not in (tuple, frozenset):  # equal ones may be one, or not
            if id(value) in self._seen:
                return self._seen[id(value)][0]
            self._seen[id(value)] = len(self._seen), value
        if kind in (list, tuple):
            return [kind.__name__, *(self.of(one, name, file) for one in value)]
        if kind in (set, frozenset):
            return [kind.__name__, *sorted(self._apart(one, name, file) for one in value)]
        if kind in (dict, MappingProxyType):
            return [kind.__name__, *(self.of(pair, name, file) for pair in value.items())]
        home = home_of(value)
        if home and installed(home):
            return [home.__name__, called(value)]
        if found := name_to_others(value, home):
            self.named[found] = None
        if isinstance(value, FunctionType | type | ModuleType):
            self._waiting.append((value, name, file))
            return self._seen[id(value)][0]
        if kind in PARTS:
            return [kind.__name__, *(self.of(getattr(value, p), name, file) for p in PARTS[kind])]
        return self._of_object(value, name, file)

    def texts(self, *, others: bool = True) -> list[str]:
        """Digests of the files that stand for values, if any, and of the user's others.

        Raises:
            ArmDesignError: one is not what was loaded.
        """
        if not self._files:
            return []
        modules = [m for m in list(sys.modules.values()) if isinstance(m, ModuleType)]
        own = {file_of(vars(m)) for m in modules if others and not installed(m)} - {""}
        texts = []
        for file in map(Path, self._files | own):
            if (date := file.stat().st_mtime) > _BEGAN:
                ahead = date > time.time()
                when = "dated in the future" if ahead else "newer than this run"
                fault = f"reaches what only files tell, and {file.name} is {when}"
                remedy = f"set its date (touch {file.name}), then " if ahead else ""
                raise ArmDesignError(self.name, fault, f"{remedy}start Python anew")
            texts.append(hashlib.sha256(file.read_bytes()).hexdigest())
        return sorted(texts)

    def _without_addresses(self, value: Any) -> Any:
        """A value; a text has numbers of things in the place of their addresses."""

        def number(address: re.Match[str]) -> str:
            known = self._seen.get(int(address[0]))
            return str(known[0]) if known else address[0]

        return ADDRESS.sub(number, value) if type(value) is str else value

    def _apart(self, value: Any, name: str, file: str) -> str:
        """Identity of one of a set, whichever of them come before it."""
        apart = _Reached(self._task, dict(self._seen), strict=self._strict)
        found = canonical(apart.all_of(value, name, file))
        self._files |= apart._files
        self.named |= apart.named
        return found

    def _inside(self, value: Any, name: str, file: str) -> Iterator[Any]:
        if isinstance(value, FunctionType):
            return self._of_function(value, name, file)
        if isinstance(value, type):
            return self._of_class(value, name, file)
        return self._of_module(value)

    def _of_function(self, function: FunctionType, name: str, file: str) -> Iterator[Any]:
        code, space = function.__code__, function.__globals__
        yield [space.get("__name__", ""), code.co_qualname]
        if code is DISPATCHER:
            yield self.of(dict(vars(function)["registry"]), name, file)
            return
        whole = "" if function is self._task and self._strict else file_of(space)
        held = file or (whole if home_of(function) else "")
        inside = function.__defaults__, function.__kwdefaults__, vars(function)
        yield self.of((*inside, _annotations(function)), name, held)
        for free, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
            yield [self.of(one, free, held) for one in _contents(cell)]
        module = sys.modules.get(space.get("__name__", ""))
        if module and vars(module) is space and installed(module):
            return
        yield self.of(code, name)
        for read in sorted(names_read_by(code)):
            if read in space:
                yield [read, self.of(space[read], read, file or whole)]
        for module in imported_by(code, space):
            yield self.of(module, name)

    def _of_class(self, kind: type, name: str, file: str) -> Iterator[Any]:
        yield [module_of(kind), kind.__qualname__]
        if not kind.__flags__ & HEAP:
            return
        home = home_of(kind)
        held = file or (file_of(vars(home)) if home else "")
        yield self.of((type(kind), *kind.__bases__), name, held)
        for key, one in sorted(vars(kind).items()):
            if key not in BESIDE:
                yield [key, self.of(one, key, held)]

    def _of_module(self, module: ModuleType) -> Iterator[Any]:
        yield module.__name__
        if not installed(module):
            file = file_of(vars(module))
            for key, one in sorted(vars(module).items()):
                if key not in BESIDE:
                    yield [key, self.of(one, key, file)]

    def _of_object(self, value: Any, name: str, file: str) -> Any:
        try:
            written = _written(value)
        except Exception:  # whatever an object's own code raises
            if file:
                self._files.add(file)
                return self.of(type(value), name, file)
            if not self._strict:
                return self.of(type(value), name)
            fault = f'reads "{name}", a {type(value).__name__} that cannot be written down'
            remedy = "give numbers and texts as options"
            raise ArmDesignError(self.name, fault, remedy) from None
        return [self.of(type(value), name, file), self.of(written, name, file)]


def _written(value: Any) -> Any:
    """What is written down of an object, as pickle does.

    Raises:
        Exception: nothing, or it is no more than a name.
    """
    kind = type(value)
    if module_of(kind).startswith("armdesign.") and hasattr(value, "identity"):
        return canonical(value)
    if module_of(kind).startswith("numba."):  # whose pickles have random names
        return value.__wrapped__, value.targetoptions
    reduce = copyreg.dispatch_table.get(kind)
    parts = reduce(value) if reduce else value.__reduce_ex__(2)
    if not isinstance(parts, str):
        if kind is object:
            raise TypeError("is nothing but itself")
        return [_plain(kind, one) for one in parts]
    if module_of(kind) != "typing" and not installed(sys.modules.get(module_of(value))):
        raise TypeError("is a name of the user's")
    if isinstance(value, np.ufunc) and " (" in parts:
        raise TypeError("is the name of a function that np.frompyfunc hides")
    return parts, module_of(value), value.__getstate__()


def _plain(kind: type, part: Any) -> Any:
    """Part of a pickle: listed, and without what an installed class computes of the others."""
    if isinstance(part, Iterator):
        return list(part)
    if not isinstance(part, dict) or not installed(sys.modules.get(module_of(kind))):
        return part
    computed = {k for k in part if isinstance(getattr(kind, str(k), None), cached_property)}
    return {key: one for key, one in part.items() if key not in computed}


def _annotations(function: FunctionType) -> dict[str, Any]:
    try:
        return function.__annotations__
    except NameError:  # of newer Pythons, which look for names only now
        return {}


def _contents(cell: Any) -> list[Any]:
    try:
        return [cell.cell_contents]
    except ValueError:  # nothing yet
        return []
