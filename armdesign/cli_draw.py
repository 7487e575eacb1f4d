"""The command ``armdesign draw``."""

from __future__ import annotations

from functools import partial

from armdesign.errors import ArmDesignError
from armdesign.option_values import drawn_pose, loaded
from armdesign.options import NewArgument, PayloadOption, PoseOption
from armdesign.runs import OfMachine, command


@partial(command, without=("units",))
def draw(
    run: OfMachine, new: NewArgument = "", pose: PoseOption = "", payload: PayloadOption = ""
) -> None:
    """Draw a machine to scale, or two over each other.

    Writes machine.png, the side view with named pins, cylinders between them, joint ranges and
    the range of the tool, and modes.png with the lowest modes; with NEW overlay.png, where arrows
    show the pins that moved, in mm. A machine that cannot be used is drawn too, and its faults are
    listed.
    """
    from armdesign import plots
    from armdesign.machine.loading import find

    with run.progress("drawing"):
        out = run.folder(*map(find, [run.machine, new] if new else [run.machine]))
        wrong = run.faults(run.machine)
        try:
            model = run.load(run.machine, check=False)
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
