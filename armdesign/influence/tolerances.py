"""Tolerances: how the worst frequency differs from machine to machine of one drawing.

Monte Carlo with a scrambled Sobol sequence (Owen 1998): every machine is evaluated at the worst
pose and its rivals, which follow their ends and are sought anew where they would pass others, and
its worst frequency is the lowest of them. To these poses come local minima that a machine has with
one number at an end of its width, where a search finds it lower there. Beside it stands the
estimate by derivatives, f + Σ s δ, the lowest over the rivals, and where it fails.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arguments import checked, refuse_unless_seed
from armdesign.arrays import Array, Flags, ReadOnly, chunks, read_only, sobol
from armdesign.design.requirements.record import Check
from armdesign.errors import ArmDesignError
from armdesign.frequency.workspace import Workspace
from armdesign.influence.acceptance import JUDGED, Acceptance, acceptance, acceptance_sheet
from armdesign.influence.family import rebuilt
from armdesign.influence.rivals import LOWER, Rival, lowest_anywhere, rivals
from armdesign.influence.slopes import mass_slopes, slopes
from armdesign.influence.widths import Width, at_ends, family_of, widths_of
from armdesign.machine.machine import Machine
from armdesign.report.sheet import Sheet, worst_pose_text
from armdesign.short_repr import short_repr
from armdesign.units import WORKSHOP, Units, outward, share_text

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.plots.canvas import Axes

COUNT, MOST = 10_000, 1_000_000  # machines
NO_WIDTHS = "distribution", "least_hz", "keys"  # of [tolerances]
NARROWINGS = 8  # halvings of the widths with which all machines can take their worst pose
LOOKED_AT = 32  # machines whose poses are searched, not followed alone
PERCENTS = (0.1, 1, 5, 50, 95, 99, 99.9)
SHOWN = 15  # numbers in the printed table


@dataclass(frozen=True, eq=False)
class Tolerances(ReadOnly):
    """Worst frequencies of n machines within the tolerances of one file.

    Attributes:
        machine: the machine as its file describes it.
        workspace: poses over which its worst was looked for.
        rivals: its worst pose and the poses that could become the worst.
        others: further poses that are worst with one number at an end of its width.
        widths: the numbers that differ (w).
        values: their values (n, w), in the file's unit, of the mass of links a factor.
        slopes: derivatives of the rivals' frequencies by them (r, w, 2) [Hz per unit].
        of_rivals: frequencies of all machines at rivals and others (n, r + o) [Hz], NaN where a
            machine cannot take the pose, inf where no pose near it is in stroke.
        least: worst frequency that a machine must reach [Hz].
        stated: whether file or caller state it; else it is the file's worst frequency.
        searched: worst frequencies (k,) [Hz] of the first k machines, sought over the workspace.
    """

    __repr__ = short_repr

    machine: Machine
    workspace: Workspace
    rivals: tuple[Rival, ...]
    others: tuple[Rival, ...]
    widths: tuple[Width, ...]
    values: Array
    slopes: Array
    of_rivals: Array
    least: float
    stated: bool
    searched: Array

    @cached_property
    @read_only
    def frequencies(self) -> Array:
        """Worst frequency of every machine (n,) [Hz]; NaN where it does not work."""
        lowest = np.nanmin(self.of_rivals, axis=1)
        return np.asarray(np.where(np.isinf(lowest), np.nan, lowest))

    @property
    def working(self) -> Flags:
        """Whether each machine has a pose in stroke near those of the drawing (n,).

        One that has none meets no requirement.
        """
        return np.isfinite(self.frequencies)

    @cached_property
    @read_only
    def linear(self) -> Array:
        """Worst frequency of every machine (n,) [Hz] by the derivatives."""
        change = self.values - [width.value for width in self.widths]
        up, down = (np.clip(change, *ends) for ends in ((0, None), (None, 0)))
        lines = [
            rival.frequency + up @ slope[:, 0] + down @ slope[:, 1]
            for rival, slope in zip(self.rivals, self.slopes, strict=True)
        ]
        return np.asarray(np.min(lines, axis=0))

    @property
    def share(self) -> float:
        """Share of machines that reach the least frequency."""
        return float(np.mean(self.frequencies >= self.least))

    @property
    def linear_share(self) -> float:
        """Share of machines that reach the least frequency, by the derivatives."""
        return float(np.mean(self.linear >= self.least))

    @cached_property
    def acceptance(self) -> Acceptance:
        """The first 256 machines, judged by every requirement of the file and the frequency."""
        drawn, made = self.rivals[0].frequency, self.frequencies[:JUDGED]
        check = Check(
            name="frequency",
            words="worst frequency",
            unit="Hz",
            limit=self.least,
            at_least=True,
            value=drawn,
            slack=drawn / self.least - 1,
        )
        slacks = check, np.nan_to_num(made / self.least - 1, nan=-1.0)
        values = self.values[:JUDGED]
        return acceptance(self.machine, self.workspace, self.widths, values, slacks)

    @property
    def moved(self) -> float:
        """Share of machines whose worst pose is another than the file's."""
        return float(np.mean(np.nanargmin(self.of_rivals[self.working], axis=1) > 0))

    @property
    def frame(self) -> pd.DataFrame:
        """A row for each machine: the values that differ, then both worst frequencies."""
        import pandas as pd

        frame = pd.DataFrame(self.values, columns=[width.name for width in self.widths])
        return frame.assign(worst_hz=self.frequencies, linear_hz=self.linear)

    @cached_property
    def by_number(self) -> pd.DataFrame:
        """A row for each number that differs, the greatest share of the variance first.

        ``linear_hz``: half width times derivative of the worst pose; ``low_hz``, ``high_hz``:
        exact change at either end of the width, all else as in the file, NaN where that has no
        pose in stroke; ``curvature_hz``: what these are off the line together; ``variance``:
        share of the linear variance.
        """
        import pandas as pd

        half = np.array([width.half for width in self.widths])
        start = np.array([[width.value for width in self.widths]])
        limits = np.array([width.limits for width in self.widths])
        poses, values = (*self.rivals, *self.others), at_ends(self.widths)
        lowest = np.fmin.reduce(_frequencies(self.machine, poses, self.widths, values), axis=1)
        change = np.where(np.isinf(lowest), np.nan, lowest) - self.rivals[0].frequency
        ends = change.reshape(2, -1)
        line = self.slopes[0, :, 0] * half
        spread = self.slopes[0, :, 0] * (limits[:, 1] - limits[:, 0]) / 2
        expected = self.slopes[0, :, ::-1] * (limits - start.T)  # slopes are upwards, downwards
        off = np.fmax.reduce(np.abs(ends.T - expected), axis=1)
        frame = pd.DataFrame(
            {
                "number": [width.name for width in self.widths],
                "value": start[0],
                "half_width": half,
                "linear_hz": line,
                "low_hz": ends[0],
                "high_hz": ends[1],
                "curvature_hz": off,
                "variance": spread**2 / (spread @ spread or 1.0),
            }
        )
        return frame.sort_values("variance", ascending=False, ignore_index=True, kind="stable")

    @property
    def percentiles(self) -> pd.DataFrame:
        """Percentiles of the worst frequency [Hz], exact and by the derivatives."""
        import pandas as pd

        columns = {"exact": self.frequencies[self.working], "linear": self.linear[self.working]}
        return pd.DataFrame(
            {name: np.percentile(values, PERCENTS) for name, values in columns.items()},
            index=[f"{percent:g} %" for percent in PERCENTS],
        )

    def sheets(self, units: Units = WORKSHOP) -> list[Sheet]:
        """Share that is good enough, percentiles, and the numbers that spread it."""
        judged = acceptance_sheet(self.acceptance, units)
        return [self._summary(units), judged, self._percentiles(), self._numbers()]

    def _summary(self, units: Units) -> Sheet:
        worst, works = self.rivals[0], self.working
        made, linear = self.frequencies[works], self.linear[works]
        error = linear - made
        at = int(np.abs(error).argmax())
        near, found = self._searched_lower
        what = "stated" if self.stated else "of this file: none is stated, least_hz states one"
        spread = f"{made.std():.4f} Hz, by derivatives {linear.std():.4f} Hz"
        idle = np.count_nonzero(~works)
        words = f"{idle}: no pose near those of the drawing is in stroke; they are rejected"
        rows = (
            ("machines", f"{len(self.values)}, {len(self.widths)} numbers differ"),
            ("requirement", f"worst frequency of at least {self.least:.3f} Hz ({what})"),
            *([("do not work", words)] if idle else []),
            (
                "met by",
                f"{100 * self.share:.1f} %; by derivatives {100 * self.linear_share:.1f} %",
            ),
            (
                "as drawn",
                f"{worst.frequency:.3f} Hz at {worst_pose_text(self.machine, worst.pose, units)}",
            ),
            ("deviation", spread),
            ("worst pose moves", f"to a rival in {100 * self.moved:.1f} % of the machines"),
            (
                "derivatives fail",
                f"most at {made[at]:.3f} Hz, by {error[at]:+.4f} Hz; in the mean by"
                f" {np.mean(error):+.4f} Hz",
            ),
        )
        return Sheet(
            title=f"Worst frequency within the tolerances: {self.machine.name}",
            rows=rows,
            note=(
                f"poses followed past end stops and pitch limits: {self.of_rivals.shape[1]}; a"
                f" search over the workspace finds {share_text(near)} less at most, in {found} of"
                " the machines"
            ),
            bold=(2 + bool(idle),),
        )

    @property
    def _searched_lower(self) -> tuple[float, int]:
        """Share by which a search finds less at most, and number of machines that it finds."""
        found = np.isfinite(self.searched)
        followed = self.frequencies[: len(found)][found]
        less = (followed - self.searched[found]) / np.where(followed > 0, followed, 1.0)
        return float(np.max(less, initial=0.0)), int(np.count_nonzero(found))

    def _percentiles(self) -> Sheet:
        table = self.percentiles
        kinds = ("exact", "linear")
        rows = [(kind, *(f"{value:.4f}" for value in table[kind])) for kind in kinds]
        gap = table["linear"] - table["exact"]
        rows.append(("linear − exact", *(f"{value:+.4f}" for value in gap)))
        return Sheet(
            title="Percentiles of the worst frequency [Hz]",
            columns=("", *(f"{percent:g} %" for percent in PERCENTS)),
            rows=tuple(rows),
        )

    def _numbers(self) -> Sheet:
        rows = []
        for row in self.by_number.head(SHOWN).to_dict("records"):
            changes = (row[key] for key in ("linear_hz", "low_hz", "high_hz", "curvature_hz"))
            cells = (f"{1e3 * x:+.1f}" if np.isfinite(x) else "–" for x in changes)
            head = (row["number"], f"{row['half_width']:.3g}")
            rows.append((*head, *cells, f"{100 * row['variance']:.1f} %"))
        hidden = len(self.widths) - len(rows)
        dash = "; –: no pose is in stroke" if any("–" in row for row in rows) else ""
        return Sheet(
            title="What spreads the worst frequency [mHz]",
            columns=("number", "±", "linear", "low", "high", "off", "share"),
            rows=tuple(rows),
            note=(
                "low, high: exact at either end of the width, all else as drawn; off: most off the"
                f" line, where derivatives fail{dash}; share: of the linear variance"
                + (f"; {hidden} more in tolerances.csv" if hidden > 0 else "")
            ),
        )

    def plot(self, ax: Axes | None = None) -> Axes:
        """Distribution of the worst frequency, exact and by the derivatives."""
        from armdesign import plots

        return plots.distribution(self, ax)


@checked
def tolerances(
    machine: Machine,
    workspace: Workspace | None = None,
    *,
    count: int = COUNT,
    least: float | None = None,
    seed: int = 0,
) -> Tolerances:
    """Distribution of the worst frequency of machines within the file's ``[tolerances]``.

    Args:
        machine: the machine; its file states the widths.
        workspace: poses over which the worst is looked for, between them too; default:
            ``Workspace.grid(machine)``.
        count: number of machines, 16 to a million.
        least: worst frequency that a machine must reach [Hz]; default: ``least_hz`` of the file,
            without it the worst frequency of the file itself.
        seed: of the scrambling; equal seeds give equal machines.

    Raises:
        ArmDesignError: no widths, a number that has none, a count or least frequency that cannot
            be, a load case that exists at no pose, or a machine that is unstable at its worst
            pose.

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> workspace = ad.Workspace.grid(machine, points=3)
        >>> machine = machine.replace({"tolerances.pin_mm": 0.5})
        >>> spread = ad.tolerances(machine, workspace, count=64)
        >>> print(spread.percentiles.round(2))
                exact  linear
        0.1 %    7.34    7.34
        1 %      7.35    7.35
        5 %      7.36    7.37
        50 %     7.45    7.45
        95 %     7.53    7.53
        99 %     7.55    7.55
        99.9 %   7.56    7.56
    """
    _check(count, least, seed)
    widths = widths_of(machine)
    workspace = workspace or Workspace.grid(machine)
    poses = rivals(machine, workspace)
    others = _others(machine, workspace, poses, widths)
    values = _sampled(machine, widths, count, seed)
    of_rivals = _frequencies(machine, (*poses, *others), widths, values)
    lost = np.isnan(of_rivals[:, : len(poses)]).all(axis=1)
    if lost.any():
        raise ArmDesignError(
            f"{machine.source.name}: tolerances",
            f"{share_text(lost.mean())} of the machines cannot take the worst pose",
            _narrower(machine, poses, widths, count, seed),
        )
    if np.isinf(np.fmin.reduce(of_rivals, axis=1)).all():
        fault, remedy = "no machine has a pose in stroke near its worst pose", "give less"
        raise ArmDesignError(f"{machine.source.name}: tolerances", fault, remedy)
    stated = machine.section.tolerances.least_hz if least is None else least
    return Tolerances(
        machine=machine,
        workspace=workspace,
        rivals=poses,
        others=others,
        widths=widths,
        values=values,
        slopes=np.stack([_slopes(machine, rival, widths) for rival in poses]),
        of_rivals=of_rivals,
        least=poses[0].frequency if stated is None else stated,
        stated=stated is not None,
        searched=lowest_anywhere(family_of(machine, widths, values[:LOOKED_AT]), workspace),
    )


def _check(count: int, least: float | None, seed: int) -> None:
    whole = isinstance(count, int) and not isinstance(count, bool)
    if not (whole and 16 <= count <= MOST):
        remedy = f"give a whole number from 16 to {MOST:,}"
        raise ArmDesignError("count", f"{count!r} is not allowed", remedy)
    if least is not None and not (math.isfinite(least) and least > 0):
        raise ArmDesignError("least", f"{least:g} Hz is not allowed", "give a frequency above 0")
    refuse_unless_seed(seed)


def _sampled(machine: Machine, widths: Sequence[Width], count: int, seed: int) -> Array:
    """Values (n, w) of the numbers with widths, at the places of a scrambled Sobol sequence."""
    places = sobol(len(widths), count, seed)
    normal = machine.section.tolerances.distribution == "normal"
    columns = [width.values(at, normal) for width, at in zip(widths, places.T, strict=True)]
    return np.stack(columns, axis=1)


def _frequencies(
    machine: Machine, poses: Sequence[Rival], widths: Sequence[Width], values: Array
) -> Array:
    """Frequencies (n, r) [Hz] of machines at the rivals, NaN where they cannot take the pose."""
    parts = []
    for rows in chunks(len(values)):
        family = family_of(machine, tuple(widths), values[rows])
        parts.append(np.stack([rival.within_ends(family) for rival in poses], axis=1))
    return np.concatenate(parts)


def _narrower(
    machine: Machine, poses: Sequence[Rival], widths: Sequence[Width], count: int, seed: int
) -> str:
    """What to do where some machines cannot take any pose: widths with which all can."""

    def lost(share: float, rows: Array | slice) -> Array:
        less = [replace(width, half=share * width.half) for width in widths]
        values = _sampled(machine, less, count, seed)[rows]
        return np.flatnonzero(np.isnan(_frequencies(machine, poses, less, values)).all(axis=1))

    every, share = slice(None), 1.0
    rows = lost(share, every)
    while len(rows):  # those lost before may not be all: others have their turn
        low = 0.0
        for _ in range(NARROWINGS):
            middle = (low + share) / 2
            low, share = (low, middle) if len(lost(middle, rows)) else (middle, share)
        share = outward(low, 2, up=False)
        rows = lost(share, every)
    section = machine.section.tolerances
    stated = {key: width for key, width in section if key not in NO_WIDTHS and width}
    stated |= {f'keys."{path}"': half for path, half in section.keys.items()}
    narrower = (
        f"{key} = {outward(share * width, 3, up=False):g}" for key, width in stated.items()
    )
    return f"with {share_text(share)} of the widths they can: {', '.join(narrower)}"


def _others(
    machine: Machine, workspace: Workspace, poses: Sequence[Rival], widths: Sequence[Width]
) -> tuple[Rival, ...]:
    """Poses beside the rivals that are worst with one number of the file at an end of its width.

    Of machines that have rivals: not of one that is unstable there.
    """
    values = at_ends(widths)
    near = np.fmin.reduce(_frequencies(machine, poses, widths, values), axis=1)
    lowest = lowest_anywhere(family_of(machine, tuple(widths), values), workspace)
    points, found = [len(axis) for axis in workspace.axes], list(poses)
    for row in np.flatnonzero(lowest < (1 - LOWER) * near).tolist():
        number, value = widths[row % len(widths)].number, values[row, row % len(widths)]
        with suppress(ArmDesignError):
            other = rebuilt(machine, {number.location: float(value)} if number else {})
            own = Workspace.grid(other, points, workspace.end_margin)
            found += [one.of(machine) for one in rivals(other, own) if one.is_new(own, found)]
    return tuple(found[len(poses) :])


def _slopes(machine: Machine, rival: Rival, widths: Sequence[Width]) -> Array:
    """Derivatives (w, 2) of a rival's frequency by the numbers with widths."""
    numbers = [width.number for width in widths if width.number is not None]
    of_links = mass_slopes(machine, rival)[[w.body for w in widths if w.number is None]]
    return np.concatenate([slopes(machine, rival, numbers), of_links])
