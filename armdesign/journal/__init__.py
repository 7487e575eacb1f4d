"""Journal of long runs: what is finished stays, whatever ends the program."""
