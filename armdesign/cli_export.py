"""The command ``armdesign export``: pin tables, drawings and robot descriptions."""

from __future__ import annotations

from pathlib import Path

from armdesign.errors import ArmDesignError, choose
from armdesign.options import (
    ExportFormatOption,
    MachineArgument,
    OutOption,
    OutsideOption,
    PoseOption,
    listed,
    pose_of,
)
from armdesign.output import check_out, outputs
from armdesign.progress import progress


def export(
    machine: MachineArgument,
    formats: ExportFormatOption = "csv",
    pose: PoseOption = "",
    out: OutOption = Path("out"),
    allow_outside: OutsideOption = False,
) -> None:
    """Write a machine for other programs.

    csv: every pin in the frame of its link, and where it is at the pose. dxf: side view at the
    pose, and a sheet of pins for each link, in mm. urdf, sdf: links with barrels, rods and
    four-bars as bodies; of these only SDF holds the pose, and closed loops.
    """
    from armdesign.drawing.joint_arcs import middle_pose
    from armdesign.exchange.files import FORMATS
    from armdesign.exchange.files import export as write
    from armdesign.machine.loading import load

    kinds = list(dict.fromkeys(listed(formats)))
    for kind in kinds:
        if kind not in FORMATS:
            raise ArmDesignError("--format", f'"{kind}" is not known', choose(kind, FORMATS))
    if not kinds:
        raise ArmDesignError("--format", "names no format", choose("", FORMATS))
    check_out(out)
    with progress("reading the file"):
        model = load(machine, allow_outside=allow_outside)
        at = pose_of(model, pose, "--pose", middle_pose(model).tolist()) if pose else None
    with outputs(out) as folder:
        for kind in kinds:
            write(model, folder / f"{model.name}{FORMATS[kind]}", at)
