"""The command ``armdesign view``."""

from __future__ import annotations

import sys
import webbrowser
from functools import partial
from typing import TYPE_CHECKING

from armdesign.option_values import drawn_pose, grid_points, loaded
from armdesign.options import (
    DampingOption,
    HtmlOption,
    NewArgument,
    NoOpenOption,
    PayloadOption,
    PortOption,
    PoseOption,
)
from armdesign.output import tell
from armdesign.runs import OverWorkspace, command

if TYPE_CHECKING:
    from armdesign.viewing.view import View


@partial(command, without=("pictures", "units"))
def view(
    run: OverWorkspace,
    new: NewArgument = "",
    pose: PoseOption = "",
    payload: PayloadOption = "",
    html: HtmlOption = False,
    damping: DampingOption = None,
    port: PortOption = None,
    no_open: NoOpenOption = False,
) -> None:
    """Look at a machine in space, and move it.

    Serves a page to this computer alone until Ctrl-C: sliders for joints and payload, frequency,
    bandwidth and what limits it, modes as motion, the region that the tool sweeps coloured by
    frequency, NEW over it. With --html writes view.html instead, a film of it. Needs
    armdesign[view].
    """
    from armdesign.frequency.workspace import Workspace
    from armdesign.viewing.stage import check_viser
    from armdesign.viewing.view import view_of

    check_viser()
    counts = grid_points(run.points)
    with run.progress("frequencies of the swept region"):
        machine = run.load(run.machine)
        out = run.folder(machine.source) if html else None
        machine = loaded(machine, payload)
        q = drawn_pose(machine, pose)
        other = run.load(new) if new else None
        seen = view_of(machine, other, q, Workspace.grid(machine, counts), damping)
    if out is None:
        _serve(run, seen, port, no_open)
        return
    from armdesign.viewing.player import player

    with run.progress("filming"):
        text, remark = player(seen)
    with run.writing(out) as folder:
        (folder / "view.html").write_text(text, encoding="utf-8")
    run.show([remark] if remark else [])


def _serve(run: OverWorkspace, seen: View, port: int | None, no_open: bool) -> None:
    """Show the page until Ctrl-C."""
    from armdesign.viewing.live import Viewer

    with run.progress("beginning"):
        viewer = Viewer(seen, port)
    try:
        words = f"{viewer.address} shows {seen.machine.name} on this computer alone"
        _say(run, f"{words}; Ctrl-C ends it")
        if not no_open:
            webbrowser.open(viewer.address)
        viewer.wait()
    except KeyboardInterrupt:
        _say(run, "ended")
    finally:
        viewer.stop()


def _say(run: OverWorkspace, text: str) -> None:
    """A sentence on stderr, unless nothing is to be shown."""
    if not run.quiet:
        tell(text, sys.stderr)
