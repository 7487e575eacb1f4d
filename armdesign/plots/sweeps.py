"""Answers of sweeps over the numbers that were changed."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from armdesign.errors import ArmDesignError, choose
from armdesign.plots.canvas import INK, figure, literal

if TYPE_CHECKING:
    from armdesign.plots.canvas import Figure
    from armdesign.sweeps.answers import Sweep

LARGEST = 1e300  # number that is drawn: the width of an axis is a number, too


@literal
def sweep_answers(sweep: Sweep, answer: str = "") -> Figure:
    """Figure of one answer over each number that was changed, a dot for each case.

    Args:
        sweep: the sweep.
        answer: name of a column of its frame; empty: the first answer that is a number.

    Raises:
        ArmDesignError: no answer, or none of that name, or no change is a number, or one is too
            large to be drawn.
    """
    numbers = sweep.frame.select_dtypes("number").drop(columns="seconds")
    changed = [path for path in sweep.paths if path in numbers]
    answers = [str(name) for name in numbers if name not in sweep.paths]
    if not changed or not answers:
        fault = f"has no {'change' if answers else 'answer'} that is a number"
        raise ArmDesignError("sweep", fault, "draw its frame")
    if answer and answer not in answers:
        raise ArmDesignError("answer", f'"{answer}" is none of the sweep', choose(answer, answers))
    shown = answer or answers[0]
    for name in (*changed, shown):
        if numbers[name].abs().between(LARGEST, math.inf, inclusive="neither").any():
            raise ArmDesignError(name, f"has numbers beyond {LARGEST:g}", "draw the sweep's frame")
    fig, axes = figure(len(changed), 5.6, 4.4)
    for ax, path in zip(axes, changed, strict=True):
        ax.plot(numbers[path], numbers[shown], "o", color=INK, ms=4, alpha=0.7)
        ax.set_xlabel(path)
        ax.grid(alpha=0.3)
    axes[0].set_ylabel(shown)
    return fig
