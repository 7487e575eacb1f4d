"""Compiled code kept for later processes: found again, mended, and only where nobody else may
write.
"""

from __future__ import annotations

import hashlib
import math
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

from armdesign import user_folders as folders
from armdesign.arrays import Array
from armdesign.simulation.plant import compiled as door

ROOT = os.geteuid() == 0
NOBODY = 65_534


def twice(x: float) -> float:
    return 2 * x


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that the user chose, as a process finds it that has just begun."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "kept"))
    started(monkeypatch)
    return tmp_path / "kept"


def started(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(door, "cache_folders", door.cache_folders.__wrapped__)


def called() -> bool:
    """Calls the function as a new process would; whether its code was found."""
    function: Any = door.compiled(twice)
    assert function(3.0) == 6.0
    return bool(function.stats.cache_hits)


def files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def test_what_was_compiled_is_found_again(kept: Path) -> None:
    assert [called(), called(), called()] == [False, True, True]
    assert len(files(kept)) == 1


@door.within
def root(x: float) -> float:
    if x < 0:
        raise ValueError("negative")
    return math.sqrt(x)


def sum_of_roots(values: Array) -> float:
    total = 0.0
    for i in range(len(values)):
        total += root(values[i])
    return total


def test_a_function_within_is_kept_with_its_caller(kept: Path) -> None:
    """It is called, and raises, in code of its caller: of this process and of a later one."""
    for found in (False, True):
        function: Any = door.borrowing(sum_of_roots)
        assert function(np.array([4.0, 9.0])) == 5.0
        with pytest.raises(ValueError, match="negative"):
            function(np.array([4.0, -9.0]))
        assert bool(function.stats.cache_hits) == found
    assert len(files(kept)) == 1


DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda whole: b"",
    "cut off": lambda whole: whole[: len(whole) // 2],
    "zeros": lambda whole: bytes(len(whole)),
    "text": lambda whole: b"no code at all\n",
    "a bit of its machine code": lambda whole: (
        whole[:5000] + bytes([whole[5000] ^ 1]) + whole[5001:]
    ),
    "another pickle": lambda whole: pickle.dumps(("version", {})),
    "sealed, but no pickle": lambda whole: hashlib.sha256(b"x").digest() + b"x",
    "sealed, for other types": lambda whole: (
        hashlib.sha256(pickle.dumps((1, 2))).digest() + pickle.dumps((1, 2))
    ),
}


@door.lent
def write_roots(values: Array, roots: Array) -> None:
    for i in range(len(values)):
        roots[i] = math.sqrt(values[i])


@door.borrowing
def write_by(write: Callable[[Array, Array], None], values: Array, written: Array) -> None:
    write(values, written)


def test_a_function_that_is_lent_is_not_part_of_those_that_call_it(kept: Path) -> None:
    values, written = np.array([4.0, 9.0]), np.empty(2)
    given = door.as_argument(write_roots, values, written)
    door.resolved(write_by, given, values, written)(given, values, written)
    assert written.tolist() == [2.0, 3.0]
    caller: Any = write_by
    assert not any("sqrt" in text for text in caller.inspect_llvm().values())
    lines: Any = write_roots
    assert any("sqrt" in text for text in lines.inspect_llvm().values())


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_file_is_compiled_again(damage: str, kept: Path) -> None:
    called()
    (file,) = files(kept)
    file.write_bytes(DAMAGES[damage](file.read_bytes()))
    assert [called(), called()] == [False, True]
    assert files(kept) == [file]


def test_a_folder_in_place_of_the_file_is_no_hindrance(kept: Path) -> None:
    called()
    (file,) = files(kept)
    file.unlink()
    file.mkdir()
    assert [called(), called()] == [False, False]


def test_a_full_disk_is_no_hindrance(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = Path.open

    def full(path: Path, mode: str = "r", *more: Any, **named: Any) -> Any:
        if mode == "xb":
            raise OSError(28, "No space left on device")
        return real(path, mode, *more, **named)

    monkeypatch.setattr(Path, "open", full)
    assert [called(), called()] == [False, False]


def test_without_any_place_nothing_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nowhere may be written: it compiles, and that is all."""
    monkeypatch.setattr(numba.config, "CACHE_DIR", "/proc/none")
    monkeypatch.setattr(door, "HERE", Path("/proc/self"))
    monkeypatch.setattr(
        folders, "of_user", lambda: iter([Path("/dev/null/a"), Path("/proc/none")])
    )
    started(monkeypatch)
    assert door.cache_folders() == ((), None)
    assert [called(), called()] == [False, False]


def test_the_folders_of_a_user_without_home(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """HOME cannot be made: a temporary folder with the user's number, which nobody else may
    read.
    """
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.setattr(door, "HERE", Path("/proc/self"))
    monkeypatch.setenv("HOME", "/proc/none")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    started(monkeypatch)
    assert [called(), called()] == [False, True]
    own = tmp_path / f"armdesign-{os.getuid()}"
    assert own.stat().st_mode & 0o777 == 0o700
    assert len(files(own)) == 1


# ------------------------------------------------------------------------------------------- trust


class Poison:
    """What runs when it is unpickled."""

    def __init__(self, place: Path) -> None:
        self.place = place

    def __reduce__(self) -> tuple[Callable[[str], None], tuple[str]]:
        return os.mkdir, (str(self.place),)


def poisoned(folder: Path, place: Path) -> None:
    """Every file of the folder, sealed as it should be, but by somebody else."""
    for file in files(folder):
        data = pickle.dumps(Poison(place))
        file.write_bytes(hashlib.sha256(data).digest() + data)


@pytest.mark.parametrize("mode", [0o777, 0o775, 0o757, 0o1777])
def test_a_folder_that_others_may_write_is_refused(
    mode: int,
    kept: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    called()
    (folder,) = {file.parent for file in files(kept)}
    poisoned(folder, tmp_path / "run")
    called()
    assert (tmp_path / "run").exists()  # which is why
    (tmp_path / "run").rmdir()
    folder.chmod(mode)
    capsys.readouterr()
    called()
    assert not (tmp_path / "run").exists()
    assert (
        capsys.readouterr().err.splitlines()[0]
        == f"armdesign: NUMBA_CACHE_DIR {kept}: others may write there, so it is not used; "
        "name a folder that is yours alone"
    )


@pytest.mark.parametrize(
    ("mode", "safe"), [(0o777, False), (0o775, False), (0o1777, True), (0o755, True)]
)
def test_nor_may_they_move_it_away(
    mode: int, safe: bool, kept: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Above the folder others may write where only owners may remove, as in /tmp."""
    kept.mkdir()
    kept.chmod(mode)
    called()
    assert bool(files(kept)) == safe
    assert ("others may write" in capsys.readouterr().err) != safe


def test_a_link_is_no_folder(kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    called()
    (folder,) = {file.parent for file in files(kept)}
    folder.rename(tmp_path / "elsewhere")
    folder.symlink_to(tmp_path / "elsewhere")
    assert not folders.made_private(folder)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    (tmp_path / f"armdesign-{os.getuid()}").symlink_to(tmp_path / "elsewhere")
    assert tmp_path / f"armdesign-{os.getuid()}" not in folders.temporary()


@pytest.mark.skipif(not ROOT, reason="only root may give files away")
def test_a_folder_of_somebody_else_is_refused(kept: Path) -> None:
    called()
    (folder,) = {file.parent for file in files(kept)}
    assert folders.made_private(folder)
    os.chown(folder, NOBODY, NOBODY)
    assert not folders.made_private(folder)
    os.chown(folder, 0, 0)
    os.chown(kept, NOBODY, NOBODY)
    assert not folders.made_private(folder)
    assert folders.made_private(folder, owner_of=kept)  # whose programs are run anyway


# --------------------------------------------------------------------------------------- processes

TRY = """
import os, sys
from armdesign.simulation.plant import compiled as door
import numba
numba.njit(lambda x: x)(1.0)  # what numba imports late it may not be able to as another user
user, *types = map(int, sys.argv[1:])
if user:
    os.setgroups([])
    os.setresgid(user, user, user)
    os.setresuid(user, user, user)
def twice(x):
    return 2 * x
function = door.compiled(twice)
for made in types:
    value = (0, 1, 1.0, 1j)[made]
    assert function(value) == 2 * value
print(sum(function.stats.cache_hits.values()), door.cache_folders()[1])
"""


def process(*words: int, **environment: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", TRY, *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **environment},
    )


def said(process: subprocess.Popen[str]) -> list[str]:
    out, err = process.communicate(timeout=60)
    assert (process.returncode, err) == (0, "")
    return out.split()


@pytest.mark.slow
def test_two_processes_compile_at_once(tmp_path: Path) -> None:
    """For different types, of which a later one finds both, each its own."""
    environment = {"NUMBA_CACHE_DIR": str(tmp_path)}
    both = [process(0, count, 2, **environment) for count in (1, 3)]
    assert [said(one)[0] for one in both]
    assert said(process(0, 1, 2, 3, **environment))[0] == "3"
    assert len(files(tmp_path)) == 3


@pytest.mark.slow
@pytest.mark.skipif(not ROOT, reason="only root may become somebody else")
def test_installed_by_another_user(tmp_path: Path) -> None:
    """Neither the package's folder nor HOME can be written: it runs, and later runs find what it
    compiled.
    """
    if Path(door.__file__).stat().st_uid != 0:
        pytest.skip("the package is not root's")
    temporary = Path("/tmp") / f"armdesign-test-{os.getpid()}"
    temporary.mkdir()
    temporary.chmod(0o1777)
    try:
        environment = {"HOME": "/nonexistent", "TMPDIR": str(temporary), "NUMBA_CACHE_DIR": ""}
        first, second = (said(process(NOBODY, 2, **environment)) for _ in range(2))
        assert first[0] == "0"
        assert first[1].startswith(str(temporary / f"armdesign-{NOBODY}"))
        assert second == ["1", first[1]]
    finally:
        subprocess.run(["rm", "-r", str(temporary)], check=True)


def test_with_numba_switched_off() -> None:
    words = [
        sys.executable,
        "-c",
        "from armdesign.simulation.plant.vectors import dot; print(dot((1, 2, 3), (4, 5, 6)))",
    ]
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    run = subprocess.run(words, capture_output=True, text=True, check=True, env=environment)
    assert (run.stdout, run.stderr) == ("32\n", "")
