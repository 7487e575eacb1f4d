"""Requirements: what a design must keep, and the check of a machine against it.

To add one: its setting and formula in the file of its family (a new family is listed in
``settings.FAMILIES``), its key in ``machine/file/schema.py``; ``record.py`` says how.
"""
