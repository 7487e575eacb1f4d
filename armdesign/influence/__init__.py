"""What each number of a machine file is worth: derivatives, changes, tolerances."""
