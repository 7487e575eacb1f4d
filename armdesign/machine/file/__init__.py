"""The machine file: its schema, its text, its faults, and how it is written."""
