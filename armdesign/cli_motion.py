"""Commands of motion: ``armdesign move``."""

from __future__ import annotations

from armdesign import output
from armdesign.option_values import payload_of, pose_of
from armdesign.options import FromOption, PayloadOption, ToOption
from armdesign.runs import MoveOptions, OfMachine, command


@command
def move(
    plan: MoveOptions,
    run: OfMachine,
    start: FromOption,
    end: ToOption,
    payload: PayloadOption = "",
) -> None:
    """Plan a move that does not ring, and simulate it.

    Goes straight in joint space as fast as pump, valves and pressures allow, with and without a
    shaper, and with a heavier and a lighter payload. Prints what the tool is left to swing by, in
    mm, and when it has settled. Writes move.csv (joints and spool commands over time),
    residual.csv, shaper.csv, move.png and shaper.png.
    """
    from armdesign.motion.plan import plan_move
    from armdesign.report.moves import move_sheets

    with run.progress("planning and simulating"):
        model, out = run.open()
        first = pose_of(model, start, "--from")
        stops, last = [], first
        for words in end:
            last = pose_of(model, words, "--to", last)
            stops.append(last)
        answer = plan_move(model, first, stops, payload=payload_of(payload), **plan.settings)
    with run.writing(out) as folder:
        output.write_move(answer, folder)
    run.show(move_sheets(answer, run.units.units), tables={"residual": answer.residuals})
