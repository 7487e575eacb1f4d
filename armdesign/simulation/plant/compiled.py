"""The door to numba: functions compiled when first called, and kept for later processes.

A right-hand side evaluated ten thousand times costs numpy fifty small arrays each time; as machine
code it costs as much as its arithmetic. What is compiled reads as plain Python, loops over cases
and cylinders included. The laws of ``fluid``, ``friction`` and ``valve`` are compiled as they are.

Compiled code is kept in files that each hold one function for one set of argument types, sealed
with a digest: a file that is damaged, half written or cannot be read is left aside, and the
function compiled again. Loading such a file runs what is in it, so a folder is used only if nobody
else may write there; without any the code is not kept.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import pickle
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any, TypeAlias, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from armdesign import units
from armdesign import user_folders as folders
from armdesign.errors import ArmDesignError, SimulationError, printable
from armdesign.hydraulics import fluid, friction, valve

try:
    import numba
except ValueError as error:
    raise ArmDesignError(
        "numba", f"does not begin ({error})", "mend the environment variables NUMBA_…"
    ) from None
from numba.core.caching import NullCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult
from numba.core.serialize import dumps
from numba.core.types import CompileResultWAP
from numba.extending import register_jitable

F = TypeVar("F", bound=Callable[..., object])
Record: TypeAlias = np.record  # of a structured array: fields are attributes
Records: TypeAlias = NDArray[np.record]

HERE = Path(__file__).parents[1]  # everything that may be compiled is of the simulation or loops
LOOPS = HERE.parent / "control"

for module in (fluid, friction, valve):
    for law in vars(module).values():
        if isinstance(law, FunctionType) and law.__module__ == module.__name__:
            register_jitable(law)


def compiled(function: F) -> F:
    """The function, compiled when first called or loaded from where an earlier process kept it."""
    return _compiled(function, counts=True)


def callable_within(function: F) -> F:
    """The function as it is, which compiled functions may call."""
    return register_jitable(function)


def within(function: F) -> F:
    """The function as it is, for calls by functions that are ``borrowing``, and as frugal.

    It becomes machine code as part of them alone.
    """
    wrappers = {"no_cfunc_wrapper": True, "no_cpython_wrapper": False}  # see ``_Inner``
    frugal = {"error_model": "numpy", "_nrt": False, "pipeline_class": _Inner}
    return register_jitable(**frugal, **wrappers)(function)


def borrowing(function: F) -> F:
    """A compiled function that makes no arrays and keeps none: it counts no references to them.

    numba leaves out the counting by itself where all arguments are arrays, but not where tuples
    hold them; there it took a quarter of the time. Within, no memory can be asked for: no new
    arrays, and no array assigned to a slice of another.
    """
    return _compiled(function, counts=False)


def lent(function: F) -> F:
    """As ``borrowing``, and others can call it without making it part of themselves."""
    return _compiled(function, counts=False, lent=True)


def _compiled(function: F, *, counts: bool, lent: bool = False) -> F:
    njit: Any = numba.njit  # its types lack the switch of reference counts, which is not public
    options = {"error_model": "numpy", "_nrt": counts, "no_cfunc_wrapper": not lent}
    dispatcher = njit(**options, nogil=True)(function)  # other threads go on
    if hasattr(dispatcher, "compile"):  # numba is not switched off
        module, name = function.__module__.rpartition(".")[2], cast(Any, function).__qualname__
        dispatcher._cache = _Kept(f"{module}.{name}")
    return cast(F, dispatcher)


def resolved(function: F, *arguments: object) -> F:
    """The compiled function for arguments of just these types, dimensions and layouts.

    It no longer checks them. numba checks every argument of every call, which for arrays of
    records takes longer than the computation itself; even once for every plant it takes 10 ms, so
    what was compiled for arguments of a kind is remembered.
    """
    dispatcher, typeof = cast(Any, function), cast(Any, numba.typeof)
    if not hasattr(dispatcher, "compile"):  # numba is switched off
        return function
    kind = dispatcher, _kind(arguments)
    if kind not in _resolved:
        _resolved[kind] = dispatcher.compile(tuple(typeof(argument) for argument in arguments))
    return cast(F, _resolved[kind])


_resolved: dict[object, Any] = {}


def as_argument(function: F, *arguments: object) -> F:
    """A function that is ``lent``, for arguments of these types, to be given to compiled ones.

    They call it where it is. One that they call by its name is made part of them: the plant would
    be optimised and made machine code of once more.
    """
    kernel = resolved(function, *arguments)
    if kernel is function:  # numba is switched off
        return function
    results = cast(Any, function).overloads.values()
    return cast(F, CompileResultWAP(next(one for one in results if one.entry_point is kernel)))


def _kind(argument: object) -> object:
    """Everything of an argument that numba's type of it depends on."""
    if isinstance(argument, tuple):
        return type(argument), *map(_kind, argument)
    if isinstance(argument, np.ndarray):
        f = argument.flags
        layout = f.c_contiguous, f.f_contiguous, f.aligned, f.writeable
        return argument.dtype, argument.ndim, layout
    if isinstance(argument, CompileResultWAP):
        return argument.signature()
    return type(argument)


def new_records(shape: int | tuple[int, ...], dtype: np.dtype[np.void]) -> Records:
    """Records of zeros.

    Raises:
        SimulationError: numba is switched off, which alone gives records attributes.
    """
    refuse_switched_off()
    return cast(Records, np.zeros(shape, dtype))


def refuse_switched_off() -> None:
    """Raise a SimulationError where numba is switched off: nothing can be simulated."""
    switches: Any = numba.config
    if switches.DISABLE_JIT:
        fault = "simulations need numba's compiler, which it switches off"
        error = SimulationError("NUMBA_DISABLE_JIT", fault, "unset it")
        error.passing = True
        raise error


def _refuse_without_folder() -> None:
    """Raise where the current folder is gone: numba names files from there as it compiles."""
    try:
        os.getcwd()
    except OSError as error:
        fault = f"cannot compile ({error.strerror})"
        raise ArmDesignError("numba", fault, "begin in a folder that is there") from None


class _Inner(Compiler):
    """Compiles what only compiled functions call.

    numba compiles a called function once for each set of options of its callers, so all have the
    same ones; that this one is not called from Python is said here instead.
    """

    def define_pipelines(self) -> Any:
        """The pipelines as ever, of a function whose code is only linked."""
        self.state.flags.no_cpython_wrapper = True
        linked, name = cast(Any, _Linked), self.state.func_id.func_qualname
        self.state.library = linked(self.state.targetctx.codegen(), name)
        return cast(Any, super()).define_pipelines()


class _Linked(JITCodeLibrary):
    """Code that its callers link to their own: they optimise it and make machine code of it.

    Else LLVM does both for each function with all that it calls, for those at the bottom five
    times.
    """

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        cast(Any, self)._finalize_dynamic_globals()
        self._finalized = True

    @property
    def codegen(self) -> _Linked:
        """Where numba sets the surroundings of machine code, of which there is none."""
        return self

    def set_env(self, name: str, surroundings: object) -> None:
        """Nothing is set."""


class _Kept(NullCache):
    """Compiled code of one function in files: read before it is compiled, written afterwards.

    It stands in for numba's own cache, which ends the program where it finds no folder to write
    into or a damaged file, mixes up what two processes compile at once, and does not see that a
    called function has changed.
    """

    def __init__(self, name: str) -> None:
        self._name = name

    def load_overload(self, signature: Any, context: Any) -> Any:
        """The function for some argument types, or None where it must be compiled."""
        context.refresh()
        key = _key(signature, context.codegen())
        for folder in cache_folders()[0]:
            try:
                sealed = self._file(folder, key).read_bytes()
                digest, data = sealed[:32], sealed[32:]
                if hashlib.sha256(data).digest() == digest:
                    known, payload = pickle.loads(data)
                    if known == key:
                        return cast(Any, CompileResult)._rebuild(context, *payload)
            except Exception:  # of any kind: whatever is wrong with a file, compiling mends it
                continue
        _refuse_without_folder()
        return None

    def save_overload(self, signature: Any, result: Any) -> None:
        """Keep what was compiled for some argument types, if there is a place for it."""
        folder = cache_folders()[1]
        if (
            folder is None
            or result.library.has_dynamic_globals
            or any(not lifted.can_cache for lifted in result.lifted)
        ):
            return
        key = _key(signature, result.codegen)
        data = cast(Any, dumps)((key, result._reduce()))
        # a full disk, or another process that keeps the same at this moment
        with contextlib.suppress(OSError):
            file = self._file(folder, key)
            file.unlink(missing_ok=True)
            with file.open("xb") as written:
                written.write(hashlib.sha256(data).digest() + data)

    def _file(self, folder: Path, key: object) -> Path:
        return folder / f"{self._name}-{hashlib.sha256(repr(key).encode()).hexdigest()[:16]}.nbc"


def _key(signature: Any, codegen: Any) -> tuple[object, ...]:
    """All that compiled code depends on but the sources: types, processor, numba, Python."""
    return signature, codegen.magic_tuple(), numba.__version__, sys.implementation.cache_tag


@cache
def cache_folders() -> tuple[tuple[Path, ...], Path | None]:
    """Folders from which kept code is read, and to which it is written (None: nowhere).

    Their name says all that may be compiled, so that what is in them cannot be older than any of
    it.
    """
    sources = [Path(module.__file__ or "") for module in (fluid, friction, units, valve)]
    programs_of = [*sorted(HERE.rglob("*.py")), *sorted(LOOPS.rglob("*.py"))]
    texts = (source.read_bytes() for source in [*sources, *programs_of])
    name = f"compiled-{hashlib.sha256(b''.join(texts)).hexdigest()[:12]}"
    chosen, readable = str(cast(Any, numba.config).CACHE_DIR), list[Path]()
    places: list[tuple[Path, Path | None]] = [(Path(chosen), None)] if chosen else []
    places += [(HERE / "__pycache__", HERE), *((place, None) for place in folders.of_user())]
    for place, programs in places:
        try:
            safe = folders.made_private(place / name, programs)
        except OSError:
            continue
        if safe:
            readable.append(place / name)
            if folders.writable(place / name):
                return tuple(readable), place / name
        elif chosen and place == Path(chosen):
            fault = "others may write there, so it is not used; name a folder that is yours alone"
            print(printable(f"armdesign: NUMBA_CACHE_DIR {chosen}: {fault}"), file=sys.stderr)
    return tuple(readable), None
