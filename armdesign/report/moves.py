"""Sheets of a planned move: what is left, and how exact a shaper must be."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from armdesign.report.sheet import Sheet
from armdesign.units import WORKSHOP, Units, percent, share_text

if TYPE_CHECKING:
    from armdesign.motion.move import Move
    from armdesign.motion.outcome import MoveRun
    from armdesign.motion.shapers import Shaper

GENTLER = 0.7  # times the share of the force: what is proposed where chambers run empty
ERRORS = (-0.2, -0.1, 0.0, 0.1, 0.2)  # of a frequency


def move_sheets(move: Move, units: Units = WORKSHOP) -> list[Sheet | str]:
    """Runs, shapers, and what limited the motion."""
    flow = units.text(move.machine.supply.flow, "m³/s")
    longer = move.planned.duration - move.duration
    shaped = f"and {longer:.3g} s more as it is shaped by {move.shaper.words}"
    shaper = shaped if move.shaper.delay else "without a shaper"
    begin = (
        f"The move takes {move.duration:.3g} s, {shaper}; {move.share:g} of the pump's {flow}"
        f" and of the force that pressures leave (--share) allow {move.shortest:.3g} s at the"
        " shortest."
    )
    return [begin, _runs(move, units), _shapers(move), *_remarks(move)]


def _runs(move: Move, units: Units) -> Sheet:
    rows = []
    for first, run in zip(
        [one for one in move.runs[::2] for _ in range(2)], move.runs, strict=True
    ):
        settled = f"{run.settled:.2f}" if math.isfinite(run.settled) else f"> {run.time[-1]:.1f}"
        share = share_text(run.residual / first.residual) if run.shaped else "–"
        rows.append(
            (
                move.shaper.name if run.shaped else "unshaped",
                units.number(run.mass, "kg"),
                f"{run.end:.2f}",
                units.number(run.residual, "m", 2 if units is WORKSHOP else 5),
                share,
                settled,
                *_misses(move, run, units),
            )
        )
    length, joints = units.name("m"), move.machine.arm.joints
    return Sheet(
        title="What is left of the tool's motion, in nonlinear simulation",
        columns=(
            "commands",
            f"payload [{units.name('kg')}]",
            "end [s]",
            f"residual [{length}]",
            "of unshaped",
            "settled [s]",
            *(f"{joint.name} [{units.name(joint.unit)}]" for joint in joints),
        ),
        rows=tuple(rows),
        note=(
            "end: of the commands; residual: largest distance of the tool from its drift within"
            " one period after the spools have come to rest; settled: from the start until it"
            f" stays within {units.short(move.tolerance, 'm')} of its drift; joints: by how much"
            " they miss their goals, as commands are computed ahead for the first payload and"
            " nothing is fed back"
        ),
    )


def _misses(move: Move, run: MoveRun, units: Units) -> list[str]:
    pairs = zip(move.machine.arm.joints, run.miss, strict=True)
    decimals = 2 if units is WORKSHOP else 5
    return [units.number(float(miss), joint.unit, decimals) for joint, miss in pairs]


def _shapers(move: Move) -> Sheet:
    """The chosen shaper beside the usual ones for the lowest mode."""
    lowest, damping = float(move.frequencies[0]), move.shaper.of_lowest.damping
    return Sheet(
        title=f"Residual vibration against an error of the lowest frequency, {lowest:.3g} Hz",
        columns=(
            "shaper",
            "delay [s]",
            "periods",
            *(percent(error, 0) if error else "0" for error in ERRORS),
            "width at 5 %",
        ),
        rows=tuple(_shaper_row(shaper, lowest, damping) for shaper in move.shapers),
        bold=(0,) if move.shaper.delay else (),
        note=(
            "of the vibration that a step would leave, linear; width: of the band with at most 5 %"
            " left, over the frequency, of several modes if all err by one share; the first row is"
            " the one at work, the others are for the lowest mode alone"
        ),
    )


def _shaper_row(shaper: Shaper, lowest: float, damping: float) -> tuple[str, ...]:
    periods = shaper.delay * lowest * math.sqrt(1 - damping**2)
    left = (100 * float(shaper.residual(lowest * (1 + error), damping)) for error in ERRORS)
    return (
        shaper.name,
        f"{shaper.delay:.3f}",
        f"{periods:.2f}",
        *(f"{value:.1f} %" for value in left),
        f"{100 * shaper.insensitivity():.0f} %",
    )


def _jolts(move: Move) -> str:
    """Chambers that run empty and fill again on the way, and what is or can be done."""
    first, times = move.faster or move, {1: "once", 2: "twice"}
    chambers = " and ".join(
        f"{name} {times.get(often, f'{often} times')}"
        for name, often in first.shaped.refilled.items()
    )
    words = (
        "On the way chambers run empty and fill again, with a jolt that no shaper foresees:"
        f" {chambers}."
    )
    if move.faster:
        words = (
            f"With {first.share:g} of the pump's flow and of the free force chambers would run"
            f" empty and fill again on the way ({chambers}), with a jolt that no shaper foresees:"
            f" {share_text(max(first.reductions))} would be left. So the move uses {move.share:g}."
        )
    if move.jolts:
        smaller = f"{GENTLER * move.share:.1g}"
        words += (
            f" A smaller share of the force is gentler, as --share {smaller} (in Python"
            f" share={smaller}), or a longer --duration."
        )
    return words


def _remarks(move: Move) -> list[str]:
    """Notes on the move and its shaper."""
    remarks = []
    if move.shaper.delay and move.shaper.high > move.shaper.low and not move.shaper.parts:
        shaper = move.shaper
        worst, undamped = (100 * shaper.worst_residual(damping=zeta) for zeta in (None, 0.0))
        remarks.append(
            f"From {shaper.low:.3g} to {shaper.high:.3g} Hz at most {worst:.2g} % is left, linear,"
            f" at a damping ratio of {shaper.damping:.3g}; {undamped:.2g} % without damping."
        )
    if move.empty:
        names, verb = " and ".join(move.empty), "is" if len(move.empty) == 1 else "are"
        remarks.append(
            f"At the end {names} {verb} empty: gravity draws the piston, the valve stays shut. The"
            f" arm is softer than at rest there; its lowest mode has {move.frequencies[0]:.3g} Hz."
        )
    if move.faster or move.shaped.refilled:
        remarks.append(_jolts(move))
    if move.plan.starving:
        names = " and ".join(move.plan.starving)
        remarks.append(f"The load draws {names} faster than the pump's side can fill it.")
    events = move.shaped.simulation.events
    remarks += [f"Shaped, payload as planned: {'; '.join(events)}."] if events else []
    return remarks
