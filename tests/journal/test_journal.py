"""The journal: what is in it stays, and what it cannot be used for is said in words."""

from __future__ import annotations

import contextlib
import math
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from armdesign import ArmDesignError
from armdesign.journal import lock as journal_lock
from armdesign.journal.journal import HEAD, MAGIC, Entry, Journal
from armdesign.journal.keys import digest

FILES = {"a.toml": "1", "a.urdf": "2"}
HOLD = """
import sys, time
from pathlib import Path
from armdesign.journal.journal import Entry, Journal
with Journal(Path(sys.argv[1]), {"a.toml": "1", "a.urdf": "2"}, "1.0", False) as journal:
    journal.keep("k", "case", Entry(answer={"x": 1.5}, seconds=0.1))
    print("open", flush=True)
    time.sleep(60)
"""


def opened(path: Path, new: bool = False, version: str = "1.0", **files: str) -> Journal:
    return Journal(
        path, {**FILES, **{f"a.{end}": text for end, text in files.items()}}, version, new
    )


def filled(path: Path, count: int = 40) -> dict[str, Entry]:
    with opened(path) as journal:
        for number in range(count):
            answer = {"f_hz": math.sqrt(number), "word": "ä" * 50, "list": number}
            journal.keep(digest(number), f"case {number}", Entry(answer=answer, seconds=0.1))
        return journal.entries()


def test_numbers_come_back_with_every_bit(tmp_path: Path) -> None:
    numbers = np.random.default_rng(0).standard_normal(200) * 10.0 ** np.arange(-100, 100)
    answer = {str(n): float(x) for n, x in enumerate(numbers)}
    answer |= {"inf": math.inf, "tiny": 5e-324, "zero": -0.0}
    with opened(tmp_path / "j.sqlite") as journal:
        journal.keep("k", "case", Entry(answer=answer, seconds=0.1, error=""))
    with opened(tmp_path / "j.sqlite") as journal:
        back = journal.entries()["k"].answer
    assert {name: repr(x) for name, x in back.items()} == {n: repr(x) for n, x in answer.items()}


def test_a_second_run_is_refused_and_a_killed_one_leaves_no_lock(tmp_path: Path) -> None:
    path = tmp_path / "j.sqlite"
    words = [sys.executable, "-c", HOLD, str(path)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout
        assert other.stdout.readline() == "open\n"
        for new in (False, True):
            with pytest.raises(ArmDesignError, match="another run writes it"):
                opened(path, new)
        other.send_signal(signal.SIGKILL)
    with opened(path) as journal:
        assert journal.entries()["k"].answer == {"x": 1.5}


def test_other_files_and_versions_are_named_and_set_aside(tmp_path: Path) -> None:
    path = tmp_path / "j.sqlite"
    filled(path, 2)
    with pytest.raises(ArmDesignError, match=r"another state of a\.urdf; .*--set .*--new"):
        opened(path, urdf="changed")
    with pytest.raises(ArmDesignError, match=r"written by armdesign 1\.0, this is 2\.0; .*--new"):
        opened(path, version="2.0")
    with opened(path, new=True, urdf="changed") as journal:
        assert not journal.entries()
    with opened(tmp_path / "j.1.sqlite") as journal:
        assert len(journal.entries()) == 2


def test_a_file_that_is_no_journal_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "j.sqlite"
    for text in ("text", "text " * 300):
        path.write_text(text)
        for new in (False, True):
            with pytest.raises(ArmDesignError, match="is no journal; move it elsewhere, or"):
                opened(path, new)
        assert path.read_text() == text
    path.unlink()
    with sqlite3.connect(path) as other:
        other.execute("CREATE TABLE t (x)")
    other.close()
    before = path.read_bytes()
    for new in (False, True):
        with pytest.raises(ArmDesignError, match="is no journal"):
            opened(path, new)
    assert path.read_bytes() == before
    os.mkfifo(tmp_path / "fifo")
    for place in (tmp_path, tmp_path / "fifo", Path("/dev/null"), Path(""), Path("a\0b")):
        with pytest.raises(ArmDesignError, match="is no regular file"):
            opened(place)
    with pytest.raises(ArmDesignError, match=r"^a{60}: cannot be written \(File name too long\);"):
        opened(Path("a" * 300))


@pytest.mark.parametrize("what", ["nothing", "second run", "copy"])
def test_a_journal_is_locked_whatever_its_own_process_does(tmp_path: Path, what: str) -> None:
    """POSIX drops the locks of a process, SQLite's too, when any part of it closes the file."""
    path = tmp_path / "j.sqlite"
    with opened(path) as journal:
        journal.keep("a", "case", Entry(answer={"x": 1}, seconds=0.1))
        if what == "second run":
            with pytest.raises(ArmDesignError, match="another run writes it"):
                opened(path)
        elif what == "copy":
            shutil.copy(path, tmp_path / "copy")
        other = subprocess.run([sys.executable, "-c", HOLD, str(path)], stderr=-1, text=True)
        assert "another run writes it" in other.stderr
    with opened(path) as journal:
        assert list(journal.entries()) == ["a"]


def test_a_journal_goes_before_another_run_can_have_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, remove = tmp_path / "folder" / "j.sqlite", Journal._remove

    def slowly(journal: Journal) -> None:
        with pytest.raises(ArmDesignError, match="another run writes it; wait for that"):
            opened(path)
        remove(journal)

    monkeypatch.setattr(Journal, "_remove", slowly)
    with opened(path):
        pass
    assert not path.parent.exists()


@pytest.mark.parametrize("anew", [False, True])
def test_what_is_locked_is_what_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, anew: bool
) -> None:
    """The file that was opened went, with its folder, before it was locked."""
    path, lock = tmp_path / "folder" / "j.sqlite", journal_lock._lock

    def too_late(descriptor: int) -> None:
        monkeypatch.setattr(journal_lock, "_lock", lock)
        path.unlink()
        if anew:
            path.touch()
        else:
            path.parent.rmdir()
        lock(descriptor)

    monkeypatch.setattr(journal_lock, "_lock", too_late)
    filled(path, 2)
    with opened(path) as journal:
        assert len(journal.entries()) == 2


def test_a_forked_process_does_not_hold_the_lock_on(tmp_path: Path) -> None:
    fork = "    import os\n    os.fork() or time.sleep(60)\n    os._exit(0)"  # as if killed
    words = [sys.executable, "-c", HOLD.replace("    time.sleep(60)", fork), tmp_path / "j.sqlite"]
    with subprocess.Popen(words, stdout=-1, text=True, start_new_session=True) as parent:
        assert parent.stdout
        assert parent.stdout.readline() == "open\n"
        parent.wait()
        try:
            with opened(tmp_path / "j.sqlite") as journal:
                assert list(journal.entries()) == ["k"]
        finally:
            os.killpg(parent.pid, signal.SIGKILL)


def test_a_journal_stays_where_it_began_wherever_a_task_goes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    for folder in (here, there):
        folder.mkdir()
    (there / "j.sqlite").write_text("a user's")
    monkeypatch.chdir(here)
    with opened(Path("j.sqlite")):
        os.chdir(there)
    assert (there / "j.sqlite").read_text() == "a user's"
    assert not list(here.iterdir())


@pytest.mark.parametrize("there", [False, True])
def test_a_link_is_not_followed(there: bool, tmp_path: Path) -> None:
    (tmp_path / "j.sqlite").symlink_to(tmp_path / "elsewhere.sqlite")
    if there:
        (tmp_path / "elsewhere.sqlite").touch()
    with pytest.raises(ArmDesignError, match="is a link; remove it, or name another"):
        opened(tmp_path / "j.sqlite")
    assert [*tmp_path.glob("elsewhere*")] == [tmp_path / "elsewhere.sqlite"] * there
    assert not there or (tmp_path / "elsewhere.sqlite").read_bytes() == b""


def test_a_journal_without_a_case_goes_with_its_folders(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b" / "j.sqlite"
    with opened(path):
        assert path.exists()
    assert not list(tmp_path.iterdir())
    filled(path, 1)
    with opened(path):
        pass
    assert path.exists()


@pytest.mark.parametrize("name", [":memory:", "file:j"])
def test_a_name_is_that_of_a_file_whatever_sqlite_reads_in_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    filled(Path(name), 2)
    assert Path(name).is_file()
    with opened(Path(name)) as journal:
        assert len(journal.entries()) == 2


@pytest.mark.parametrize("name", ["CAST(x'ff61' AS TEXT)", "CAST(name AS BLOB)", "'another'"])
def test_a_text_that_is_none_any_more_or_another_is_damage(tmp_path: Path, name: str) -> None:
    path = tmp_path / "j.sqlite"
    filled(path, 1)
    with contextlib.closing(sqlite3.connect(path)) as other, other:
        other.execute(f"UPDATE cases SET name = {name}")
    with opened(path) as journal:
        for read in (journal.entries, journal.names):
            with pytest.raises(ArmDesignError, match="is damaged"):
                read()


@pytest.mark.parametrize(
    "answer", ["[1]", "5", "null", "{x", "[" * 100_000, '{"x": ' + "9" * 5000 + "}"]
)
def test_what_is_no_answer_is_damage(tmp_path: Path, answer: str) -> None:
    """Also where the digest beside it is its own."""
    path = tmp_path / "j.sqlite"
    filled(path, 1)
    row = ["k", "case", answer, 0.1, ""]
    with contextlib.closing(sqlite3.connect(path)) as other, other:
        other.execute("INSERT INTO cases VALUES (?, ?, ?, ?, ?, ?)", [*row, digest(row)])
    before = path.read_bytes()
    with opened(path) as journal, pytest.raises(ArmDesignError, match="is damaged"):
        journal.entries()
    assert path.read_bytes() == before


@pytest.mark.parametrize(("byte", "bit"), [("cases", 7), ("CREATE TABLE", 7), ("about", 0)])
def test_a_flipped_bit_in_what_the_tables_are_is_damage(
    tmp_path: Path, byte: str, bit: int
) -> None:
    """SQLite says it with the byte, which is no text; what is there can be set aside."""
    path = tmp_path / "j.sqlite"
    filled(path, 1)
    spoilt = bytearray(path.read_bytes())
    spoilt[spoilt.index(byte.encode())] ^= 1 << bit
    path.write_bytes(spoilt)
    with pytest.raises(ArmDesignError, match="is damaged; restore a copy"):
        opened(path)
    assert path.read_bytes() == spoilt
    with opened(path, new=True) as journal:
        assert not journal.entries()
    assert (tmp_path / "j.1.sqlite").read_bytes() == spoilt


def test_a_folder_where_its_log_would_be_is_no_damage(tmp_path: Path) -> None:
    path = tmp_path / "j.sqlite"
    (tmp_path / "j.sqlite-wal").mkdir()
    with pytest.raises(ArmDesignError, match="-wal: is no regular file; move it"):
        opened(path)
    assert not path.exists()


@pytest.mark.parametrize(
    "spoilt",
    [
        "DELETE FROM about WHERE name = 'version'",
        "UPDATE about SET value = CAST(value AS BLOB) WHERE name = 'version'",
        "UPDATE about SET value = '{' WHERE name = 'files'",
        "UPDATE about SET value = '[1]' WHERE name = 'files'",
        "PRAGMA writable_schema = ON; UPDATE sqlite_master SET sql = CAST(sql AS BLOB)"
        " WHERE name = 'about'",
        "DROP TABLE cases",
        "DROP TABLE cases; CREATE VIEW cases AS WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL"
        " SELECT x + 1 FROM n) SELECT x AS key, x AS name, x AS answer FROM n",
        "ALTER TABLE about RENAME TO old; CREATE VIEW about AS WITH RECURSIVE n(x) AS"
        " (SELECT 1 UNION ALL SELECT x + 1 FROM n) SELECT x AS name, x AS value FROM n",
        "CREATE TRIGGER t AFTER INSERT ON cases BEGIN DELETE FROM cases; END",
    ],
)
def test_a_journal_without_what_it_must_hold_is_damaged(tmp_path: Path, spoilt: str) -> None:
    filled(tmp_path / "j.sqlite")
    database = sqlite3.connect(tmp_path / "j.sqlite")
    database.executescript(spoilt)
    database.commit()
    database.close()
    with pytest.raises(ArmDesignError, match="is damaged"):
        opened(tmp_path / "j.sqlite")


def test_a_journal_without_its_head_is_damaged(tmp_path: Path) -> None:
    """But one without a byte, which was killed as it was begun, begins anew."""
    path = tmp_path / "j.sqlite"
    for size in (1, 100, 511):
        path.write_bytes((MAGIC * HEAD)[:size])
        with pytest.raises(ArmDesignError, match="is damaged"):
            opened(path)
    path.write_bytes(b"")
    with opened(path) as journal:
        assert not journal.entries()


def test_a_log_without_its_file_is_damaged(tmp_path: Path) -> None:
    """It may hold answers, which a new file would overwrite."""
    path, log = tmp_path / "j.sqlite", tmp_path / "j.sqlite-wal"
    log.write_bytes(b"answers")
    for _ in range(2):
        with pytest.raises(ArmDesignError, match="is damaged"):
            opened(path)
    assert log.read_bytes() == b"answers"


def test_a_journal_that_is_removed_while_it_is_written(tmp_path: Path) -> None:
    path = tmp_path / "j.sqlite"
    with opened(path) as journal:
        path.rename(tmp_path / "elsewhere")
        with pytest.raises(ArmDesignError, match="was removed or moved while a run wrote it"):
            journal.keep("k", "case", Entry(answer={"x": 1.5}, seconds=0.1))


@pytest.mark.parametrize("part", ["j.sqlite", "j.sqlite-wal"])
def test_a_journal_that_is_cut_off_is_refused_or_right(tmp_path: Path, part: str) -> None:
    """Cut at 20 places, as a whole file and as one with its log: no answer is ever wrong."""
    whole = tmp_path / "whole"
    whole.mkdir()
    if part.endswith("wal"):
        code = "import os; from tests.journal.test_journal import *\n"
        code += "journal = opened(Path(sys.argv[1]))\nfor n in range(40):\n"
        code += "    journal.keep(digest(n), f'case {n}', Entry(answer={'n': n}, seconds=0.1))\n"
        code += "os.kill(os.getpid(), signal.SIGKILL)"
        subprocess.run([sys.executable, "-c", code, str(whole / "j.sqlite")], check=False)
        answers = {digest(n): {"n": n} for n in range(40)}
    else:
        answers = {key: dict(e.answer) for key, e in filled(whole / "j.sqlite").items()}
    size, rng = (whole / part).stat().st_size, np.random.default_rng(1)
    for number, place in enumerate([0, *rng.integers(1, size, 19).tolist()]):
        folder = tmp_path / str(number)
        shutil.copytree(whole, folder)
        os.truncate(folder / part, place)
        try:
            with opened(folder / "j.sqlite") as journal:
                kept = journal.entries()
        except ArmDesignError as error:
            if error.fault != "is damaged":
                raise
            with opened(folder / "j.sqlite", new=True) as journal:
                assert not journal.entries()
            assert (folder / f"j.1.{part.partition('.')[2]}").stat().st_size == place
            continue
        assert all(answers[key] == entry.answer for key, entry in kept.items())


def test_a_full_disk_loses_nothing_that_was_kept(tmp_path: Path) -> None:
    """The size of files is limited in a process of its own."""
    path = tmp_path / "j.sqlite"
    code = "import resource; from tests.journal.test_journal import *\n"
    code += "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
    code += (
        "resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))\nfilled(Path(sys.argv[1]))"
    )
    run = subprocess.run(
        [sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=False
    )
    assert "the disk may be full; what was finished before is kept" in run.stderr
    few = code.replace("60_000", "8_000").replace("filled", "opened")
    run = subprocess.run(
        [sys.executable, "-c", few, str(tmp_path / "k")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert "the disk may be full; make room" in run.stderr
    with opened(path) as journal:
        kept = journal.entries()
    assert 0 < len(kept) < 40
    assert set(kept) == {digest(number) for number in range(len(kept))}


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_is_read_only_is_named(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(ArmDesignError, match="name another folder"):
        opened(tmp_path / "j.sqlite")
