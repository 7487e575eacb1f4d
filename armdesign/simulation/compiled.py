"""The door to numba: functions of numbers and small arrays, compiled when first called and kept for later processes.

A right-hand side asked for ten thousand times costs numpy fifty small arrays each time; as machine code it costs as
much as its arithmetic. What is compiled reads as plain Python, loops over cases and cylinders included. The laws of
``fluid`` and ``valve`` serve both worlds as they are.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any, TypeVar, cast

import numba
from numba.extending import register_jitable

from armdesign import fluid, units, valve

F = TypeVar("F", bound=Callable[..., object])

for module in (fluid, valve):
    for law in vars(module).values():
        if isinstance(law, FunctionType) and law.__module__ == module.__name__:
            register_jitable(law)


def compiled(function: F) -> F:
    """The function, compiled when first called.

    numba keeps what it compiled until the file of the function changes, not those of the functions it calls; here it is
    kept beside the sources in a folder named by all that may be compiled, so that it cannot be older than any of it.
    """
    settings: Any = numba.config
    before = settings.CACHE_DIR
    settings.CACHE_DIR = _folder(before)
    try:
        made: Any = numba.njit(cache=True, error_model="numpy")(function)
    finally:
        settings.CACHE_DIR = before
    return cast(F, made)


def resolved(function: F, *arguments: object) -> F:
    """The compiled function for arguments of just these types, dimensions and layouts, which it no longer looks at.

    numba looks at every argument of every call, which for arrays of records takes longer than what is computed here.
    """
    made, typeof = cast(Any, function), cast(Any, numba.typeof)
    if not hasattr(made, "compile"):  # numba is switched off
        return function
    return cast(F, made.compile(tuple(typeof(argument) for argument in arguments)))


@cache
def _folder(chosen: str) -> str:
    """Where to keep what was compiled; empty, numba's own choice, where the sources' folder cannot be written."""
    here = Path(__file__).parent
    if not chosen and not os.access(here, os.W_OK):
        return ""
    sources = [Path(module.__file__ or "") for module in (fluid, units, valve)] + sorted(here.glob("*.py"))
    digest = hashlib.sha256(b"".join(source.read_bytes() for source in sources)).hexdigest()[:12]
    return str(Path(chosen or here / "__pycache__") / f"compiled-{digest}")
