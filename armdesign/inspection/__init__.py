"""What ``armdesign check`` says of a machine file: faults, oddities, what it amounts to."""
