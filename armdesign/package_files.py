"""The package's own files, which must be able to be read: machines, templates."""

from __future__ import annotations

from pathlib import Path

from armdesign.errors import ArmDesignError


def refuse_archive() -> None:
    """Raise where the package's own files cannot be read, as from within a wheel."""
    module = Path(__file__)
    if not module.is_file():
        archive = next((str(path) for path in module.parents if path.is_file()), str(module))
        remedy = f"install it: pip install {archive}"
        raise ArmDesignError("armdesign", f"cannot run from within {archive}", remedy)
