"""The command ``armdesign``, also ``python -m armdesign``: Ctrl-C while it loads is one line."""

import gc
import os
import signal
import sys
from contextlib import suppress
from pathlib import Path

from armdesign.streams import keep_for_answers, replace_closed
from armdesign.threads import allow, processors

THREADS = "OPENBLAS_NUM_THREADS"  # matrices have ten to a hundred rows: more threads only wait
COLLECTED = 500_000, 10, 10  # as ``gc.set_threshold``: a run of seconds hardly looks for cycles


def main() -> None:
    """Import the commands and run one; an end while they are imported exits with code 130.

    When a command has ended there is nothing left to interrupt: Ctrl-C while Python ends is
    ignored. Nor are cycles looked for then: the system takes all memory back at once.
    """
    replace_closed()
    keep_for_answers()
    gc.set_threshold(*COLLECTED)
    if not {THREADS, "OMP_NUM_THREADS"} & os.environ.keys():
        allow(processors())  # each of which has a part of the poses
    os.environ.setdefault(THREADS, "1")
    os.environ["MPLBACKEND"] = "agg"  # no window is opened, whatever matplotlib is told to take
    try:
        from armdesign import cli
    except KeyboardInterrupt:
        sys.stderr.write("armdesign: interrupted before it began; nothing was written\n")
        sys.exit(130)
    try:
        cli.main()
    except KeyboardInterrupt:
        sys.stderr.write("armdesign: interrupted after its end\n")
        sys.exit(130)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        gc.freeze()


def leave_out_current_folder() -> None:
    """Import nothing from it, which ``python -m`` puts first: a machine's folder holds data."""
    found_there = Path(__file__).parents[1]
    with suppress(FileNotFoundError):  # it is gone
        if not sys.flags.safe_path and sys.path[0] == os.getcwd() != str(found_there):
            del sys.path[0]


if __name__ == "__main__":
    leave_out_current_folder()
    main()
