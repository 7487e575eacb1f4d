"""The command ``armdesign export``: pin tables, drawings and robot descriptions."""

from __future__ import annotations

from functools import partial

from armdesign.errors import ArmDesignError, choose
from armdesign.option_values import drawn_pose, listed
from armdesign.options import ExportFormatOption, PoseOption
from armdesign.runs import OfMachine, command


@partial(command, without=("pictures", "units"))
def export(run: OfMachine, formats: ExportFormatOption = "csv", pose: PoseOption = "") -> None:
    """Write a machine for other programs.

    csv: every pin in the frame of its link, and where it is at the pose. dxf: side view at the
    pose, and a sheet of pins for each link, in mm. urdf, sdf: links with barrels, rods and
    four-bars as bodies; of these only SDF holds the pose, and closed loops.
    """
    from armdesign.exchange.files import FORMATS
    from armdesign.exchange.files import export as write

    kinds = list(dict.fromkeys(listed(formats)))
    for kind in kinds:
        if kind not in FORMATS:
            raise ArmDesignError("--format", f'"{kind}" is not known', choose(kind, FORMATS))
    if not kinds:
        raise ArmDesignError("--format", "names no format", choose("", FORMATS))
    with run.progress("reading the file"):
        model, out = run.open()
        at = drawn_pose(model, pose) if pose else None
    with run.writing(out) as folder:
        for kind in kinds:
            write(model, folder / f"{model.name}{FORMATS[kind]}", at)
