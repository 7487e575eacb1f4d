"""Files for other programs: a machine's pins and bodies, in the format that a name ends in."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from armdesign.arguments import checked
from armdesign.csv_rows import plain_cells
from armdesign.errors import ArmDesignError
from armdesign.exchange.dxf import write_dxf
from armdesign.exchange.pin_table import pin_table
from armdesign.exchange.sdf import sdf
from armdesign.exchange.urdf import urdf

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine

FORMATS = {  # what each ends in: what is left of a file's name when the machine's is taken away
    "csv": "_pins.csv",
    "dxf": "_pins.dxf",
    "urdf": "_with_cylinders.urdf",
    "sdf": "_with_cylinders.sdf",
}


@checked
def export(machine: Machine, path: str | Path, pose: ArrayLike | None = None) -> Path:
    """Write a machine for other programs, in the format that the file's name ends in.

    ``.csv``: the pin table; ``.dxf``: side view and a sheet of pins for each link, in mm;
    ``.urdf`` and ``.sdf``: the links with barrels, rods and four-bars as bodies.

    Args:
        machine: the machine.
        path: of the file, which is replaced.
        pose: q (nq,) [rad, m] of pin table, drawing and SDF; default: the middle of the joint
            ranges. A URDF holds no pose.

    Returns:
        The path.

    Raises:
        ArmDesignError: another ending, a pose that is none, a place that cannot be written, or
            no ezdxf for DXF.

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> from tempfile import TemporaryDirectory
        >>> with TemporaryDirectory() as folder:
        ...     path = ad.export(machine, f"{folder}/pins.csv")
        ...     print(path.read_text().splitlines()[0])
        ...
        link,pin,kind,x_mm,y_mm,z_mm,root_x_mm,root_y_mm,root_z_mm
    """
    file = Path(path)
    kind = file.suffix.lower().removeprefix(".")
    try:
        if kind == "csv":
            place = file.absolute()  # pandas takes a ~ at the beginning for the home
            plain_cells(pin_table(machine, pose)).to_csv(place, index=False)
        elif kind == "dxf":
            write_dxf(machine, file, pose)
        elif kind in FORMATS:
            text = urdf(machine) if kind == "urdf" else sdf(machine, pose)
            file.write_text(text, encoding="utf-8")
        else:
            remedy = f"end the name in .{', .'.join(FORMATS)}"
            raise ArmDesignError(str(file), "is of no format that can be written", remedy)
    except OSError as error:
        fault = f"cannot be written ({error.strerror})"
        raise ArmDesignError(str(file), fault, "name another place") from None
    return file
