"""Commands that are interrupted or fail while they write: all files or none."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

import armdesign as ad
from armdesign import cli
from armdesign.design import design
from armdesign.errors import ArmDesignError
from armdesign.output import command_line
from tests.commands import QUICK, assert_one_line, main, map_of

# ------------------------------------------------------------------------------------ interruption


def test_the_command_to_go_on_is_what_was_typed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Line ends and escape codes, which no terminal may see, are as bash and zsh read them."""
    words = [
        "map",
        "a b",
        "it's",
        '$x`"',
        "[1]",
        "--out=nl\nx",
        "esc\x1b[31m'\\q\u202e",
        "",
        "--new",
    ]
    monkeypatch.setattr(sys, "argv", ["armdesign", *words])
    line = command_line(without="--new")
    assert line.isprintable()
    script = line.replace("armdesign", "printf '%s\\0'", 1)
    environment = {**os.environ, "LC_ALL": "C.UTF-8"}
    said = subprocess.run(["bash", "-c", script], capture_output=True, check=True, env=environment)
    assert said.stdout.decode().split("\0")[:-1] == words[:-1]


@pytest.mark.slow
@pytest.mark.parametrize(
    "error", [OSError(28, "No space left on device"), ArmDesignError("part", "problem", "remedy")]
)
def test_a_failed_write_leaves_the_old_files(
    error: Exception,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """The CSV is written, then the second picture fails: neither is there, the files of the last
    run are.
    """
    from armdesign import plots

    assert main(map_of(tmp_path), monkeypatch) == 0
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    capfd.readouterr()

    def failing(fig: object, path: Path) -> Path:
        raise error

    monkeypatch.setattr(plots, "save", failing)
    assert main(map_of(tmp_path, "9"), monkeypatch) == 2
    assert capfd.readouterr().err.count("\n") == 1
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


LATE = """
import atexit, os, signal, sys, time
from armdesign import __main__, cli
def interrupt():
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(0.1)
if sys.argv.pop(1) == "after":
    main = cli.main
    def main_and_more():
        try:
            main()
        finally:
            interrupt()
    cli.main = main_and_more
else:
    atexit.register(interrupt)
__main__.main()
"""


@pytest.mark.parametrize(
    ("when", "code", "said"),
    [("at exit", 0, ""), ("after", 130, "armdesign: interrupted after its end\n")],
)
def test_an_interrupt_when_all_is_done(when: str, code: int, said: str) -> None:
    """While Python ends, where it would print a traceback, and just before: no traceback."""
    words = [sys.executable, "-c", LATE, when, "--version"]
    done = subprocess.run(words, capture_output=True, timeout=60, text=True, check=False)
    assert (done.returncode, done.stderr) == (code, said)
    assert done.stdout.startswith("armdesign ")


STRAY = """
import sys, time
from joblib.externals.loky.backend import get_context
from armdesign import cli
from armdesign.frequency import maps
def interrupted(*_, **__):
    get_context("loky").Process(target=time.sleep, args=(600,)).start()
    raise KeyboardInterrupt
maps.frequency_map = interrupted
sys.argv = ["armdesign", "map", "paper_1dof"]
cli.main()
"""


@pytest.mark.slow
def test_no_worker_outlives_an_interrupt() -> None:
    """One that started while it came, so that its pool does not know it, is waited for at exit."""
    words = [sys.executable, "-c", STRAY]
    done = subprocess.run(words, capture_output=True, timeout=60, text=True, check=False)
    assert done.stderr == "armdesign: interrupted; nothing was written\n"
    assert done.returncode == 130


WAITING = """
import sys, time
from armdesign import cli, plots
from armdesign.frequency import maps
def wait(*_, **__):
    print("ready", flush=True)
    time.sleep(60)
{}.{} = wait
sys.argv = ["armdesign", "map", "paper_1dof", "--points", "5"]
cli.main()
"""


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("where", [("maps", "frequency_map"), ("plots", "save")])
def test_ended_in_the_middle(
    number: signal.Signals, where: tuple[str, str], tmp_path: Path
) -> None:
    """By Ctrl-C, as a service ends or with the terminal, while computing or writing: no traceback,
    nothing written.
    """
    process = subprocess.Popen(
        [sys.executable, "-c", WAITING.format(*where)],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    process.send_signal(number)
    out, err = process.communicate(timeout=30)
    assert (process.returncode, out) == (128 + number, "")
    assert err.strip() == "armdesign: interrupted; nothing was written"
    assert not list(tmp_path.iterdir())


IMPORTING = """
import builtins, os, sys
from armdesign import cli
library, number, *sys.argv = sys.argv[1:]
real = builtins.__import__
def signalled(name, *rest, **named):
    if name == library and name not in sys.modules:
        os.kill(os.getpid(), int(number))
        module = real(name, *rest, **named)
        os.write(1, b"loaded")
        return module
    return real(name, *rest, **named)
builtins.__import__ = signalled
cli.main()
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    "library",
    [
        "pinocchio",
        pytest.param("cvxpy", marks=pytest.mark.slow),
        pytest.param("matplotlib.backends.backend_agg", marks=pytest.mark.slow),
    ],
)
def test_ended_while_a_library_is_loaded(
    library: str, number: signal.Signals, tmp_path: Path
) -> None:
    """An exception in the Python that its C++ runs as it is loaded ended in a fault of memory, an
    abort or a traceback, or was lost: the command went on.
    """
    words = ["armdesign", "optimize", "paper_1dof", "--points", "5", "--vary", "areas"]
    command = [sys.executable, "-c", IMPORTING, library, str(int(number)), *words]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert (run.returncode, run.stdout) == (128 + number, "loaded")
    assert run.stderr.startswith("armdesign: interrupted; ")
    assert run.stderr.count("\n") == 1


LOADING = """
import sys
class Ended:
    def find_spec(self, name, *_):
        if name == "armdesign.cli":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Ended())
from armdesign.__main__ import main
main()
"""


def test_ended_while_the_commands_are_loaded(tmp_path: Path) -> None:
    """Ctrl-C within the first tenth of a second was a traceback of Python's."""
    run = subprocess.run(
        [sys.executable, "-c", LOADING], cwd=tmp_path, capture_output=True, text=True
    )
    assert (run.returncode, run.stdout) == (130, "")
    assert run.stderr == "armdesign: interrupted before it began; nothing was written\n"


@pytest.mark.slow
def test_ended_while_files_move(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-C then waits until all of them are in place, and what is said is true."""
    real = os.replace

    def interrupted(source: str, target: str) -> None:
        os.kill(os.getpid(), signal.SIGINT)
        real(source, target)

    monkeypatch.setattr(os, "replace", interrupted)
    assert main(map_of(tmp_path), monkeypatch) == 130
    out, err = capsys.readouterr()
    assert out.startswith(f"wrote {', '.join(sorted(QUICK['map']))} to ")
    assert err.strip() == f"armdesign: interrupted; finished files are in {tmp_path}/"
    assert {path.name for path in tmp_path.iterdir()} == QUICK["map"]


def test_an_end_of_file_is_no_interruption(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """typer takes it for Ctrl-D; what a damaged file says of itself is not hidden behind that."""

    def ended(*_: object) -> None:
        raise EOFError("Ran out of input")

    monkeypatch.setattr("armdesign.frequency.maps.frequency_map", ended)
    monkeypatch.setattr(
        sys, "argv", ["armdesign", "map", "paper_1dof", "--points", "5", "--out", str(tmp_path)]
    )
    with pytest.raises(EOFError, match="Ran out of input"):
        cli.main()


@pytest.mark.slow
def test_a_folder_in_the_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "stiffness.csv").mkdir()
    assert main(map_of(tmp_path), monkeypatch) == 2
    assert_one_line(
        capfd.readouterr().err, "cannot be written (a folder named stiffness.csv is in the way)"
    )
    assert [path.name for path in tmp_path.iterdir()] == ["stiffness.csv"]


@pytest.mark.slow
def test_what_a_killed_run_left_behind_is_gone_with_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", WAITING.format("plots", "save")],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    out = tmp_path / "out" / "map_paper_1dof"
    assert [path.name[:9] for path in out.iterdir()] == [".writing-"]
    process.kill()
    process.communicate(timeout=30)
    assert list(out.iterdir())
    monkeypatch.chdir(tmp_path)
    # even one that is refused later
    assert main(["map", "paper_1dof", "--points", "1"], monkeypatch) == 2
    assert not list(out.iterdir())


@pytest.mark.slow
def test_a_trade_off_keeps_finished_values(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-C at the third of four values: two are written, and the command for the rest works: it
    writes what the undisturbed one writes.
    """
    from armdesign.sweeps import trade_offs

    real, values = trade_offs.best_frequency, ["0.97", "0.98", "0.99", "1.0"]
    calls = iter(values)

    def interrupted(*words: Any, **options: Any) -> Any:
        if next(calls) == "0.99":
            raise KeyboardInterrupt
        return real(*words, **options)

    monkeypatch.chdir(tmp_path)
    words = ["pareto", "paper_1dof", f"--values={','.join(values)}", "--vary", "areas"]
    words += ["--points", "9", "--workers", "1"]
    assert main([*words, "--out", "undisturbed"], monkeypatch) == 0
    assert not capsys.readouterr().err
    monkeypatch.setattr(trade_offs, "best_frequency", interrupted)
    assert main(words, monkeypatch) == 130
    out = Path("out", "pareto_paper_1dof")
    assert pd.read_csv(out / "pareto.csv")["limit"].to_list() == [0.97, 0.98]
    said = capsys.readouterr().err.strip()
    assert said == (
        "armdesign: interrupted at case 3 of 4; finished files are in out/pareto_paper_1dof/;"
        " what was finished is kept in out/pareto_paper_1dof/pareto.sqlite; go on with: armdesign"
        " pareto paper_1dof --values=0.97,0.98,0.99,1.0 --vary areas --points 9 --workers 1"
    )
    monkeypatch.setattr(trade_offs, "best_frequency", real)
    assert main(shlex.split(said.split("armdesign ")[-1]), monkeypatch) == 0
    assert "2 pieces were finished before" in capsys.readouterr().err
    for file in ("pareto.csv", "pareto.png"):
        assert (out / file).read_bytes() == Path("undisturbed", file).read_bytes()
    assert {path.name for path in out.iterdir()} == {"pareto.csv", "pareto.png"}


def test_an_answer_without_its_proof(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-C while a bound is sought: files and tables are there, and the bound is not."""

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(design, "certificate_within_bands", interrupted)
    words = ["optimize", "paper_1dof", "--points", "5", "--free", "--out", str(tmp_path)]
    assert main(words, monkeypatch) == 130
    said = capsys.readouterr()
    assert "no bound is known: interrupted" in said.out
    assert "a pose counts in percentiles" in said.out
    assert said.err.startswith("armdesign: interrupted; finished files are in ")
    assert (tmp_path / "paper_1dof_optimized.toml").exists()


@pytest.mark.slow
def test_a_design_outlives_its_validation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its machine file is there, and the same command need not find it again."""

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    def refused(*_: object) -> None:
        raise AssertionError("searched again")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("armdesign.simulation.validation.validate_maps", interrupted)
    words = ["design", "paper_1dof", "--points", "5", "--starts", "1"]
    assert main(words, monkeypatch) == 130
    out = Path("out/design_paper_1dof")
    assert capsys.readouterr().err.strip() == (
        "armdesign: interrupted; finished files are in out/design_paper_1dof/; what was finished"
        " is kept in out/design_paper_1dof/design.sqlite; go on with: armdesign design paper_1dof"
        " --points 5 --starts 1"
    )
    text = ad.load(out / "paper_1dof_optimized.toml").text
    monkeypatch.setattr("armdesign.design.optimize.multistart", refused)
    assert main(words, monkeypatch) == 130
    assert ad.load(out / "paper_1dof_optimized.toml").text == text
    capsys.readouterr()
    assert main([*words, "--json"], monkeypatch) == 130
    document = json.loads(capsys.readouterr().out)
    assert document["folder"] == str(out)
    assert document["files"] == ["paper_1dof.urdf", "paper_1dof_optimized.toml"]
