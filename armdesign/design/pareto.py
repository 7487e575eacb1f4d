"""Trade-offs: what the worst frequency costs in oil, thrust, digging force, lift or pin room.

One limit is moved from its tightest value to its loosest. Here are its values, the requirements
under each, and the table of the designs; ``sweeps/trade_offs.py`` finds these.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.design.design import Design
from armdesign.design.requirements.performance import torque_shares
from armdesign.design.requirements.settings import Requirements
from armdesign.errors import ArmDesignError
from armdesign.frequency.bands import Bands
from armdesign.frequency.workspace import Workspace
from armdesign.machine.file.schema import DEFAULT, Shares, share_of
from armdesign.machine.machine import Machine
from armdesign.short_repr import short_repr

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.plots.canvas import Axes

SHARES = {  # what is tried unless told: shares of today's, of a pin box of the default box
    "oil": (0.8, 0.9, 1.0, 1.1, 1.2),
    "thrust": (0.9, 1.0, 1.1, 1.2, 1.3),
    "digging": (1.1, 1.0, 0.95, 0.9, 0.8),
    "lift": (1.0, 0.95, 0.9, 0.85, 0.8, 0.7),
    "pin_box": (0.0, 0.25, 0.5, 1.0, 1.5, 2.0),
}
EACH = 1.1  # oil of one cylinder's side, over the share that all together may have

PLAUSIBLE = {"pin_box": (0.0, 3.0, "m")}  # values that somebody may mean
OF_SHARES = (0.1, 3.0, "of today's")


@dataclass(frozen=True, eq=False, kw_only=True)
class Pareto:
    """The best designs under one limit that moves, from its tightest value to its loosest.

    Attributes:
        against: "oil", "thrust", "digging", "lift" or "pin_box".
        limits: of the designs: shares of today's, or the pin box [m].
        designs: one for each limit.
        left_out: limits that no design meets, and why.
        today: the machine that all were made from.
    """

    __repr__ = short_repr

    against: str
    limits: tuple[float, ...]
    designs: tuple[Design, ...]
    left_out: dict[float, str]
    today: Machine

    @property
    def robust(self) -> bool:
        """Whether the designs were made for bands."""
        return self.designs[0].problem.dynamics.corners.bands != Bands()

    @cached_property
    def frame(self) -> pd.DataFrame:
        """A row for each design, with what it has of everything that trades against frequency.

        ``frequency_hz``: worst, of the rounded machine, between grid poses too; ``unrounded_hz``:
        of the optimum, on the workspace's poses; ``gain``. ``banded_hz``: the worst within the
        bands that the designs were made for, on the workspace's poses, and ``least_gain`` there
        over today's, no more than ``gain`` (no columns without bands).
        ``oil_share``, ``annulus_oil_share``: summed over the cylinders, over today's;
        ``thrust_share``: largest of any cylinder; ``digging_share``: least torque of those whose
        digging counts (no column where none does); ``lift_share``: least lift of all points of the
        lift chart; ``pin_move_m``: largest move of any pin coordinate or bar. All are of the
        rounded machine. ``squared_times_speed``: frequency² × 1/``oil_share``, which is what the
        pump's flow makes of the speed, over today's.
        """
        import pandas as pd

        return pd.DataFrame(
            [_row(limit, design) for limit, design in zip(self.limits, self.designs, strict=True)]
        )

    @property
    def sentences(self) -> list[str]:
        """Limits that are left out, and the reasons."""
        return [
            f"{self.against} {limit:g} is left out: {why}" for limit, why in self.left_out.items()
        ]

    def plot(self, ax: Axes | None = None) -> Axes:
        """Worst frequency over the limit, with today's machine; returns the axes."""
        from armdesign import plots

        return plots.trade_off(self, ax)


def read_values(text: str, against: str) -> list[float] | None:
    """Values of a limit as a command line gives them, commas between; None for none.

    Args:
        text: such as ``0.9,1.0,1.1``.
        against: the limit.

    Raises:
        ArmDesignError: no numbers, a comma that may be a decimal one, or numbers that nobody
            means.
    """
    words = [word.strip() for word in text.split(",") if word.strip()]
    if text and not words:
        raise ArmDesignError("--values", f'"{text}" has no value', "give 0.9,1.0,1.1")
    try:
        values = [float(word) for word in words]
    except ValueError:
        fault = f'"{text}" is not a list of numbers'
        raise ArmDesignError("--values", fault, "give 0.9,1.0,1.1") from None
    whole = re.search(r"(?<![\d.])(\d+),(\d+)(?![\d.])", text)
    if whole:
        one, two = whole.groups()
        fault = f'"{whole[0]}" may be {one}.{two}, or {one} and {two}'
        raise ArmDesignError("--values", fault, f"give {one}.{two}, or {one}.0,{two}.0")
    low, high, unit = PLAUSIBLE.get(against, OF_SHARES)
    for value in values:
        if against in SHARES and not low <= value <= high:
            fault, remedy = f"{value:g} {unit} is not allowed", f"give {low:g} to {high:g} {unit}"
            raise ArmDesignError("--values", fault, remedy)
    return values or None


def limits_of(
    machine: Machine,
    workspace: Workspace,
    requirements: Requirements,
    against: str,
    values: Sequence[float] | None,
) -> list[float]:
    """The values of the limit, the tightest first."""
    if values is None:
        unit = requirements.box(machine, workspace) if against == "pin_box" else 1.0
        values = [share * unit for share in SHARES[against]]
    values = list(values)  # which may be made one by one
    numbers = [v for v in values if isinstance(v, int | float | np.number)]
    usable = [v for v in numbers if 0 <= v <= sys.float_info.max]
    if not usable or len(usable) < len(values):
        raise ArmDesignError("values", f"{values} is not allowed", "give finite numbers ≥ 0")
    return sorted({float(v) for v in values}, reverse=against in ("digging", "lift"))


def limited(requirements: Requirements, against: str, limit: float) -> Requirements:
    """The requirements with one limit at a value; own shares and boxes stay."""
    if against == "oil":
        each = _with_common(requirements.oil_each_share, EACH * limit)
        return replace(requirements, oil_total_share=limit, oil_each_share=each)
    if against == "digging":
        torque = requirements.torque_share
        own = {name: min(limit, share_of(torque, name)) for name in requirements.digging}
        every = torque if isinstance(torque, Mapping) else {DEFAULT: torque}
        return replace(requirements, digging_share=limit, torque_share={**every, **own})
    name = "pin_box" if against == "pin_box" else f"{against}_share"
    changes: dict[str, Any] = {name: _with_common(getattr(requirements, name), limit)}
    return replace(requirements, **changes)


def _with_common(shares: Shares, common: float) -> Shares:
    """Shares with another common one."""
    return {**shares, DEFAULT: common} if isinstance(shares, Mapping) else common


def _row(limit: float, design: Design) -> dict[str, float]:
    new, today = design.machine, design.today
    before, after = design.before.worst.frequency, design.after.worst.frequency
    pairs = list(zip(new.cylinders, today.cylinders, strict=True))
    oil, annulus = (
        sum(getattr(c, area) * c.stroke for c, _ in pairs)
        / sum(getattr(c, area) * c.stroke for _, c in pairs)
        for area in ("bore_area", "annulus_area")
    )
    torques = torque_shares(new, today) if design.requirements.digging else {}
    digging = [torques[name][0] for name in design.requirements.digging]
    return {
        "limit": limit,
        "frequency_hz": after,
        "unrounded_hz": design.unrounded,
        "gain": design.gain,
        **(
            {"banded_hz": design.band_after.low.frequency, "least_gain": design.least_gain}
            if design.problem.dynamics.corners.bands != Bands()
            else {}
        ),
        "oil_share": oil,
        "annulus_oil_share": annulus,
        "thrust_share": max(c.bore_area / old.bore_area for c, old in pairs),
        **({"digging_share": float(min(digging))} if digging else {}),
        "lift_share": design.lift_share,
        "pin_move_m": max(
            (check.value for check in design.checks if check.name.startswith("pin_box.")),
            default=0.0,
        ),
        "squared_times_speed": (after / before) ** 2 / oil if before > 0 else math.inf,
    }
