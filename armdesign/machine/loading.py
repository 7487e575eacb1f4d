"""Machines from files: by path, by folder, or by the name of one that comes with the package."""

from __future__ import annotations

from pathlib import Path

from armdesign import transaction
from armdesign.errors import MachineFileError, choose
from armdesign.machine.file import machine_file
from armdesign.machine.file.schema import MachineSection
from armdesign.machine.file.toml_reading import lines_of
from armdesign.machine.machine import Machine
from armdesign.package_files import refuse_archive


def load(path_or_name: str | Path, *, allow_outside: bool = False) -> Machine:
    """Machine from a ``.toml`` file, a folder ``<name>/<name>.toml``, or a shipped name.

    It carries its first load case.

    Args:
        path_or_name: which machine.
        allow_outside: whether the file may name a URDF outside its folder (or behind a symbolic
            link out of it).

    Raises:
        MachineFileError: no such machine, or a fault in its file or URDF.

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> print(machine.name, machine.joints, [cylinder.name for cylinder in machine.cylinders])
        paper_1dof ('boom',) ['lift']
    """
    text, urdf_text, path, section = _texts(path_or_name, allow_outside)
    return Machine.from_text(text, urdf_text, path, section=section)


def load_unchecked(path_or_name: str | Path, *, allow_outside: bool = False) -> Machine:
    """Machine as of ``load`` that need not fit together, so that its faults can be drawn.

    Raises:
        MachineFileError: no such machine, or a fault in its file or URDF alone.
    """
    text, urdf_text, path, section = _texts(path_or_name, allow_outside)
    with lines_of(text, path.name):
        return Machine.unchecked(text, urdf_text, path, section=section)


def _texts(path_or_name: str | Path, allow_outside: bool) -> tuple[str, str, Path, MachineSection]:
    """Text of a machine file, of its URDF, its path, and the data in it."""
    path = find(path_or_name)
    text = machine_file.read_text(path)
    with lines_of(text, path.name):
        section = machine_file.parse(text, path.name)
        urdf_text = machine_file.read_urdf(path, section, allow_outside)
    return text, urdf_text, path, section


def shipped() -> dict[str, Path]:
    """Machine files that come with the package, by name.

    Raises:
        ArmDesignError: the package is in an archive.
    """
    package = Path(__file__).resolve().parents[1]
    for folder in (package / "robots", package.parent / "robots"):  # of a wheel; of a checkout
        if folder.is_dir():
            return {p.stem: p for p in sorted(folder.glob("*/*.toml")) if p.stem == p.parent.name}
    refuse_archive()
    return {}


def find(path_or_name: str | Path) -> Path:
    """The machine file that a path, folder or shipped name stands for.

    Raises:
        MachineFileError: no such machine, or a folder that may not be read.
    """
    path = machine_file.path_of(path_or_name)
    try:
        return _found(path, shipped())
    except OSError as error:
        raise machine_file.unreadable(path, error) from None


def _found(path: Path, names: dict[str, Path]) -> Path:
    """The file at a path, in its folder, or among those that come with the package."""
    transaction.mend(path if path.is_dir() else path.parent)
    own = path / f"{path.resolve().name if path.is_dir() else path.name}.toml"
    if own.is_file():
        return own
    # a folder of results may have the name of its machine
    if str(path) in names and not path.is_file():
        return names[str(path)]
    if path.is_dir():
        files = sorted(one for one in path.glob("*.toml") if one.is_file())
        named = f", as {' or '.join(map(str, files[:2]))}" if files else ""
        remedy = f"name the .toml file itself{named}"
        raise MachineFileError(str(path), f"holds no {own.name}", remedy)
    if path.suffix == ".toml" or path.exists():
        return path
    beside = [str(one) for one in path.parent.glob("*.toml") if one.is_file()]
    remedy = choose(str(path), [*names, *beside])
    remedy = remedy if remedy.endswith("?") else f"{remedy}, or give a .toml file"
    raise MachineFileError(str(path), "no such machine", remedy)
