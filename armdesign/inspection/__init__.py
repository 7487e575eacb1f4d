"""Output of ``armdesign check``: faults of a file, implausible values, machine properties."""
