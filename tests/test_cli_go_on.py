"""Long commands killed or interrupted at random moments, and again: the same command goes on with
what was finished, and writes what the undisturbed one writes, to the last digit.
"""

from __future__ import annotations

import errno
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from armdesign import transaction
from tests.commands import assert_one_line, main

PARETO = "pareto paper_1dof --points 5 --vary areas --out out"
CASES = [
    (signal.SIGKILL, "optimize paper_1dof --points 5 --out out"),
    (signal.SIGINT, f"{PARETO} --values 0.9,1.0,1.1 --workers 1"),
    (signal.SIGKILL, f"{PARETO} --values 0.9,1.0,1.1 --workers 1"),
    (signal.SIGKILL, f"{PARETO} --values 0.9,0.95,1.0,1.02,1.05,1.07,1.1,1.15,1.2 --workers 2"),
    (signal.SIGKILL, "validate paper_1dof --points 5 --out out"),
    (signal.SIGKILL, "design paper_1dof --points 3 --starts 1 --out out"),
    (signal.SIGKILL, "paper --out out"),
]

# The command in children of a process that has opened all libraries; each is ended at a random
# moment until one comes to its end. On a busy machine the first moments may all lie before the
# journal is opened: then there are more, later ones.
DISTURBED = """
import os, random, re, shlex, shutil, signal, sqlite3, sys, time
from pathlib import Path
from armdesign import cli

words, number, moments = shlex.split(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])

def child(folder):
    Path(folder).mkdir(exist_ok=True)
    process = os.fork()
    if process:
        return process
    os.chdir(folder)
    for stream, name in ((1, "stdout"), (2, "stderr")):
        os.dup2(os.open(f"../{name}", os.O_CREAT | os.O_WRONLY | os.O_TRUNC), stream)
    sys.argv = ["armdesign", *words]
    code = 0
    try:
        cli.main()
    except SystemExit as end:
        code = end.code or 0
    sys.stdout.flush()
    os._exit(code)

def ended(process):
    status = os.waitpid(process, 0)[1]
    return os.waitstatus_to_exitcode(status)

def files(folder):  # a report tells its hour
    every = (p for p in Path(folder, "out").rglob("*") if p.is_file())
    whole = {str(p.relative_to(folder)): p.read_bytes() for p in every}
    return {name: b"" if "report" in name else data for name, data in whole.items()}

def finished():
    # pieces that the disturbed run's journal has; of a copy, so that it stays as it is
    pieces = 0
    for journal in Path("disturbed/out").glob("*.sqlite"):
        shutil.rmtree("copy", ignore_errors=True)
        Path("copy").mkdir()
        for path in journal.parent.glob(journal.name + "*"):
            shutil.copy(path, "copy")
        with sqlite3.connect(Path("copy", journal.name)) as copy:
            if copy.execute("SELECT 1 FROM sqlite_master WHERE name = 'cases'").fetchone():
                pieces += copy.execute("SELECT count(*) FROM cases").fetchone()[0]
        copy.close()
    return pieces

for folder in ("warm", "undisturbed"):
    began = time.monotonic()
    assert ended(child(folder)) == 0, Path("stderr").read_text()
    seconds = time.monotonic() - began

random.seed(1)
left = kills = 0
while True:
    had = finished()
    process = child("disturbed")
    disturbs = kills < moments or not left and kills < 10 * moments
    if disturbs:
        seconds *= 1.2 if kills >= moments else 1
        time.sleep(random.uniform(0.2, 0.9) * seconds)
        os.kill(process, number)
        kills += 1
    code = ended(process)
    journals = list(Path("disturbed/out").glob("*.sqlite"))
    left += len(journals)
    if code == 0:
        assert not journals
        assert files("disturbed") == files("undisturbed")
        # what was finished is taken; pieces of a finished piece are not asked for
        said = Path("stderr").read_text()
        again = re.findall(r"(\\d+) pieces? (?:was|were) finished before", said)
        assert (0 < int(again[0]) <= had) if had else not again, (had, said)
        if not disturbs:
            break
        for path in Path("disturbed/out").iterdir():
            path.unlink()
    elif number == signal.SIGINT:
        said = Path("stderr").read_text()
        assert code == 130, said
        if "what was finished is kept in out/" in said:
            command = shlex.join(["armdesign", *words])
            assert journals and said.endswith(f"go on with: {command}\\n"), said
        else:  # before the journal was opened, or after the files were in place
            assert "nothing was written" in said or "finished files are in out/" in said, said
    else:
        assert code == -number, Path("stderr").read_text()
assert left, "no run left anything to go on with"
print(kills, left)
"""


@pytest.mark.slow
@pytest.mark.parametrize(("number", "command"), CASES)
def test_ended_at_random_moments(number: signal.Signals, command: str, tmp_path: Path) -> None:
    words = [sys.executable, "-c", DISTURBED, command, str(int(number)), "4"]
    run = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=600)
    assert run.returncode == 0, run.stderr


def test_a_full_disk_as_files_are_written_says_what_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Another folder was named, in which all begins anew."""
    words = [*shlex.split("optimize paper_1dof --vary areas --points 5 --out"), str(tmp_path)]

    def full(place: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(transaction, "staged", full)
        assert main(words, monkeypatch) == 2
    journal = tmp_path / "optimize.sqlite"
    kept = f"what was finished is kept in {journal}"
    remedy = f"make room and run it again, or name another folder; {kept}"
    assert_one_line(capfd.readouterr().err, f"(No space left on device); {remedy}")
    assert journal.exists()
    assert main(words, monkeypatch) == 0
    assert not journal.exists()
