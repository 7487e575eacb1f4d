"""The command ``armdesign draw``."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from armdesign.errors import ArmDesignError
from armdesign.options import (
    FormatOption,
    MachineArgument,
    NewArgument,
    OutOption,
    OutsideOption,
    PayloadOption,
    PictureFormat,
    PoseOption,
    payload_of,
    pose_of,
)
from armdesign.output import check_out, outputs, tell
from armdesign.progress import progress


def draw(
    machine: MachineArgument,
    new: NewArgument = "",
    pose: PoseOption = "",
    payload: PayloadOption = "",
    out: OutOption = Path("out"),
    format: FormatOption = PictureFormat.png,
    allow_outside: OutsideOption = False,
) -> None:
    """Draw a machine to scale from the side, or two over each other.

    Writes machine.png with named pins, cylinders between them, joint ranges and the range of the
    tool, and modes.png with the lowest modes; with NEW overlay.png, where arrows show the pins
    that moved, in mm. A machine that cannot be used is drawn too, and its faults are listed.
    """
    import numpy as np

    from armdesign import plots
    from armdesign.drawing.joint_arcs import middle_pose
    from armdesign.inspection.file_faults import faults
    from armdesign.machine.loading import load, load_unchecked

    with progress("drawing"):
        check_out(out)
        wrong = faults(machine, allow_outside=allow_outside)
        try:
            model = load_unchecked(machine, allow_outside=allow_outside)
        except ArmDesignError:
            _refuse(wrong)
            raise
        if not wrong and (load_case := payload_of(payload)) is not None:
            model = model.with_payload(load_case)
        q = middle_pose(model)
        if pose:
            q = np.array(pose_of(model, pose, "--pose", q.tolist()))
        pictures = {"machine": plots.machine_drawing(model, q).figure}
        if new:
            other = load(new, allow_outside=allow_outside)
            pictures["overlay"] = plots.machine_overlay(model, other, q).figure
        if not wrong:
            pictures["modes"] = plots.mode_shapes(model, q)
    with outputs(out) as folder:
        for name, fig in pictures.items():
            plots.save(fig, folder / f"{name}.{format.value}")
    _refuse(wrong)


def _refuse(faults: Sequence[ArmDesignError]) -> None:
    """List faults, if there are any, and exit with code 2."""
    for fault in faults:
        tell(f"armdesign: {fault}", sys.stderr)
    if faults:
        sys.exit(2)
