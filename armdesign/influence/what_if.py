"""What if: all that matters of a machine before and after a change, linear and exact.

The linear estimates of worst frequencies come from exact derivatives, at worst pose and rivals of
each load case, along all that changes; of all other quantities the central difference of a
hundredth of the change, about one on where the file may not have one back, or, where the sides
differ, as at a least of several values, the difference to the side of the change. What jumps, as
the worst pose between equally low ones and percentiles where poses begin or cease to hold the
load, has an estimate only where it moves evenly.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from armdesign.arguments import checked
from armdesign.arrays import Flags
from armdesign.control.stated_damping import checked_damping
from armdesign.errors import ArmDesignError
from armdesign.frequency.maps import FrequencyMap, frequency_map
from armdesign.frequency.workspace import Workspace
from armdesign.hydraulics.cylinder_build import euler_safety
from armdesign.influence.bandwidth import SCHEMES, bandwidths, name_of
from armdesign.influence.estimates import impossible
from armdesign.influence.family import rebuilt
from armdesign.influence.rivals import rivals
from armdesign.influence.slopes import change_along
from armdesign.machine.changes import changed_machine, numeric_changes
from armdesign.machine.file.key_paths import Location
from armdesign.machine.file.numbers import may_be, numbers_of
from armdesign.machine.lift_chart import LiftChart, lift_chart_if_any
from armdesign.machine.machine import Machine
from armdesign.report.comparison import WORST_POSE, is_position, quantities
from armdesign.report.sheet import Sheet
from armdesign.short_repr import short_repr
from armdesign.units import WORKSHOP, Units, masses, percent

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.plots.canvas import Axes

Quantities: TypeAlias = Mapping[str, tuple[Any, str]]  # value and SI unit by name
More: TypeAlias = Callable[[FrequencyMap], Quantities]
PART = 0.01  # of the change, by which quantities are differenced
UNCHANGED = 5e-5  # relative change that is none
WORST, LIFT = "worst", "lift at "  # the worst frequency, and beginning of masses on the chart
SIGNED = ("m", "rad")  # units of places and angles, which may be below zero
COUNTED = "limiting."  # beginning of shares of poses, which jump
# in names of what the poses of a grid decide
OF_POSES = ".percentile_", ".static_pressure", "bandwidth."
EVEN, STILL = 0.2, 1e-5  # two sides differ by so much of both, or [rad, m] of a position, at most
SMOOTH = 0.02  # the same of what does not jump: by so much of a slope the mean is off at most


@dataclass(frozen=True, eq=False)
class WhatIf:
    """A machine before and after a change.

    Attributes:
        changes: values before and after by key path, as in the file.
        before: the map of the machine.
        after: the map of the changed machine over its own workspace.
        frame: a row for each quantity: name, SI unit, value before, linear estimate (NaN where the
            change is no number, of what jumps and of positions of joints without effect; below
            zero where it is too large), value after, and relative change by both (NaN of joint
            positions, whose zero means nothing).
        missing: why there are no bandwidths; empty where there are, or none are asked for.
        damping: ratio of all modes on which bandwidths rest; None: what the file gives.
    """

    __repr__ = short_repr

    changes: dict[str, tuple[Any, Any]]
    before: FrequencyMap
    after: FrequencyMap
    frame: pd.DataFrame
    missing: str = ""
    damping: float | None = None

    @property
    def headline(self) -> str:
        """Machine, and its worst frequency before and after."""
        before, after = (one.worst.frequency for one in (self.before, self.after))
        return f"of {self.before.machine.name}: worst {before:.4g} → {after:.4g} Hz"

    @cached_property
    def numbers(self) -> pd.DataFrame:
        """The numbers of the frame by quantity, without ``impossible`` linear estimates."""
        table = self._numeric.copy()
        table.loc[self.impossible, ["linear", "linear_change"]] = np.nan
        return table

    @property
    def impossible(self) -> Flags:
        """Which linear estimates are below zero, though no such value is: the change is large."""
        table = self._numeric
        signed = table["unit"].isin(SIGNED) | (table["before"] < 0) | (table["after"] < 0)
        return impossible(table["before"], table["linear"] - table["before"]) & ~signed

    @property
    def _numeric(self) -> pd.DataFrame:
        numeric = ~self.frame["before"].map(lambda value: isinstance(value, str))
        return self.frame[numeric].astype({"before": float, "after": float}).set_index("quantity")

    def sheets(self, units: Units = WORKSHOP) -> list[Sheet]:
        """Changes, frequencies, lift, and all other quantities that change."""
        names = self.numbers.index
        lift = names.str.startswith(LIFT)
        hertz = self.numbers["unit"] == "Hz"
        others = self.numbers[~lift & ~hertz]
        counted = others.index.str.startswith(COUNTED)  # all that can limit, or shares mislead
        moved = others[(~self._unchanged(others) & others["before"].notna()) | counted]
        unchanged = len(others) - len(moved)
        note = f"{unchanged} others do not change; all are in what_if.csv"
        sheets = [
            self._changes(),
            self._sheet("Frequencies [Hz]", self.numbers[hertz], units, self._notes()),
        ]
        charted = self.numbers[lift & (self.numbers["before"] > 0) & self.numbers["after"].notna()]
        if len(charted):
            sheets.append(self._lift(charted))
        return [*sheets, self._sheet("Forces, speeds, pressures, reach", moved, units, note)]

    def _unchanged(self, table: pd.DataFrame) -> Flags:
        """Which quantities are as before, joint positions to ``UNCHANGED`` [rad, m].

        Positions of joints without effect mean nothing: every other is as low.
        """
        positions = [is_position(name) for name in table.index]
        moved = np.where(positions, table["after"] - table["before"], table["change"])
        nothing = [_means_nothing(name, self.before.machine) for name in table.index]
        return np.asarray((np.abs(moved) < UNCHANGED) | nothing)

    def _changes(self) -> Sheet:
        pairs = self.changes.items()
        rows = tuple((path, *("–" if v is None else f"{v}" for v in both)) for path, both in pairs)
        return Sheet(
            title=f"What if: {self.before.machine.name}",
            columns=("key", "before", "after"),
            rows=rows,
            note=self._without_estimate(),
        )

    def _without_estimate(self) -> str:
        """Why linear estimates are left out; empty where they are not."""
        if not self.changes:
            return "nothing changes: these are the values that the machine has"
        if self.frame["linear"].isna().all():
            return "no linear estimate: more than numbers changes, a word or a count"
        below = int(self.impossible.sum())
        if not below:
            return ""
        return (
            f"{below} linear estimates are left out: they are below zero, which their quantities"
            " never are, as the change is too large for a straight line"
        )

    def _notes(self) -> str:
        if name_of(SCHEMES[0]) not in self.numbers.index:
            return self._where()
        stated = "of the file" if self.damping is None else f"stated, {self.damping:g}"
        widths = (
            f"; bandwidth: of the narrowest loop, gains common to all, at the lowest pose of the"
            f" grid, damping {stated}"
        )
        why = f"; none is given: {self.missing}" if self.missing else ""
        return self._where() + widths + why

    def _where(self) -> str:
        one, two = self.before.worst, self.after.worst
        same = one.payload == two.payload and one.cylinder == two.cylinder
        moves = "" if same else "; the worst moves there"
        return (
            f"worst before: payload {one.payload}, limited by {one.cylinder}; after: payload"
            f" {two.payload}, limited by {two.cylinder}{moves}"
        )

    def _sheet(self, title: str, table: pd.DataFrame, units: Units, note: str) -> Sheet:
        rows = []
        for name, row in table.iterrows():
            values = _cells(
                [row[kind] for kind in ("before", "linear", "after")], row["unit"], units
            )
            unit = units.name(row["unit"]) if row["unit"] in units.table else row["unit"]
            if is_position(str(name)):
                both = (row[kind] - row["before"] for kind in ("linear", "after"))
                shares = tuple(_difference(change, row["unit"], units) for change in both)
            else:
                shares = tuple(percent(row[kind]) for kind in ("linear_change", "change"))
            head = f"{name} [{unit}]" if unit not in ("", "Hz") else str(name)
            rows.append((head, *values, *shares))
        return Sheet(
            title=title,
            columns=("quantity", "before", "linear", "after", "change [linear]", "change"),
            rows=tuple(rows),
            note=note,
        )

    def _lift(self, known: pd.DataFrame) -> Sheet:
        """Least, median and greatest change of what the machine lifts over its chart."""
        ratios = {kind: known[kind] / known["before"] - 1 for kind in ("linear", "after")}
        exact = ratios["after"]
        rows = []
        ends = {"least": exact.argmin(), "greatest": exact.argmax()}
        for words, at in ends.items() if exact.min() < exact.max() else ():
            row = known.iloc[int(at)]
            lifted = masses(row[kind] for kind in ("before", "linear", "after"))
            cells = (percent(ratios[kind].iloc[int(at)]) for kind in ("linear", "after"))
            rows.append((f"{words} change, {known.index[int(at)]}", *lifted, *cells))
        medians = (percent(float(ratios[kind].median())) for kind in ("linear", "after"))
        rows.append(("median change", "", "", "", *medians))
        return Sheet(
            title="Change over the lift chart [kg]",
            columns=("point", "before", "linear", "after", "change [linear]", "change"),
            rows=tuple(rows),
            note=f"{len(known)} points; every point is in what_if.csv, by reach and height",
        )

    def plot(self, ax: Axes | None = None) -> Axes:
        """Relative changes of all quantities, linear against exact."""
        from armdesign import plots

        return plots.linear_against_exact(self, ax)


def _cells(values: Sequence[Any], unit: str, units: Units) -> list[str]:
    known = [float("nan" if value is None else value) for value in values]
    if unit in units.table:
        numbers = units.numbers(known, unit)
    else:
        numbers = [f"{value:.4f}" for value in known]
    return [
        number if np.isfinite(value) else "–" for value, number in zip(known, numbers, strict=True)
    ]


def _difference(change: float, unit: str, units: Units) -> str:
    """A change of a joint's position [rad, m] with its sign."""
    if not np.isfinite(change):
        return "–"
    words = units.text(abs(change), unit)
    return f"{'-' if words != units.text(0.0, unit) and change < 0 else '+'}{words}"


@checked
def what_if(
    machine: Machine,
    changes: Mapping[str, Any],
    points: int | Sequence[int] | None = None,
    *,
    more: Callable[[FrequencyMap], Quantities] | None = None,
    bandwidth: bool | None = None,
    damping: float | None = None,
) -> WhatIf:
    """Effect of other numbers in a machine's file, all changes at once.

    Each machine is mapped over its own workspace, so that ranges may change, too.

    Args:
        machine: the machine.
        changes: new values by key path, in the file's units, as
            ``{"cylinder.boom.bore_mm": 125.0}``; of a list also one number, as
            ``cylinder.boom.base.at_mm.0``.
        points: of the joint grids, as in ``Workspace.grid``.
        more: further quantities of a mapped machine, value and SI unit by name; None: no more.
        bandwidth: whether bandwidths at the lowest pose are among them; None: where there are
            some. None rests on zero damping.
        damping: ratio of all modes that bandwidths rest on; None: what the file gives.

    Raises:
        ArmDesignError: a key that does not exist, with the nearest that does; a value that it
            cannot have; a machine that cannot be; or no bandwidth where one must be.

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> answer = ad.what_if(machine, {"cylinder.lift.bore_mm": 70.0}, points=3)
        >>> worst = answer.frame.iloc[0]
        >>> print(f"{worst['quantity']}: {worst['before']:.2f} to {worst['after']:.2f} Hz")
        worst: 7.45 to 9.56 Hz
    """
    if not isinstance(changes, Mapping):
        raise ArmDesignError("what-if", f"{changes!r}: expected {{key path: value}}")
    other = changed_machine(machine, changes)
    checked_damping(damping)
    today, new = (frequency_map(one, Workspace.grid(one, points)) for one in (machine, other))
    chart = lift_chart_if_any(machine)

    missing: dict[str, None] = {}

    def everything(frequencies: FrequencyMap) -> Quantities:
        own = more(frequencies) if more else {}
        if bandwidth is not False:
            widths, why = _bandwidths(frequencies, damping, needed=bandwidth is True)
            own, missing[why] = {**widths, **own}, None
        return {**_all_quantities(frequencies, chart), **own}

    before, after = everything(today), everything(new)
    why = next(filter(None, missing), "")
    steps = numeric_changes(machine, other)
    linear = _linear(machine, steps, points, everything, before) if steps else {}
    frame = _frame(before, linear, after)
    return WhatIf(_differing(machine, other), today, new, frame, why, damping)


def _bandwidths(
    frequencies: FrequencyMap, damping: float | None, *, needed: bool
) -> tuple[Quantities, str]:
    """Bandwidths of a mapped machine, and why there are none.

    Raises:
        ArmDesignError: there are none where they are needed.
    """
    try:
        return bandwidths(frequencies, damping), ""
    except ArmDesignError as error:
        if needed:
            raise
        return {name_of(scheme): (None, "Hz") for scheme in SCHEMES}, str(error)


def _differing(machine: Machine, other: Machine) -> dict[str, tuple[Any, Any]]:
    """Values before and after by key path, of lists number by number."""
    from armdesign.machine.file.machine_file import differing

    return differing(_plain(machine), _plain(other))


def _plain(machine: Machine) -> dict[str, Any]:
    from armdesign.machine.file.machine_file import flat

    numbers = {path: number.value for path, number in numbers_of(machine.section).items()}
    values = {path: v for path, v in flat(machine.section).items() if not isinstance(v, list)}
    return values | numbers


def _all_quantities(
    frequencies: FrequencyMap, chart: LiftChart | None
) -> dict[str, tuple[Any, str]]:
    """Value and SI unit of everything that matters, by name."""
    machine = frequencies.machine
    values = {WORST: (frequencies.worst.frequency, "Hz"), **quantities(frequencies)}
    largest = frequencies.static_pressures.max(axis=0)
    for actuator, pressure in zip(machine.actuators, largest, strict=True):
        values[f"{actuator.name}.static_pressure"] = (float(pressure), "Pa")
    for cylinder in machine.cylinders:
        sizes = cylinder.bore, cylinder.rod, cylinder.open_length
        safety = float(euler_safety(*sizes, cylinder.available_pressure(machine.supply)))
        values[f"{cylinder.name}.buckling_safety"] = (safety, "")
    own = lift_chart_if_any(machine, chart) if chart else None
    if own is not None:
        for reach, height, mass in zip(own.reach, own.height, own.capacity, strict=True):
            values[f"{LIFT}reach {reach:.3g} m, height {height:.3g} m"] = (float(mass), "kg")
    return values


def _linear(
    machine: Machine,
    steps: Mapping[Location, tuple[float, float]],
    points: int | Sequence[int] | None,
    everything: More,
    before: Quantities,
) -> dict[str, float]:
    """Linear estimates by the name of the quantity."""

    def after(part: float) -> Quantities:
        near = rebuilt(machine, {at: a + part * (b - a) for at, (a, b) in steps.items()})
        return everything(frequency_map(near, Workspace.grid(near, points)))

    back = may_be(machine.section, {at: a - PART * (b - a) for at, (a, b) in steps.items()})
    known = (after(-PART), before, after(PART)) if back else (before, after(PART), after(2 * PART))
    estimates = {}
    for name, (value, _) in before.items():
        low, at, high = (side.get(name, (None, ""))[0] for side in known)
        numeric = not isinstance(value, str) and None not in (value, low, at, high)
        if numeric and not name.startswith(COUNTED) and not _means_nothing(name, machine):
            estimates[name] = value - at + _estimate(name, at, high, low)
    exact = _frequency_changes(machine, steps, Workspace.grid(machine, points))
    return estimates | {name: before[name][0] + change for name, change in exact.items()}


def _estimate(name: str, value: float, after: float, before: float) -> float:
    """Estimate from a value and those a part of the change on and back; NaN of what jumps."""
    position = is_position(name)
    jumps = position or any(part in name for part in OF_POSES)
    still = STILL if position else PART * UNCHANGED * abs(value)
    if _evenly(before, value, after, still, EVEN if jumps else SMOOTH):
        return value + (after - before) / (2 * PART)
    return math.nan if jumps else value + (after - value) / PART


def _means_nothing(name: str, machine: Machine) -> bool:
    """Whether a quantity is the position of a joint that changes no frequency."""
    joint = name.rpartition(f"{WORST_POSE}.")[2]
    return is_position(name) and any(
        joint == machine.joints[j] for j in machine.joints_without_effect
    )


def _evenly(
    before: float, at: float, after: float, still: float = STILL, share: float = EVEN
) -> bool:
    """Whether a value moves on as it came, rather than jump, turn off or meet a limit.

    Both sides differ by a share of both at most, but for what is no motion, ``still``.
    """
    come, gone = at - before, after - at
    return abs(gone - come) <= still + share * (abs(come) + abs(gone))


def _frequency_changes(
    machine: Machine, steps: Mapping[Location, tuple[float, float]], grid: Workspace
) -> dict[str, float]:
    """Changes of the worst frequency [Hz] of all load cases and of each, by worst and rivals."""
    numbers = [n for n in numbers_of(machine.section).values() if n.location in steps]
    changes = {n: steps[n.location][1] - steps[n.location][0] for n in numbers}
    today, new = {}, {}
    for case in machine.payloads:
        alone = replace(machine, payload=case, payloads=(case,))
        poses = rivals(alone, grid)
        today[case.name] = poses[0].frequency
        new[case.name] = min(one.frequency + change_along(alone, one, changes) for one in poses)
    of_cases = {f"{name}{WORST_POSE}": new[name] - today[name] for name in new}
    return {**of_cases, WORST: min(new.values()) - min(today.values())}


def _frame(before: Quantities, linear: Mapping[str, float], after: Quantities) -> pd.DataFrame:
    import pandas as pd

    rows = []
    for name in [*before, *(name for name in after if name not in before)]:
        unit = (before.get(name) or after[name])[1]
        one, two = (side.get(name, (None, unit))[0] for side in (before, after))
        estimate = linear.get(name, np.nan)
        numeric = not isinstance(one, str) and one is not None and not is_position(name)
        shares = [
            value / one - 1 if numeric and one and value is not None else np.nan
            for value in (estimate, two)
        ]
        rows.append((name, unit, one, estimate, two, *shares))
    columns = ["quantity", "unit", "before", "linear", "after", "linear_change", "change"]
    return pd.DataFrame(rows, columns=columns)
