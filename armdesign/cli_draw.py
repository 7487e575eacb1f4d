"""The command ``armdesign draw``."""

from __future__ import annotations

from functools import partial

from armdesign.errors import ArmDesignError
from armdesign.option_values import drawn_pose, loaded
from armdesign.options import NewArgument, PayloadOption, PoseOption
from armdesign.runs import OfMachine, command


@command
def draw(
    run: OfMachine, new: NewArgument = "", pose: PoseOption = "", payload: PayloadOption = ""
) -> None:
    """Draw a machine to scale from the side, or two over each other.

    Writes machine.png with named pins, cylinders between them, joint ranges and the range of the
    tool, and modes.png with the lowest modes; with NEW overlay.png, where arrows show the pins
    that moved, in mm. A machine that cannot be used is drawn too, and its faults are listed.
    """
    from armdesign import plots
    from armdesign.inspection.file_faults import faults
    from armdesign.machine.loading import find, load_unchecked

    with run.progress("drawing"):
        out = run.folder(find(run.machine))
        wrong = [] if run.set else faults(run.machine, allow_outside=run.allow_outside)
        try:  # with other numbers it must be one that can be used
            reader = (
                run.load if run.set else partial(load_unchecked, allow_outside=run.allow_outside)
            )
            model = reader(run.machine)
        except ArmDesignError:
            run.refuse(wrong)
            raise
        if not wrong:
            model = loaded(model, payload)
        q = drawn_pose(model, pose)
        pictures = {"machine": plots.machine_drawing(model, q).figure}
        if new:
            other = run.load(new)
            pictures["overlay"] = plots.machine_overlay(model, other, q).figure
        if not wrong:
            pictures["modes"] = plots.mode_shapes(model, q)
    with run.writing(out) as folder:
        for name, fig in pictures.items():
            plots.save(fig, folder / f"{name}.png")
    run.refuse(wrong)
