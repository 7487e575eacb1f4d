"""Files that change as one: whatever fails, and wherever the process is killed, all are old or all
are new.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from armdesign import transaction
from armdesign.transaction import mend, staged

OLD = {"a.csv": "old", "notes.txt": "mine", "sub/b.png": "old"}
NEW = {"a.csv": "new", "c.csv": "new", "other/d.toml": "new", "sub/b.png": "new"}
AFTER = OLD | NEW

# Each try in a process of its own that kills itself before its n-th step on the file system, or
# lets it fail.
KILLED = """
import os, shutil, signal, sys
from pathlib import Path
from tests.test_transaction import OLD, NEW, AFTER, contents, fill, write
from armdesign.transaction import mend, staged

STEPS = {"os.rename", "os.link", "os.remove", "os.rmdir", "os.mkdir", "open", "tempfile.mkdtemp"}
root = Path(sys.argv[1])

def tried(work, place, kill, fail=None):
    "Whether the work ended before it was killed."
    child = os.fork()
    if not child:
        count = dict.fromkeys(("all", "os.rename"), 0)
        def hook(event, args):
            if event in STEPS:
                count["all"] += 1
                count["os.rename"] += event == "os.rename"
                if event == "os.rename" and count["os.rename"] == fail:
                    raise OSError(5, "Input/output error")
                if count["all"] == kill:
                    os.kill(os.getpid(), signal.SIGKILL)
        sys.addaudithook(hook)
        try:
            work(place)
        except OSError:
            os._exit(3)
        os._exit(0)
    status = os.waitpid(child, 0)[1]
    return not os.WIFSIGNALED(status)

def fresh():
    shutil.rmtree(root / "out", ignore_errors=True)
    fill(root / "out", OLD)
    return root / "out"

seen = []
for fail in (None, 2, 4):
    for kill in range(1, 1000):
        place = fresh()
        ended = tried(write, place, kill, fail)
        again = 1
        while not tried(mend, place, again):  # which is killed a step later each time
            again += 1
        mend(place)
        found = contents(place)
        assert found in (OLD, AFTER), (fail, kill, found)
        seen.append((fail, found == AFTER, ended))
        if ended:
            break
    assert kill > 20
assert (None, False, False) in seen and (None, True, False) in seen and (None, True, True) in seen
assert (2, True, False) not in [(f, a, e) for f, a, e in seen if e]
print(len(seen))
"""


def fill(place: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_text(text)


def contents(place: Path) -> dict[str, str]:
    return {
        str(path.relative_to(place)): path.read_text()
        for path in place.rglob("*")
        if path.is_file()
    }


def write(place: Path) -> None:
    with staged(place) as folder:
        fill(folder, NEW)


@pytest.fixture
def place(tmp_path: Path) -> Path:
    fill(tmp_path / "out", OLD)
    return tmp_path / "out"


# ------------------------------------------------------------------------------------- all or none


def test_new_files_replace_old_ones_and_leave_others(place: Path) -> None:
    write(place)
    assert contents(place) == AFTER
    assert sorted(path.name for path in place.iterdir()) == [
        "a.csv",
        "c.csv",
        "notes.txt",
        "other",
        "sub",
    ]


@pytest.mark.parametrize("name", [*NEW, "other"])
def test_what_is_in_the_way_is_seen_before_anything_moves(name: str, place: Path) -> None:
    """A folder with the name of a file, and a file with the name of a folder."""
    if (place / name).is_file():
        (place / name).unlink()
    if name == "other":
        (place / name).write_text("a file")
    else:
        (place / name).mkdir(parents=True)
    before = contents(place)
    with pytest.raises(OSError, match=r"is in the way|is not a folder"):
        write(place)
    assert contents(place) == before
    assert not list(place.glob(".*"))


@pytest.mark.parametrize("number", range(1, 6))
def test_a_move_that_fails_is_undone(
    number: int, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The journal's own move, then each file's; what failed once fails again, so undoing must not
    need it.
    """
    calls, real = [0], os.replace

    def failing(source: str, target: str) -> None:
        calls[0] += 1
        if calls[0] >= number:
            raise OSError(28, "No space left on device")
        real(source, target)

    monkeypatch.setattr(os, "replace", failing)
    with pytest.raises(OSError, match="No space left"):
        write(place)
    assert calls[0] >= number
    assert contents(place) == OLD
    assert sorted(path.name for path in place.iterdir()) == ["a.csv", "notes.txt", "sub"]


def test_without_hard_links_the_old_files_are_copied(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none(*_: object, **__: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "link", none)
    real, calls = os.replace, [0]

    def failing(source: str, target: str) -> None:
        calls[0] += 1
        if calls[0] == 4:
            raise OSError(5, "Input/output error")
        real(source, target)

    monkeypatch.setattr(os, "replace", failing)
    with pytest.raises(OSError, match="Input"):
        write(place)
    assert contents(place) == OLD
    write(place)
    assert contents(place) == AFTER


def test_a_link_is_replaced_and_not_followed(place: Path) -> None:
    (place / "a.csv").rename(place.parent / "elsewhere.csv")
    (place / "a.csv").symlink_to(place.parent / "elsewhere.csv")
    write(place)
    assert not (place / "a.csv").is_symlink()
    assert (place.parent / "elsewhere.csv").read_text() == "old"


def test_folders_made_for_nothing_are_removed(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="given up"), staged(tmp_path / "deep" / "er"):
        raise ValueError("given up")
    assert not list(tmp_path.iterdir())


# ------------------------------------------------------------------------------------------ killed


@pytest.mark.slow
def test_killed_at_any_step_all_files_are_old_or_new(tmp_path: Path) -> None:
    """Before every step of a move, of one that fails and is undone, and of what mends it, killed
    again and again.
    """
    words, root = [sys.executable, "-c", KILLED, str(tmp_path)], Path(__file__).parents[1]
    done = subprocess.run(words, cwd=root, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr[-2000:]
    assert int(done.stdout) > 100


def left_behind(place: Path, journal: dict[str, list[str]]) -> Path:
    """What a process leaves that was killed before its first move."""
    root = place / ".writing-abcd1234"
    fill(root / "new", {"a.csv": "new", "c.csv": "new"})
    fill(root / "old", {"a.csv": "old"})
    (root / "moving").write_text(json.dumps(journal | {"folders": []}))
    root.chmod(0o700)
    return root


def test_the_next_run_ends_what_a_killed_one_began(place: Path) -> None:
    left_behind(place, {"files": ["a.csv", "c.csv"], "replaced": ["a.csv"]})
    mend(place)
    assert contents(place) == OLD | {"a.csv": "new", "c.csv": "new"}


@pytest.mark.parametrize("file", ["../out of it.csv", "/tmp/out of it.csv"])
def test_a_journal_that_leads_out_of_the_folder_is_not_followed(file: str, place: Path) -> None:
    root = left_behind(place, {"files": [file], "replaced": [file]})
    mend(place)
    assert root.exists()
    assert not (place / file).exists()


def test_folders_that_others_may_have_made_are_left_alone(place: Path) -> None:
    root = left_behind(place, {"files": ["a.csv", "c.csv"], "replaced": ["a.csv"]})
    root.chmod(0o755)
    mend(place)
    assert (place / "a.csv").read_text() == "old"
    assert root.exists()


def test_a_living_run_is_left_alone(place: Path) -> None:
    """Its lock tells: another run mends and writes meanwhile, and the first ends as if alone."""
    with staged(place) as folder:
        fill(folder, {"a.csv": "first"})
        mend(place)
        write(place)
        assert contents(folder) == {"a.csv": "first"}
    assert contents(place) == AFTER | {"a.csv": "first"}


def test_two_runs_at_a_time_do_not_mix(place: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from armdesign.transaction import staged\n"
        "for i in range(40):\n"
        "    with staged(Path(sys.argv[1])) as folder:\n"
        "        for name in 'abcdefgh':\n"
        "            (folder / name).write_text(f'{sys.argv[2]} {i}')\n"
    )
    both = [
        subprocess.Popen([sys.executable, "-c", code, str(place), name]) for name in ("one", "two")
    ]
    assert [process.wait(60) for process in both] == [0, 0]
    assert len({(place / name).read_text() for name in "abcdefgh"}) == 1
    assert not list(place.glob(".*"))


# ----------------------------------------------------------------------------------------- signals


@pytest.mark.parametrize("number", transaction.ENDS)
def test_a_signal_waits_for_the_end_of_the_move(
    number: signal.Signals, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = os.replace
    if signal.getsignal(number) == signal.SIG_IGN:
        pytest.skip("ignored where the tests were started, by nohup say; so it stays")

    def interrupted(source: str, target: str) -> None:
        os.kill(os.getpid(), number)
        real(source, target)

    monkeypatch.setattr(os, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt), transaction.as_interrupt() as came:
        write(place)
    assert contents(place) == AFTER
    assert set(came) <= {number}
    assert bool(came) == (number != signal.SIGINT)


def test_other_threads_write_too(place: Path) -> None:
    """Where Python takes no signals."""
    failed: list[BaseException] = []

    def work(write: Callable[[Path], None]) -> None:
        try:
            write(place)
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=work, args=(write,))
    thread.start()
    thread.join()
    assert not failed
    assert contents(place) == AFTER


def test_an_interrupt_where_exceptions_are_ignored_comes_again() -> None:
    """In a finalizer; without the hook Python writes "Exception ignored", and goes on."""

    class Late:
        def __del__(self) -> None:
            raise KeyboardInterrupt

    def lost() -> None:
        late = Late()
        del late
        time.sleep(5)

    before = sys.unraisablehook
    with pytest.raises(KeyboardInterrupt), transaction.as_interrupt():
        lost()
    assert sys.unraisablehook is before


def test_other_ignored_exceptions_are_told(capsys: pytest.CaptureFixture[str]) -> None:
    class Faulty:
        def __del__(self) -> None:
            raise ValueError("late")

    with transaction.as_interrupt():
        faulty = Faulty()
        del faulty
    assert "ValueError: late" in capsys.readouterr().err
