"""The largest margin that some gains keep, and the refusal of one that none keeps.

Margins grow as gains fall; the largest is the one of the smallest gains that are tried.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armdesign.control.map_parts import ControlOptions, MapPart
from armdesign.control.margins import gain_margin_db, of_gain_margin, of_phase_margin, phase_margin
from armdesign.control.stability import stable
from armdesign.errors import ArmDesignError
from armdesign.machine.machine import Machine
from armdesign.units import deg, outward

DIGITS = 4  # of the margins told, rounded down


def no_gains_keep(
    machine: Machine, parts: Sequence[MapPart], options: ControlOptions
) -> ArmDesignError:
    """The error that no gains keep the margin at any pose, with the largest that some keep."""
    asked = options.aim.margin
    fault = (
        f"no gains keep {options.gain_margin_db:g} dB and {options.phase_margin / deg:.6g} deg"
        f" (disk margin {asked:.3f}) at any pose"
    )
    most = _most_margin(parts, options)
    gain = outward(float(gain_margin_db(most)), DIGITS, up=False)
    phase = outward(float(phase_margin(most)) / deg, DIGITS, up=False)
    words = []
    if of_gain_margin(options.gain_margin_db) > most:
        words.append(f"{gain:g} dB, as --gain-margin {gain:g} (in Python gain_margin_db={gain:g})")
    if of_phase_margin(options.phase_margin) > most:
        in_python = f"in Python phase_margin={outward(phase * deg, DIGITS + 2, up=False):.6g}"
        words.append(f"{phase:g} deg, as --phase-margin {phase:g} ({in_python})")
    remedy = f"ask for at most {' and '.join(words)}"
    if not most > 0:
        remedy = "no loop is stable: give friction or leakage, or another load case"
    return ArmDesignError(f"{machine.name}: margin", fault, remedy)


def _most_margin(parts: Sequence[MapPart], options: ControlOptions) -> float:
    """Balanced disk margin of the smallest gains at the pose where it is largest; 0 for none."""
    most = 0.0
    for part in parts:
        if len(part.works):
            task = part.task(options)
            controller = task.smallest()
            margins = task.loops.figures(controller).margin[stable(task.plant, controller)]
            most = max(most, float(np.max(margins, initial=0.0)))
    return most
