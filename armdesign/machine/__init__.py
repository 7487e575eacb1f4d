"""The machine: its file, its parts, and the immutable value that they make."""
