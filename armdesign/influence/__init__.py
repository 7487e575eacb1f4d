"""Worth of each number of a machine file: derivatives, changes, tolerances."""
