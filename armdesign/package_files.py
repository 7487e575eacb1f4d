"""The package's own files, which must be able to be read: machines, templates, sources."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib.metadata import version
from pathlib import Path

from armdesign.errors import ArmDesignError


@cache
def version_of_sources() -> str:
    """Version of the package with a digest of its sources, which who develops it changes.

    What decides an answer beside its input; as ``0.1.0+3f9a2c71``. Once in a process: Python is
    begun anew after an edit.
    """
    root, seal = Path(__file__).parent, hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        if path.is_file():  # no editor's link to a lock
            seal.update(f"{path.relative_to(root).as_posix()}\n".encode() + path.read_bytes())
    return f"{version('armdesign')}+{seal.hexdigest()[:8]}"


def refuse_archive() -> None:
    """Raise where the package's own files cannot be read, as from within a wheel."""
    module = Path(__file__)
    if not module.is_file():
        archive = next((str(path) for path in module.parents if path.is_file()), str(module))
        remedy = f"install it: pip install {archive}"
        raise ArmDesignError("armdesign", f"cannot run from within {archive}", remedy)
