"""Sizes that can be built: bores and rods that can be bought, and the grid of drawn lengths."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from armdesign.arrays import Array, Numbers
from armdesign.csv_rows import read_rows
from armdesign.errors import ArmDesignError
from armdesign.hydraulics.actuator import Cylinder
from armdesign.machine.machine import Machine
from armdesign.units import mm

# bore and rod [m], of each cylinder or of each entry of a catalogue
Sizes = tuple[tuple[float, float], ...]

ISO_BORES_MM = (25, 32, 40, 50, 63, 80, 90, 100, 110, 125, 140, 160, 180, 200, 220, 250, 280, 320)
ISO_RODS_MM = (12, 14, 16, 18, 20, 22, 25, 28, 32, 36, 40, 45, 50, 56, 63, 70, 80, 90, 100,
               110, 125, 140, 160, 180, 200, 220)  # fmt: skip
GRID_MM = 5  # of makers of excavators
SAME = 1e-9  # [m]
SMALLEST, LARGEST = 1e-3, 2.0  # [m] a bore below was meant in m where mm are read, beyond in mm
FREE = "free"  # in place of a catalogue: real numbers, to 0.1 mm
OWN = "own"  # pairs that were given


CATALOGUES = {  # pairs of bore and rod [mm]; the names of ``requirements.catalogue`` in the schema
    "iso": [(bore, rod) for bore in ISO_BORES_MM for rod in ISO_RODS_MM if rod < bore],
    "5mm": [(bore, rod) for bore in range(25, 321, GRID_MM) for rod in range(10, bore, GRID_MM)],
}


@dataclass(frozen=True)
class DrawingGrid:
    """Steps of a drawing's lengths [mm].

    Attributes:
        lengths: of pin coordinates and bars.
        strokes: of strokes.
        catalogue: name of what bores and rods are from: "iso", "5mm", "own" pairs, or "free".
        sizes: these bores and rods [m]; none where any may be.
    """

    lengths: float
    strokes: float
    catalogue: str
    sizes: Sizes = ()


FINE = DrawingGrid(lengths=0.1, strokes=0.1, catalogue=FREE)
BUILDABLE = DrawingGrid(lengths=1.0, strokes=5.0, catalogue=OWN)


def sizes_and_grid(
    machine: Machine, catalogue: str | Iterable[Sequence[float]] | None
) -> tuple[Sizes | None, DrawingGrid]:
    """Sizes to choose from, None for any on the 0.1 mm grid, and what lengths are rounded to.

    Args:
        machine: today's.
        catalogue: as in ``sizes_of``; None: ``requirements.catalogue`` of the machine's file;
            "free": none.

    Raises:
        ArmDesignError: an unknown name, or a pair that is no cylinder.
    """
    if catalogue is None:
        catalogue = machine.section.requirements.catalogue
    if catalogue is None or (isinstance(catalogue, str) and catalogue == FREE):
        return None, FINE
    name = catalogue if isinstance(catalogue, str) else OWN
    sizes = sizes_of(catalogue)
    return sizes, replace(BUILDABLE, catalogue=name, sizes=sizes)


def refuse_shared_joints(machine: Machine) -> None:
    """Raise where sizes of a catalogue cannot be judged one by one.

    With more cylinders and motors than joints, static forces divide by the sizes of all.
    """
    if len(machine.actuators) > len(machine.joints):
        drives = f"{len(machine.actuators)} cylinders{' and motors' * bool(machine.motors)}"
        joints = "1 joint" if len(machine.joints) == 1 else f"{len(machine.joints)} joints"
        fault = f"{machine.name} has {drives} on {joints}: their static forces"
        remedy = 'choose sizes without one: --free, in Python catalogue="free"'
        raise ArmDesignError("catalogue", f"{fault} depend on the sizes", remedy)


def sizes_of(catalogue: str | Iterable[Sequence[float]]) -> Sizes:
    """Every bore and rod [m] of a catalogue, in ascending order, each once.

    Args:
        catalogue: "iso" (bores and rods of ISO 3320, every rod thinner than the bore), "5mm" (25
            to 320 mm), or pairs of bore and rod [m]: ``[(140 * mm, 100 * mm), …]``.

    Raises:
        ArmDesignError: an unknown name, or a pair that is no cylinder.
    """
    if not isinstance(catalogue, str):
        return _own(list(catalogue))
    if catalogue not in CATALOGUES:
        names = ", ".join(f'"{name}"' for name in CATALOGUES)
        remedy = (
            f"give {names}, or sizes of your own: a CSV file of bore_mm, rod_mm, in Python pairs"
        )
        raise ArmDesignError("catalogue", f'"{catalogue:.40}" is not known', remedy)
    return tuple((bore * mm, rod * mm) for bore, rod in CATALOGUES[catalogue])


def _own(pairs: list[Sequence[float]]) -> Sizes:
    """The user's pairs, checked."""
    remedy = "give pairs of bore and rod in metres, like (140 * mm, 100 * mm)"
    if not pairs:
        raise ArmDesignError("catalogue", "is empty", remedy)
    for pair in pairs:
        try:
            bore, rod = (float(value) for value in pair)
        except (TypeError, ValueError):
            fault = f"{pair!r:.60} is not a pair of numbers"
            raise ArmDesignError("catalogue", fault, remedy) from None
        if not _is_cylinder(bore, rod):
            fault = f"({bore:g}, {rod:g}) m is not 0 < rod < bore, {SMALLEST:g} to {LARGEST:g} m"
            raise ArmDesignError("catalogue", fault, remedy)
    return tuple(sorted({(float(bore), float(rod)) for bore, rod in pairs}))


def _is_cylinder(bore: float, rod: float) -> bool:
    """Whether a cylinder can have bore and rod [m]; not so for NaN."""
    return 0 < rod < bore and SMALLEST <= bore < LARGEST


def read_sizes(path: str | Path) -> Sizes:
    """Bore and rod [m] of every line of a CSV file with columns ``bore_mm`` and ``rod_mm``.

    Raises:
        ArmDesignError: no such file, no such columns, or a line that is no cylinder.
    """
    names, rows = read_rows(path)
    remedy = "give columns bore_mm and rod_mm"
    columns = ("bore_mm", "rod_mm")
    if not set(columns) <= set(names):
        raise ArmDesignError(str(path), f"has columns {', '.join(names) or 'none'}", remedy)
    pairs = []
    for line, fields in rows:
        try:
            bore, rod = (float(fields[names.index(name)]) * mm for name in columns)
        except ValueError:
            part = f"{path}: line {line}"
            raise ArmDesignError(part, "is not a pair of numbers", remedy) from None
        if not _is_cylinder(bore, rod):
            part, fault = f"{path}: line {line}", f"rod {rod / mm:g} mm in bore {bore / mm:g} mm"
            remedy = f"give 0 < rod_mm < bore_mm, {SMALLEST / mm:g} to {LARGEST / mm:g}"
            raise ArmDesignError(part, fault, remedy)
        pairs.append((bore, rod))
    if not pairs:
        raise ArmDesignError(str(path), "has no sizes", "give a line for each")
    return sizes_of(pairs)


def is_offered(cylinder: Cylinder, size: tuple[float, float], sizes: Sizes, *varies: bool) -> bool:
    """Whether a size is among those that a cylinder is ``offered``."""
    return any(np.allclose(size, pair) for pair in offered(cylinder, sizes, *varies))


def offered(cylinder: Cylinder, sizes: Sizes, bore_varies: bool, rod_varies: bool) -> Sizes:
    """Sizes of a catalogue that leave a bore or rod that may not vary as it is.

    The cylinder's own if neither may.

    Raises:
        ArmDesignError: no size has the bore or rod that stays.
    """
    own = (cylinder.bore, cylinder.rod)
    if not (bore_varies or rod_varies):
        return (own,)
    stays = [k for k, varies in enumerate((bore_varies, rod_varies)) if not varies]
    usable = tuple(size for size in sizes if all(abs(size[k] - own[k]) < SAME for k in stays))
    if not usable:
        key, size = ("bore", "rod")[stays[0]], size_in_mm(own[stays[0]])
        fault = f"has no size with the {key} of the {cylinder.name} cylinder, {size:g} mm"
        remedy = f"offer one, or let cylinder.{cylinder.name}.{key}_mm vary too"
        raise ArmDesignError("catalogue", fault, remedy)
    return usable


def sized(cylinder: Cylinder, bore: Numbers, rod: Numbers, proportional: bool = False) -> Cylinder:
    """The cylinder with another bore and rod [m]; dead volumes follow if ``proportional``."""
    new = replace(cylinder, bore=bore, rod=rod)
    if not proportional:
        return new
    cap = cylinder.cap_dead_volume * new.bore_area / cylinder.bore_area
    annulus = cylinder.annulus_dead_volume * new.annulus_area / cylinder.annulus_area
    return replace(new, cap_dead_volume=cap, annulus_dead_volume=annulus)


def areas_of_sizes(cylinder: Cylinder, sizes: Sizes) -> Array:
    """Bore and annulus area of the cylinder with each of some sizes (k, 2) [m²]."""
    bores, rods = np.array(sizes).T
    new: Any = sized(cylinder, bores, rods)
    return np.stack([new.bore_area, new.annulus_area], axis=1)


def relative_areas(cylinder: Cylinder, bore: float, rod: float) -> tuple[float, float]:
    """Bore and annulus area of another bore and rod [m], over the cylinder's."""
    new = sized(cylinder, bore, rod)
    return new.bore_area / cylinder.bore_area, new.annulus_area / cylinder.annulus_area


def size_in_mm(size: float) -> float:
    """A bore or rod as its file writes it [mm]."""
    return round(size / mm, 6)
