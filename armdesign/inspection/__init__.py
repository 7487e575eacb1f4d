"""What ``armdesign check`` says of a machine file: its faults, what is implausible, what it amounts to."""
