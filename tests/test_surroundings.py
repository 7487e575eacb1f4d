"""The command line in odd surroundings: it works, or says one clear line."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from armdesign.threads import processors
from tests.commands import ARMDESIGN, Refused, assert_one_line, run

ROOT = Path(__file__).parent.parent
CONSOLE = (  # as the installed command begins, whose own folder Python puts first
    "import sys; del sys.path[0]; from armdesign.__main__ import main; main()"
)
FULL = pytest.mark.skipif(not Path("/dev/full").exists(), reason="no full device here")


def test_as_a_module(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "armdesign", "--help"]
    run_of = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path)
    assert run_of.returncode == 0
    assert "--help" in run_of.stdout


def test_answers_stand_alone_on_stdout(tmp_path: Path) -> None:
    """A library in C prints there, as HiGHS does (a line of its own while it repairs a solution).

    It broke the document of --json.
    """
    by_a_library = "import ctypes; say = ctypes.CDLL(None).printf"
    code = f"{by_a_library}; from armdesign import cli; run = cli.main"
    code += "; cli.main = lambda: (say(b'repaired\\n'), run(), say(b'repaired\\n'))"
    words = ["map", "paper_1dof", "--points", "3", "--json"]
    code += f"; import sys; sys.argv = {['armdesign', *words]}"
    code += "; from armdesign.__main__ import main; main()"
    finished = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path
    )
    assert finished.returncode == 0, finished.stderr
    assert json.loads(finished.stdout)["finished"]


LIBRARIES = "psutil", "joblib", "glob", "numpy", "runpy", "typer"  # or that they import


@pytest.mark.slow
@pytest.mark.parametrize("starts", [["-m", "armdesign"], ["-c", CONSOLE]], ids=["m", "console"])
@pytest.mark.parametrize("workers", ["1", "2"])
def test_nothing_is_imported_from_the_current_folder(
    starts: list[str], workers: str, tmp_path: Path
) -> None:
    """Nor by the processes that a command begins: a folder of machines holds data."""
    for name in LIBRARIES:
        (tmp_path / f"{name}.py").write_text("open('run', 'a').close()")
    words = ["optimize", "paper_1dof", "--points", "3", "--workers", workers, "--quiet"]
    finished = subprocess.run(
        [sys.executable, *starts, *words], capture_output=True, text=True, cwd=tmp_path
    )
    assert (finished.returncode, finished.stderr) == (0, "")
    assert not (tmp_path / "run").exists()


def ending_with(module: str, said: str, asked: dict[str, str]) -> subprocess.CompletedProcess[str]:
    """A command in a process that says at its end what it knows of threads."""
    code = f"import atexit, sys, {module}; atexit.register(lambda: print({said}))"
    code += "; sys.argv = ['armdesign', 'check', 'no_such_machine']"
    code += "; from armdesign.__main__ import main; main()"
    kept = {name: value for name, value in os.environ.items() if "NUM_THREADS" not in name}
    words = [sys.executable, "-c", code]
    return subprocess.run(words, capture_output=True, text=True, env=kept | asked)


@pytest.mark.parametrize(("asked", "expected"), [({}, {1}), ({"OPENBLAS_NUM_THREADS": "2"}, {2})])
def test_one_thread_of_linear_algebra_unless_asked(
    asked: dict[str, str], expected: set[int]
) -> None:
    """Of numpy's OpenBLAS, where it has threads: more slow small matrices down."""
    if (os.cpu_count() or 1) < 2:
        pytest.skip("one core has one thread anyway")
    said = (
        "*(p['num_threads'] for p in threadpoolctl.threadpool_info() if p['user_api'] == 'blas')"
    )
    finished = ending_with("threadpoolctl", said, asked)
    assert {int(count) for count in finished.stdout.split()} == expected, finished.stderr


@pytest.mark.parametrize("asked", ["", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"])
def test_a_command_has_a_thread_for_each_processor_unless_asked(asked: str) -> None:
    finished = ending_with("armdesign.threads", "armdesign.threads._beside", {asked or "X": "1"})
    assert int(finished.stdout) == (1 if asked else processors()), finished.stderr


@pytest.mark.slow
def test_a_terminal_without_our_signs(tmp_path: Path) -> None:
    finished = run("check", "paper_1dof", folder=tmp_path, PYTHONIOENCODING="ascii")
    assert finished.returncode == 0, finished.stderr
    assert finished.stdout.isascii()
    assert "\\u" not in finished.stdout
    assert "\\x" not in finished.stdout
    framed = [line for line in finished.stdout.splitlines() if line.startswith("|")]
    assert any("deg" in line for line in framed)
    assert all(line.endswith("|") for line in framed)


@pytest.mark.slow
@FULL
@pytest.mark.parametrize("words", [["--help"], ["check", "paper_1dof"]])
def test_a_full_device(words: list[str], tmp_path: Path) -> None:
    with open("/dev/full", "w") as full:
        finished = subprocess.run(
            [*ARMDESIGN, *words], stdout=full, stderr=subprocess.PIPE, text=True, cwd=tmp_path
        )
    assert finished.returncode == 2
    assert_one_line(finished.stderr, "output: cannot be written (No space left on device)")
    with open("/dev/full", "w") as full:
        assert subprocess.run([*ARMDESIGN, "map", "x"], stderr=full, cwd=tmp_path).returncode == 2


@FULL
def test_a_full_device_without_buffers(tmp_path: Path) -> None:
    """Python keeps nothing then of what it could not write."""
    words = [sys.executable, "-u", *ARMDESIGN[1:], "check", "paper_1dof"]
    with open("/dev/full", "w") as full:
        finished = subprocess.run(words, stdout=full, stderr=-1, text=True, cwd=tmp_path)
    assert finished.returncode == 2
    assert_one_line(finished.stderr, "output: cannot be written (No space left on device)")


@pytest.mark.parametrize("buffered", [[], ["-u"]])
def test_an_error_of_a_connection_is_not_taken_for_one_of_stdout(buffered: list[str]) -> None:
    code = "from armdesign.streams import printing\nwith printing(): raise ConnectionError('lost')"
    finished = subprocess.run([sys.executable, *buffered, "-c", code], stderr=-1, text=True)
    assert finished.returncode == 1
    assert finished.stderr.splitlines()[-1] == "ConnectionError: lost"


def test_a_package_inside_a_wheel(tmp_path: Path) -> None:
    wheel = tmp_path / "armdesign-0-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        for path in sorted((ROOT / "armdesign").rglob("*.py")):
            archive.write(path, path.relative_to(ROOT))
    environment = {**os.environ, "PYTHONPATH": str(wheel)}
    finished = subprocess.run(
        [sys.executable, "-m", "armdesign", "check", "paper_1dof"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env=environment,
    )
    assert finished.returncode == 2, finished.stderr
    assert_one_line(finished.stderr, f"cannot run from within {wheel}; install it: pip install")
    library = "import armdesign as ad; ad.load('paper_1dof')"
    words = [sys.executable, "-c", library]
    finished = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path, env=environment)
    assert f"cannot run from within {wheel}; install it" in finished.stderr.splitlines()[-1]


@pytest.mark.parametrize("name", ["con", "NUL", "Com1"])
def test_devices_of_windows(name: str, refused: Refused) -> None:
    refused(["new", name], f'"{name}" is a device of Windows, not a file')


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["map", "paper_1dof", "--set", "a" + 20_000 * ".a" + "=1"], "has no such number"),
        (["pareto", "paper_1dof", "--values", "1e300"], "--values: 1e+300 of today's"),
        (["map", ""], "map: is followed by an empty word; give a value, or leave it out"),
        (["identify", ""], "identify: is followed by an empty word"),
        (["optimize", "paper_1dof", "--vary", ""], "--vary: is followed by an empty word"),
        (["what-if", "paper_1dof", ""], "paper_1dof: is followed by an empty word"),
        (["what-if", "paper_1dof", " "], 'what-if: " " is not understood'),
        (["map", "paper_1dof", "--out="], "--out: is followed by an empty word"),
        (["optimize", "paper_1dof", "--vary", ","], "vary: () is not allowed"),
    ],
)
def test_empty_and_huge_options(words: list[str], message: str, refused: Refused) -> None:
    refused(words, message)


BOUND = "-dac_override,-dac_read_search"  # what lets root read whatever is forbidden
AS_OTHERS = ["setpriv", "--inh-caps", BOUND, "--bounding-set", BOUND] if os.geteuid() == 0 else []


@pytest.mark.skipif(bool(AS_OTHERS) and not shutil.which("setpriv"), reason="root reads all")
@pytest.mark.parametrize("words", [["map", "shut"], ["check", "shut/x.toml"]])
def test_a_machine_in_a_folder_that_may_not_be_read(words: list[str], tmp_path: Path) -> None:
    (tmp_path / "shut").mkdir(mode=0)
    finished = subprocess.run(
        [*AS_OTHERS, *ARMDESIGN, *words], cwd=tmp_path, capture_output=True, text=True
    )
    assert finished.returncode == 2, finished.stderr
    assert_one_line(finished.stderr, f"{words[1]}: cannot be read (Permission denied); check the")


@pytest.mark.parametrize("command", [pytest.param("validate", marks=pytest.mark.slow), "design"])
def test_without_the_compiler(command: str, tmp_path: Path) -> None:
    """A design would be validated by nothing but failures."""
    finished = run(command, "paper_1dof", "--points", "3", folder=tmp_path, NUMBA_DISABLE_JIT="1")
    assert finished.returncode == 2
    assert_one_line(finished.stderr, "NUMBA_DISABLE_JIT: simulations need numba's compiler")
    assert not list(tmp_path.iterdir())
    assert run("check", "paper_1dof", folder=tmp_path, NUMBA_DISABLE_JIT="1").returncode == 0


@pytest.mark.skipif(os.name == "nt", reason="a folder that is in use cannot go")
def test_nothing_is_compiled_in_a_folder_that_is_gone(tmp_path: Path) -> None:
    """It ended in a traceback of numba's, and `python -m armdesign` in one of its own."""
    code = 'import os, sys\nos.mkdir("gone")\nos.chdir("gone")\nos.rmdir("../gone")\n'
    code += "os.execv(sys.executable, sys.argv[1:])"
    words = [*ARMDESIGN, "validate", "paper_1dof", "--points", "3", "--out", str(tmp_path / "o")]
    done = subprocess.run(
        [sys.executable, "-c", code, *words],
        cwd=tmp_path,
        env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "new"), "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert_one_line(
        done.stderr,
        "numba: cannot compile (No such file or directory); begin in a folder that is there",
    )


def test_pictures_have_a_folder_for_fonts_before_matplotlib_looks_for_one() -> None:
    """It was imported with them: without a home it said so in two lines of its own."""
    code = "import sys, armdesign.plots; print('matplotlib' in sys.modules)"
    finished = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert finished.stdout == "False\n", finished.stderr


@pytest.mark.parametrize(
    ("variable", "value", "words", "message"),
    [
        ("MPLBACKEND", "foo", ("draw", "paper_1dof"), ""),
        ("MPLBACKEND", "module://nothing", ("draw", "paper_1dof"), ""),
        ("NUMBA_NUM_THREADS", "0", ("validate", "paper_1dof"), "numba: does not begin ("),
    ],
)
def test_variables_that_libraries_cannot_have(
    variable: str, value: str, words: tuple[str, ...], message: str, tmp_path: Path
) -> None:
    finished = run(*words, folder=tmp_path, **{variable: value})
    assert finished.returncode == (2 if message else 0), finished.stderr
    if message:
        assert_one_line(finished.stderr, message)
    else:
        assert "Traceback" not in finished.stderr
