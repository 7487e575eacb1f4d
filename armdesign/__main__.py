"""The command ``armdesign``, also ``python -m armdesign``: Ctrl-C while it loads is one line."""

import gc
import os
import signal
import sys

THREADS = "OPENBLAS_NUM_THREADS"  # matrices have ten to a hundred rows: more threads only wait
COLLECTED = 500_000, 10, 10  # as ``gc.set_threshold``: a run of seconds hardly looks for cycles
STACK = 70_000  # values: Python has the stack of calls in pieces, the smallest of 16 kB, and asks
# the system for one, and gives it back, at every call over an edge, thousands of times in a loop
# that is just there; a call that takes so much has all others in its own piece


def main() -> None:
    """Import the commands and run one; an end while they are imported exits with code 130.

    When a command has ended there is nothing left to interrupt: Ctrl-C while Python ends is
    ignored.
    """
    gc.set_threshold(*COLLECTED)
    os.environ.setdefault(THREADS, "1")
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


main.__code__ = main.__code__.replace(co_stacksize=STACK)

if __name__ == "__main__":
    main()
