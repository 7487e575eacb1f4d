"""What code names: globals and imports; and where names are found, installed or the user's."""

from __future__ import annotations

import dis
import importlib
import sys
import sysconfig
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.machinery import SourceFileLoader
from importlib.util import resolve_name
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

GLOBALS = "LOAD_GLOBAL", "LOAD_NAME", "LOAD_FROM_DICT_OR_GLOBALS"
PACKAGES = "site-packages", "dist-packages"  # also those of the user or the system


def module_of(value: Any) -> str:
    """Name of the module that a function, class or object says it is of."""
    return str(getattr(value, "__module__", None) or type(value).__module__)


def called(value: Any) -> str:
    """Name of a function or class within its module; none of other objects."""
    try:
        return str(getattr(value, "__qualname__", getattr(value, "__name__", "")))
    except Exception:  # whatever an object's own code raises
        return ""


def home_of(value: Any) -> ModuleType | None:
    """The module that has a function or class by its name; None for what is made elsewhere."""
    module = sys.modules.get(module_of(value))
    first, *others = called(value).split(".")
    found = None if module is None else vars(module).get(first)
    for name in others:
        found = getattr(found, name, None)
    return module if found is value else None


def name_to_others(value: Any, home: ModuleType | None) -> str:
    """Name, as ``module:name``, by which other processes find a thing or module of the user's.

    Args:
        value: any.
        home: the module that has it by its name, if there is one.

    Returns:
        Empty where they do not: it was typed or made, is installed, or was rewritten as it was
        loaded, as pytest does, so that others have it from the same file and yet not alike.
    """
    module = value if isinstance(value, ModuleType) else home
    if module is None or installed(module) or module is not sys.modules.get(module.__name__):
        return ""
    loader = getattr(module.__spec__, "loader", None)
    if module.__name__ == "__main__" or not isinstance(loader, SourceFileLoader):
        return ""
    return f"{module.__name__}:{'' if module is value else called(value)}"


def found_by(name: str) -> Any:
    """What is found by a name, ``module:name``; None where a module does not have it.

    Raises:
        ImportError: the module is not there or cannot be loaded.
    """
    module, _, within = name.partition(":")
    found: Any = importlib.import_module(module)
    for one in within.split(".") if within else ():
        found = getattr(found, one, None)
    return found


def file_of(space: Mapping[str, Any]) -> str:
    """The file that made a module's globals; empty for what was typed."""
    file = str(space.get("__file__") or "")
    return file if Path(file).is_file() else ""


def installed(module: ModuleType | None) -> bool:
    """Whether a module is Python's, this package's or an installed one, and not the user's."""
    if module is None or module.__name__ == "__main__":
        return False
    name, file = module.__name__, getattr(module, "__file__", None)
    if name.partition(".")[0] == "armdesign":
        return True
    if places := [file] if file else list(getattr(module, "__path__", ())):
        return all(map(_is_installed, places))
    above = name.rpartition(".")[0]
    if above in sys.modules:
        return installed(sys.modules[above])
    return name in sys.stdlib_module_names


@cache
def _is_installed(file: str) -> bool:
    folders = [sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")]
    path = Path(file)
    return any(map(path.is_relative_to, folders)) or not {*PACKAGES}.isdisjoint(path.parts)


def names_read_by(code: CodeType) -> set[str]:
    """Names of globals that a function reads, and functions within it."""
    return {
        step.argval
        for one in _with_inner(code)
        for step in dis.get_instructions(one)
        if step.opname in GLOBALS
    }


def imported_by(code: CodeType, space: Mapping[str, Any]) -> Iterator[ModuleType]:
    """Modules that a function imports, and functions within it, but for those that lack."""
    for level, name, names in sorted({*_imports(code)}):
        try:
            full = resolve_name("." * level + name, space.get("__package__"))
            module = importlib.import_module(full)
            for one in names:
                if not installed(module) and not hasattr(module, one):
                    importlib.import_module(f"{full}.{one}")
        except Exception:  # whatever a module raises; the task has to live with it, too
            continue
        yield module if names else sys.modules[full.partition(".")[0]]


def _imports(code: CodeType) -> Iterator[tuple[int, str, tuple[str, ...]]]:
    """Imports with their level (of ``from . import x``: 1) and the names that they take."""
    for one in _with_inner(code):
        steps = [s for s in dis.get_instructions(one) if s.opname != "EXTENDED_ARG"]
        for level, names, step in zip(steps, steps[1:], steps[2:], strict=False):
            if step.opname == "IMPORT_NAME":
                yield level.argval, step.argval, names.argval or ()


def _with_inner(code: CodeType) -> Iterator[CodeType]:
    yield code
    for one in code.co_consts:
        if isinstance(one, CodeType):
            yield from _with_inner(one)
