"""The command ``armdesign draw``."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from armdesign.errors import ArmDesignError
from armdesign.option_values import drawn_pose, loaded
from armdesign.options import NewArgument, PayloadOption, PoseOption
from armdesign.runs import OfMachine, command

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine


@partial(command, without=("units",))
def draw(
    run: OfMachine, new: NewArgument = "", pose: PoseOption = "", payload: PayloadOption = ""
) -> None:
    """Draw a machine to scale, or two over each other.

    Writes machine.png, the side view with named pins, cylinders between them, joint ranges and
    the range of the tool, and modes.png with the lowest modes; with NEW overlay.png, where arrows
    show the pins that moved, in mm. With --payload that load case alone is drawn; without it the
    loads of all. A machine that cannot be used is drawn too, and its faults are listed.
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
            model = _loaded_alone(model, payload)
        q = drawn_pose(model, pose)
        pictures = {"machine": plots.machine_drawing(model, q).figure}
        if new:
            other = _loaded_alone(run.load(new), payload)
            pictures["overlay"] = plots.machine_overlay(model, other, q).figure
        if not wrong:
            pictures["modes"] = plots.mode_shapes(model, q)
    with run.writing(out) as folder:
        for name, fig in pictures.items():
            plots.save(fig, folder / f"{name}.png")
    run.refuse(wrong)


def _loaded_alone(machine: Machine, payload: str) -> Machine:
    """The machine with the load case of ``--payload`` and no other; as it is without one."""
    if not payload:
        return machine
    machine = loaded(machine, payload)
    return replace(machine, payloads=(machine.payload,))
