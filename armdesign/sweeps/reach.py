"""Identity of a user's function: its code, and all of the user's that it reaches.

That is the functions, classes, modules and numbers which it names, and what these name in turn,
as they are in memory: a file edited after it was loaded decides nothing. Of what is installed the
name is enough.
"""

from __future__ import annotations

import dis
import importlib
import inspect
import sys
import sysconfig
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from functools import lru_cache, partial
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numpy as np

from armdesign.errors import ArmDesignError
from armdesign.journal.keys import canonical

GLOBALS = "LOAD_GLOBAL", "LOAD_NAME"
KNOWN = bool, int, float, complex, str, bytes, type(None), type(...), Path


def identity_of_function(function: Callable[..., Any]) -> str:
    """Everything of the user's that decides what a function answers, as JSON.

    Raises:
        ArmDesignError: it holds or names a value that cannot be written down.
    """
    name = getattr(function, "__qualname__", "task")
    if not inspect.isfunction(function) or function.__closure__:
        fault = "holds values that its source does not show"
        raise ArmDesignError(name, fault, "give a plain function, and values as options")
    return canonical(_Reached(name).of(function, name))


class _Reached:
    """What a task reaches; each function, class and module is looked at once."""

    def __init__(self, task: str) -> None:
        self._task = task
        self._seen: set[int] = set()

    def of(self, value: Any, name: str) -> Any:
        """Identity of a value that is known by a name."""
        if isinstance(value, partial):
            return self.of([value.func, value.args, value.keywords], name)
        if inspect.ismethod(value):
            return self.of([value.__func__, value.__self__], name)
        value = inspect.unwrap(value) if callable(value) else value  # what a decorator keeps
        if inspect.isroutine(value) or isinstance(value, type | ModuleType | np.ufunc):
            own = value if inspect.ismodule(value) else sys.modules.get(_module_of(value))
            said = getattr(value, "__qualname__", getattr(value, "__name__", name))
            if (own is not None and _installed(own)) or id(value) in self._seen:
                return [_module_of(value), said]
            self._seen.add(id(value))
            return [said, *self._inside(value, name)]
        if isinstance(value, np.ndarray | np.generic):
            return [str(value.dtype), value.tolist()]
        if isinstance(value, KNOWN):
            return repr(value)
        if isinstance(value, list | tuple):
            return [self.of(one, name) for one in value]
        if isinstance(value, set | frozenset):
            return sorted(map(repr, value))
        if isinstance(value, Mapping):
            return [[repr(key), self.of(one, name)] for key, one in value.items()]
        if is_dataclass(value) and not hasattr(value, "identity"):
            inside = [[one.name, self.of(getattr(value, one.name), name)] for one in fields(value)]
            return [self.of(type(value), name), inside]
        try:
            return canonical(value)
        except (TypeError, ValueError):
            fault = f'reads "{name}", a {type(value).__name__} that cannot be written down'
            remedy = "give numbers and texts as options"
            raise ArmDesignError(self._task, fault, remedy) from None

    def _inside(self, value: Any, name: str) -> Iterator[Any]:
        if isinstance(value, FunctionType):
            yield from self._of_function(value)
        elif inspect.isclass(value):
            yield [self.of(base, name) for base in value.__bases__]
            for key, one in sorted(vars(value).items()):
                one = getattr(one, "__func__", getattr(one, "fget", one))
                yield [key, self._if_known(one, key)]
        elif inspect.ismodule(value):
            for key, one in sorted(vars(value).items()):
                if not key.startswith("__"):
                    yield [key, self._if_known(one, key)]
        else:
            yield _module_of(value)

    def _of_function(self, function: FunctionType) -> Iterator[Any]:
        yield _code(function.__code__)
        yield self.of([function.__defaults__, function.__kwdefaults__], function.__qualname__)
        for cell in function.__closure__ or ():
            yield self.of(cell.cell_contents, function.__qualname__)
        for name in sorted(_named(function.__code__, GLOBALS)):
            if name in function.__globals__:
                yield [name, self.of(function.__globals__[name], name)]
        for name in sorted(_named(function.__code__, ("IMPORT_NAME",))):
            try:
                yield [name, self.of(importlib.import_module(name), name)]
            except ImportError:
                yield [name]

    def _if_known(self, value: Any, name: str) -> Any:
        """Of what a class or module holds, without what cannot be written down."""
        try:
            return self.of(value, name)
        except ArmDesignError:
            return type(value).__name__


def _module_of(value: Any) -> str:
    if inspect.ismodule(value):
        return value.__name__
    return str(getattr(value, "__module__", None) or type(value).__module__)


def _installed(module: ModuleType) -> bool:
    """Whether a module is Python's, this package's or an installed one, and not the user's."""
    if module.__name__ == "__main__":
        return False
    file = getattr(module, "__file__", None)
    if module.__name__.partition(".")[0] == "armdesign" or file is None:
        return True
    return any(Path(file).is_relative_to(folder) for folder in _folders())


@lru_cache(maxsize=1)
def _folders() -> tuple[str, ...]:
    names = "stdlib", "platstdlib", "purelib", "platlib"
    return tuple(sysconfig.get_path(name) for name in names)


def _code(code: CodeType) -> list[Any]:
    """What a function does: its instructions, and the constants and names in them."""
    return [code.co_code.hex(), [_constant(c) for c in code.co_consts], code.co_names]


def _constant(value: Any) -> Any:
    if isinstance(value, CodeType):
        return _code(value)
    if isinstance(value, tuple):
        return [_constant(one) for one in value]
    return sorted(map(repr, value)) if isinstance(value, frozenset) else repr(value)


def _named(code: CodeType, instructions: tuple[str, ...]) -> set[str]:
    """Names that some instructions of a function have, and of functions within it."""
    names = {i.argval for i in dis.get_instructions(code) if i.opname in instructions}
    inner = (c for c in code.co_consts if isinstance(c, CodeType))
    return names.union(*(_named(one, instructions) for one in inner))
