"""Identity of a user's function: what modules hold and import, with files and without."""

from __future__ import annotations

import copy
import importlib
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import armdesign as ad
from armdesign.sweeps.names import installed
from armdesign.sweeps.reach import identity_of_function

# What a user's module may hold, in which NN is 1 or 2, and how a task gets NN from it.
OBJECTS = {
    "namespace": ("import types\nX = types.SimpleNamespace(a=NN)\n", "h.X.a"),
    "instance": ("class I:\n    def __init__(s, a): s.a = a\nX = I(NN)\n", "h.X.a"),
    "slots": ("class I:\n    __slots__ = 'a',\nX = I()\nX.a = NN\n", "h.X.a"),
    "frame": ("import pandas as pd\nX = pd.DataFrame({'a': [NN]})\n", "float(h.X.a[0])"),
    "array": ("import numpy as np\nX = np.array([NN + 0j])\n", "h.X[0].real"),
    "decimal": ("from decimal import Decimal\nX = Decimal(NN)\n", "float(h.X)"),
    "member": ("import enum\nclass E(enum.Enum):\n    A = NN\nX = E.A\n", "h.X.value"),
    "deque": ("from collections import deque\nX = deque([NN])\n", "h.X[0]"),
    "pattern": ("import re\nX = re.compile('NN')\n", "int(h.X.pattern)"),
    "vectorized": ("import numpy as np\nX = np.vectorize(lambda z: NN)\n", "int(h.X(1))"),
    "ufunc": ("import numpy as np\nX = np.frompyfunc(lambda z: NN, 1, 1)\n", "h.X(1)"),
    "number": ("class N(int): pass\nX = N(3)\nX.more = NN\n", "h.X.more"),
    "variable": ("import contextvars\nX = contextvars.ContextVar('X', default=NN)\n", "h.X.get()"),
    "locked": ("import threading\nX = [threading.Lock(), object(), NN]\n", "h.X[2]"),
    "dict": ("class B(dict):\n    def __getattr__(s, k): return s[k]\nX = B(a=NN)\n", "h.X.a"),
    "lookup": ("X = {'a': NN}.get\n", "h.X('a')"),
    "cycle": ("X = {'a': NN}\nX['x'] = X\n", "h.X['x']['a']"),
    "wrapper": (
        "import functools\ndef times(k):\n    def d(f):\n        @functools.wraps(f)\n"
        "        def g(): return k * f()\n        return g\n    return d\n"
        "@times(NN)\ndef X(): return 1\n",
        "h.X()",
    ),
    "generic": (
        "import functools\n@functools.singledispatch\ndef X(x): return 0\n"
        "X.register(int, lambda x: NN)\n",
        "h.X(1)",
    ),
    "attribute": ("def X(): return X.k\nX.k = NN\n", "h.X()"),
    "cached": (
        "import functools\nclass X:\n    @functools.cached_property\n    def a(s): return NN\n",
        "h.X().a",
    ),
    "method": (
        "import functools\nclass X:\n    def b(s, k): return k\n"
        "    a = functools.partialmethod(b, NN)\n",
        "h.X().a()",
    ),
    "setter": (
        "class X:\n    @property\n    def a(s): return s.b\n    @a.setter\n"
        "    def a(s, b): s.b = NN * b\n",
        "setattr(x := h.X(), 'a', 1) or x.a",
    ),
    "descriptor": (
        "class D:\n    def __init__(s, f): s.f = f\n    def __get__(s, o, t=None): return s.f(o)\n"
        "class X:\n    @D\n    def a(s): return NN\n",
        "h.X().a",
    ),
    "metaclass": (
        "class M(type):\n    @property\n    def a(cls): return NN\n"
        "class X(metaclass=M): pass\ndel M\n",
        "h.X.a",
    ),
    "made class": (
        "import dataclasses\n"
        "X = dataclasses.make_dataclass('X', [('a', int, dataclasses.field(default=NN))])\n",
        "h.X.a",
    ),
    "annotation": ("def X(a: NN): return a\n", "h.X.__annotations__['a']"),
    "validator": (
        "from typing import Any\nfrom pydantic import BaseModel, field_validator\n"
        "class M(BaseModel):\n    a: Any = None\n    b: Any = None\n"
        "    @field_validator('ab'[NN - 1])\n    @classmethod\n    def v(cls, x): return 2\n",
        "h.M(a=1, b=1).b",
    ),
    "names of parameters": ("def X(aNN=2, **more): return aNN\n", "h.X(a1=1)"),
}
IMPORTS = {  # a function that gets a number from another file, and the name of that
    "package": ("import reached_pk.h\ndef f(): return reached_pk.h.val()\n", "reached_pk/h"),
    "renamed": ("import reached_pk.h as h\ndef f(): return h.val()\n", "reached_pk/h"),
    "inside": (
        "def f():\n    import reached_pk.h\n    return reached_pk.h.val()\n",
        "reached_pk/h",
    ),
    "from": ("def f():\n    from reached_pk import h\n    return h.val()\n", "reached_pk/h"),
    "of it": ("def f():\n    from .h import val\n    return val()\n", "reached_pk/h"),
    "beside": ("def f():\n    from . import h\n    return h.val()\n", "reached_pk/h"),
}
Made = Callable[[dict[str, str]], Any]


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Made]:
    """Gives the task of files by their names; those were written before this run began."""
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def forget() -> None:
        for name in [name for name in sys.modules if name.startswith("reached_")]:
            del sys.modules[name]

    def make(files: dict[str, str]) -> Any:
        forget()
        for name, text in files.items():
            path = tmp_path / f"{name}.py"
            path.parent.mkdir(exist_ok=True)
            path.write_text(text)
            os.utime(path, (0, 0))
        importlib.invalidate_caches()
        return importlib.import_module([*files][-1].replace("/", ".")).task

    yield make
    forget()


@pytest.mark.parametrize("kind", OBJECTS)
def test_what_a_module_holds_changes_it(made: Made, kind: str) -> None:
    text, value = OBJECTS[kind]
    task = f"import reached_h as h\ndef task(machine, workspace): return {{'x': {value}}}\n"
    found = []
    for number in "121":
        function = made({"reached_h": text.replace("NN", number), "reached_task": task})
        found.append((function(None, None)["x"], identity_of_function(function)))
    assert [answer for answer, _ in found] == [1, 2, 1]
    assert found[0] == found[2] != found[1]
    assert found[0][1] != found[1][1]


@pytest.mark.parametrize("kind", IMPORTS)
def test_packages_without_a_file_and_imports_within_functions_change_it(
    made: Made, kind: str
) -> None:
    text, helper = IMPORTS[kind]
    task = f"{text}def task(machine, workspace): return {{'x': f()}}\n"
    found = []
    for number in "121":
        function = made({helper: f"def val(): return {number}\n", "reached_pk/task": task})
        found.append(identity_of_function(function))
        assert function(None, None)["x"] == int(number)
    assert found[0] == found[2] != found[1]


def test_a_module_that_lacks_or_fails_is_left_to_the_task(made: Made) -> None:
    task = "def task(machine, workspace):\n    import reached_none, reached_bad\n"
    assert identity_of_function(made({"reached_bad": "1 / 0\n", "reached_task": task}))


def test_what_python_keeps_in_a_class_once_it_wrote_one_down_changes_nothing(made: Made) -> None:
    """Names of its slots."""
    task = "class K: pass\ndef task(machine, workspace): return K().x\n"
    function = made({"reached_task": task})
    before = identity_of_function(function)
    copy.copy(function.__globals__["K"]())
    assert "__slotnames__" in vars(function.__globals__["K"])
    assert identity_of_function(function) == before


def test_every_run_of_python_finds_the_same(tmp_path: Path) -> None:
    """Neither addresses nor the order of sets are in it."""
    (tmp_path / "reached_h.py").write_text(
        "import threading\nimport pydantic\n"
        "def k(): return 1\ndef f(): return k()\ndef g(): return k()\n"
        "class K: pass\nA = {f: 'a', g: 'b'}\nB = {f, g, K}\nC = {K(): 1, K: 2}\n"
        "D = [{frozenset({'boom', 'stick', 'bucket', 'swing'}), 'a', ('b', 1)}]\n"
        "class L:\n    lock, names = threading.Lock(), {'boom', 'stick', 'bucket'}\nE = L()\n"
        "class M(pydantic.BaseModel):\n    a: int = 1\nF = M()\n"
        "class N(M):\n    @pydantic.computed_field\n    @property\n"
        "    def b(self) -> int: return 1\n"
        "    @pydantic.field_validator('a')\n    @classmethod\n    def v(cls, a): return a\n"
        "    @pydantic.model_validator(mode='after')\n    def w(self): return self\n"
        "from scipy import stats\nLIFE = stats.norm(1200.0, 50.0)\n"
    )
    (tmp_path / "reached_task.py").write_text(
        "import reached_h\nfrom reached_h import A, B, C, D\n"
        "from armdesign.sweeps.reach import identity_of_function\n"
        "def task(machine, workspace): return {'x': len([A, B, C, D, reached_h, {'p', 'q'}])}\n"
        "if __name__ == '__main__': print(identity_of_function(task))\n"
    )
    found = set()
    for seed in "123":
        surroundings = {**os.environ, "PYTHONHASHSEED": seed}
        run = [sys.executable, "reached_task.py"]
        printed = subprocess.run(
            run, cwd=tmp_path, env=surroundings, capture_output=True, text=True, check=True
        )
        found.add(printed.stdout)
    assert len(found) == 1
    assert " at 0x" not in found.pop()


HOLDER = "import threading\nLOCK = threading.Lock()\ndef f():\n    with LOCK: return 1\n"


@pytest.mark.parametrize(
    ("ahead", "said"),
    [
        (0, r"reached_h\.py is newer than this run; start Python anew"),
        (
            7200,
            r"reached_h\.py is dated in the future; set its date \(touch reached_h\.py\), then",
        ),
    ],
)
def test_files_newer_than_the_run_do_not_stand_for_what_they_hold(
    ahead: float, said: str, made: Made, tmp_path: Path
) -> None:
    """One of the future was newer than any other run, too."""
    text = "import reached_h\ndef task(machine, workspace): return {'x': reached_h.f()}\n"
    task = made({"reached_h": HOLDER, "reached_task": text})
    assert identity_of_function(task)
    os.utime(tmp_path / "reached_h.py", 2 * (time.time() + ahead,))
    with pytest.raises(ad.ArmDesignError, match=said):
        identity_of_function(task)


def test_what_was_typed_has_no_file() -> None:
    space: dict[str, Any] = {"__file__": "<stdin>", "__name__": "__main__"}
    exec(f"{HOLDER}def task(machine, workspace): return {{'x': f()}}\n", space)
    with pytest.raises(ad.ArmDesignError, match='reads "LOCK", a lock that cannot be written'):
        identity_of_function(space["task"])


def test_all_files_of_the_user_stand_for_what_one_holds(made: Made) -> None:
    found = set()
    for number in "12":
        lock = f"import contextvars\nX = contextvars.ContextVar('X', default={number})\n"
        text = "import reached_h\ndef task(machine, workspace): return {'x': reached_h.X.get()}\n"
        files = {"reached_lock": lock, "reached_h": "from reached_lock import X\n"}
        found.add(identity_of_function(made({**files, "reached_task": text})))
    assert len(found) == 2


@pytest.mark.parametrize(
    "text",
    [
        "from reached_h import LOCK\ndef task(machine, workspace): return {'x': bool(LOCK)}\n",
        "import reached_h\ndef task(machine, workspace, LOCK=reached_h.LOCK): return {'x': 1}\n",
        "import reached_h\ndef task(machine, workspace): return {'x': 1}\n"
        "task.LOCK = reached_h.LOCK\n",
    ],
)
def test_what_the_task_itself_holds_has_to_be_written_down(made: Made, text: str) -> None:
    with pytest.raises(ad.ArmDesignError, match="a lock that cannot be written down; give"):
        identity_of_function(made({"reached_h": HOLDER, "reached_task": text}))


def test_installed_modules_need_no_file(made: Made) -> None:
    made({"reached_pk/h": "", "reached_task": "import reached_pk.h\ntask = 1\n"})
    above = sys.modules["reached_pk"]
    assert not any(map(installed, (None, above, sys.modules["__main__"], ModuleType("x"))))
    above.__path__ = [str(Path(np.__file__).parent.parent / "some_namespace")]
    sys.modules["reached_pk.lazy"] = ModuleType("reached_pk.lazy")
    assert all(map(installed, (above, sys.modules["reached_pk.lazy"], sys, np, ad)))
