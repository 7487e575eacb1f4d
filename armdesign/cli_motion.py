"""Commands of motion: ``armdesign move``."""

from __future__ import annotations

from pathlib import Path

from armdesign import output
from armdesign.options import (
    DampingOption,
    DurationOption,
    FromOption,
    Habit,
    MachineArgument,
    OutOption,
    OutsideOption,
    PayloadOption,
    ShapedModesOption,
    ShaperOption,
    ShareOption,
    SpreadOption,
    ToOption,
    UnitsOption,
    payload_of,
    pose_of,
)
from armdesign.output import outputs, show
from armdesign.progress import progress


def move(
    machine: MachineArgument,
    start: FromOption,
    end: ToOption,
    payload: PayloadOption = "",
    shaper: ShaperOption = "zvd",
    modes: ShapedModesOption = 2,
    damping: DampingOption = None,
    duration: DurationOption = None,
    share: ShareOption = 0.7,
    spread: SpreadOption = 0.2,
    out: OutOption = Path("out"),
    units: UnitsOption = Habit.workshop,
    allow_outside: OutsideOption = False,
) -> None:
    """Plan a move that does not ring, and simulate it.

    Goes straight in joint space as fast as pump, valves and pressures allow, with and without a
    shaper, and with a heavier and a lighter payload. Prints what the tool is left to swing by, in
    mm, and when it has settled. Writes move.csv (joints and spool commands over time),
    residual.csv, shaper.csv, move.png and shaper.png.
    """
    from armdesign.machine.loading import load
    from armdesign.motion.plan import plan_move
    from armdesign.report.moves import move_sheets

    with progress("planning and simulating"):
        output.check_out(out)
        model = load(machine, allow_outside=allow_outside)
        first = pose_of(model, start, "--from")
        stops, last = [], first
        for words in end:
            last = pose_of(model, words, "--to", last)
            stops.append(last)
        answer = plan_move(
            model,
            first,
            stops,
            payload=payload_of(payload),
            shaper=shaper,
            modes=modes,
            damping=damping,
            duration=duration,
            share=share,
            spread=spread,
        )
    with outputs(out) as folder:
        output.write_move(answer, folder)
    show(move_sheets(answer, units.units))
