"""Sensitivity: how the worst frequency changes with every number of the machine file.

``sensitivity`` answers with derivatives at the worst pose and at its rivals, and with changes by a
natural step, linear and exact: 10 mm, 100 kg, 1 % of air, a tenth of the bulk modulus, 10 MN/m.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from armdesign.arguments import checked
from armdesign.arrays import Array, ReadOnly
from armdesign.errors import ArmDesignError
from armdesign.frequency.workspace import Workspace
from armdesign.influence.bandwidth import SCHEMES, at_pose
from armdesign.influence.estimates import impossible
from armdesign.influence.family import Family, can_matter, rebuilt
from armdesign.influence.rivals import LOWER, WITHIN, Rival, lowest_anywhere, rivals
from armdesign.influence.slopes import slopes
from armdesign.influence.turns import at_worst_turn
from armdesign.machine.file.contradictions import contradictions
from armdesign.machine.file.numbers import Number, numbers_of, with_values
from armdesign.machine.machine import Machine
from armdesign.report.sheet import Sheet, worst_pose_text
from armdesign.short_repr import short_repr
from armdesign.units import WORKSHOP, Units

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.plots.canvas import Axes

T = TypeVar("T", float, Array)
NEGLIGIBLE = 1e-6  # change of the worst frequency by a natural step, relative, that is none
PART = 0.01  # of a natural step, by which any quantity is differenced
WAYS, KINDS = ("up", "down"), ("linear", "exact")
SHOWN = 25  # numbers in the printed table; the CSV file has them all


@dataclass(frozen=True, eq=False)
class Sensitivity(ReadOnly):
    """Worth of every number of a machine file.

    Attributes:
        machine: the machine.
        rivals: the worst pose, and after it the poses that could become the worst.
        numbers: all numbers that matter, the greatest change by a natural step first.
        slopes: derivatives of the frequencies of the rivals by them (r, k, 2) [Hz per unit of the
            file], upwards and downwards: exact.
        changes: of the worst frequency by a natural step up and down (k, 2, 2) [Hz]: linear, and
            exact by searches near the rivals and over the workspace; NaN where the file cannot
            have such a number.
        left_out: number of other numbers, which do not matter.
    """

    __repr__ = short_repr

    machine: Machine
    rivals: tuple[Rival, ...]
    numbers: tuple[Number, ...]
    slopes: Array
    changes: Array
    left_out: int

    @property
    def headline(self) -> str:
        """Machine, its worst frequency, and how many numbers it was asked of."""
        worst = f"worst {self.rivals[0].frequency:.4g} Hz"
        return f"of {self.machine.name}: {worst}, by {len(self.numbers)} numbers"

    @cached_property
    def frame(self) -> pd.DataFrame:
        """A row for each number that matters, the greatest change first.

        Columns: ``key``, ``value``, ``unit``, ``step``; ``hz_per_unit`` of the worst pose, and
        downwards where it differs; ``up_linear_hz``, ``up_exact_hz``, ``down_linear_hz``,
        ``down_exact_hz``: change of the worst frequency by one step; ``overtaken_at``: value at
        which a rival becomes the worst, linear; ``rival_2_hz_per_unit`` …: of the rivals.
        """
        import pandas as pd

        columns: dict[str, Any] = {
            "key": [number.path for number in self.numbers],
            "value": [number.value for number in self.numbers],
            "unit": [number.unit for number in self.numbers],
            "step": [number.step[1] for number in self.numbers],
            "hz_per_unit": self.slopes[0, :, 0],
            "hz_per_unit_downwards": self.slopes[0, :, 1],
        }
        for j, kind in enumerate(KINDS):
            for i, way in enumerate(WAYS):
                columns[f"{way}_{kind}_hz"] = self.changes[:, i, j]
        columns["overtaken_at"] = self._overtaken
        for r in range(1, len(self.rivals)):
            columns[f"rival_{r + 1}_hz_per_unit"] = self.slopes[r, :, 0]
        return pd.DataFrame(columns)

    @property
    def _overtaken(self) -> list[float]:
        """Value of each number, nearest to its own, at which a rival becomes the worst."""
        values = []
        for k, number in enumerate(self.numbers):
            nearest = np.inf
            for rival, slope in zip(self.rivals[1:], self.slopes[1:, k], strict=True):
                gap = rival.frequency - self.rivals[0].frequency
                for way, closing in zip((1, -1), self.slopes[0, k] - slope, strict=True):
                    change = gap / closing if closing else 0.0
                    inside = number.low <= number.value + change <= number.high
                    if change * way > 0 and inside and abs(change) < abs(nearest):
                        nearest = change
            values.append(number.value + nearest if np.isfinite(nearest) else np.nan)
        return values

    @property
    def possible_changes(self) -> Array:
        """``changes`` without linear ones by which the worst frequency would be below zero."""
        changes = np.array(self.changes)
        changes[:, :, 0][impossible(self.rivals[0].frequency, self.changes[:, :, 0])] = np.nan
        return changes

    def differences(self, quantity: Callable[[Machine], float], count: int = SHOWN) -> Any:
        """Change of any other quantity, such as a bandwidth, by a natural step of single numbers.

        By differences of a hundredth of the step, central where the file may have both values: a
        series by key path.

        Args:
            quantity: a number of a machine.
            count: how many of the numbers, the greatest change of the worst frequency first.
        """
        import pandas as pd

        changes = differences(self.machine, self.numbers[:count], quantity)
        return pd.Series(changes, dtype=float)

    def bandwidths(self, damping: float | None = None) -> pd.DataFrame:
        """Change of the bandwidth at the worst pose by a natural step of every number [Hz].

        By differences, the greatest first; also of numbers that no frequency depends on, such as
        leakage, friction and valves. Numbers that change none are left out.

        Args:
            damping: ratio of all modes in place of the file's damping; None: the file's.

        Returns:
            A row for each number: ``key``, ``value``, ``unit``, ``step``; ``proportional_hz``: of
            position gains alone, ``damped_hz``: with feedback of the load pressures; common gains.

        Raises:
            ArmDesignError: as ``bandwidth_map``.
        """
        import pandas as pd

        pose = self.rivals[0].pose
        widths = partial(at_pose, q=pose.q, payload=pose.payload, damping=damping)
        numbers = list(numbers_of(self.machine.section).values())
        changes = differences(self.machine, numbers, widths)
        columns = {
            "key": [number.path for number in numbers],
            "value": [number.value for number in numbers],
            "unit": [number.unit for number in numbers],
            "step": [number.step[1] for number in numbers],
        }
        each = np.array([changes.get(number.path, np.zeros(2)) for number in numbers])
        columns |= {f"{name}_hz": each[:, k] for k, name in enumerate(SCHEMES)}
        frame = pd.DataFrame(columns)
        matters = np.abs(each / widths(self.machine)).max(axis=1) > NEGLIGIBLE
        size = frame["damped_hz"].abs()
        return frame[matters].loc[size[matters].sort_values(ascending=False).index]

    def sheets(self, units: Units = WORKSHOP) -> list[Sheet]:
        """Worst pose with its rivals, and the table of the numbers."""
        return [self._rivals(units), self._table()]

    def _rivals(self, units: Units) -> Sheet:
        rows = []
        for rival in self.rivals:
            ends = ", ".join(end.words for end in rival.ends.ends) or "nothing"
            second = f"{rival.next_frequency:.3f}" if np.isfinite(rival.next_frequency) else "–"
            where = worst_pose_text(self.machine, rival.pose, units)
            rows.append((f"{rival.frequency:.3f}", second, rival.pose.cylinder, ends, where))
        return Sheet(
            title="Worst pose and its rivals [Hz]",
            columns=("frequency", "next mode", "limited by", "held by", "where"),
            rows=tuple(rows),
            note="held by: ends that the pose follows when a number moves them",
            bold=(0,),
            words=("held by", "where"),
        )

    def _table(self) -> Sheet:
        rows = []
        shown = self.possible_changes[:SHOWN]
        for number, (up, down) in zip(self.numbers[:SHOWN], shown, strict=True):
            value = f"{number.value:.5g} {number.unit}".strip()
            cells = (_change(x) for x in (up[0], up[1], down[0], down[1]))
            rows.append((number.path, value, number.step[1], *cells))
        hidden = len(self.numbers) - len(rows)
        more = f"{hidden} more in sensitivity.csv; " if hidden > 0 else ""
        return Sheet(
            title="Change of the worst frequency by a natural step [mHz]",
            columns=("key", "value", "step", "up", "up [exact]", "down", "down [exact]"),
            rows=tuple(rows),
            note=(
                f"{more}{self.left_out} numbers of the file do not matter; up, down: by the"
                " derivatives of worst pose and rivals; exact: by searches near them and over the"
                " workspace; of a compliance the step is a share of its stiffness; –: the file"
                " cannot have such a number, or the straight line ends below 0 Hz"
            ),
        )

    def plot(self, ax: Axes | None = None) -> Axes:
        """The tornado: change of the worst frequency by a natural step of each number."""
        from armdesign import plots

        return plots.tornado(self, ax)


def differences(
    machine: Machine, numbers: Sequence[Number], quantity: Callable[[Machine], T]
) -> dict[str, T]:
    """Change of a quantity by a natural step of each number, by key path; see ``Sensitivity``."""
    changes = {}
    for number in numbers:
        ends = []
        for step in _ways(machine, number, PART):
            part = step if np.isfinite(step) else 0.0
            near = rebuilt(machine, {number.location: number.value + part})
            ends.append((part, quantity(near)))
        (up, higher), (down, lower) = ends
        if up != down:
            changes[number.path] = (higher - lower) / (up - down) * number.step[0]
    return changes


def bandwidth_sheet(
    sensitivity: Sensitivity, frame: pd.DataFrame, damping: float | None = None
) -> Sheet:
    """Change of the bandwidth at the worst pose by a natural step: ``frame`` as a table."""
    pose = sensitivity.rivals[0].pose
    today = at_pose(sensitivity.machine, pose.q, pose.payload, damping)
    changes = frame.head(SHOWN)[[f"{name}_hz" for name in SCHEMES]].to_numpy(dtype=float)
    changes = np.where(impossible(today, changes), np.nan, changes)
    rows = [
        (
            str(row["key"]),
            f"{row['value']:.5g} {row['unit']}".strip(),
            str(row["step"]),
            *map(_change, both),
        )
        for (_, row), both in zip(frame.head(SHOWN).iterrows(), changes, strict=True)
    ]
    more = f"{len(frame) - len(rows)} more change it; " if len(frame) > len(rows) else ""
    return Sheet(
        title="Change of the bandwidth at the worst pose by a natural step [mHz]",
        columns=("key", "value", "step", "position gains alone", "with pressure feedback"),
        rows=tuple(rows),
        note=(
            f"{more}today {1e3 * today[0]:.3g} mHz by position gains alone, {1e3 * today[1]:.3g}"
            " mHz with pressure feedback, of gains common to all joints; by differences; –: the"
            " straight line ends below 0"
        ),
    )


def _change(change: float) -> str:
    digits = 1 if abs(change) < 0.1 else 0
    return f"{1e3 * change:+.{digits}f}" if np.isfinite(change) else "–"


@checked
def sensitivity(
    machine: Machine, workspace: Workspace | None = None, within: float = WITHIN
) -> Sensitivity:
    """Change of the worst frequency with every number of a machine's file.

    Derivatives are exact: of K and M by a complex step along each number, of the worst pose by
    the multipliers of the ends that hold it. Numbers of a URDF are left as they are; ``[links]``
    holds numbers of the file, whose derivatives are differences.

    Args:
        machine: the machine.
        workspace: poses over which the worst is looked for, between them too; default:
            ``Workspace.grid(machine)``.
        within: share of the worst frequency by which rivals may lie above it.

    Raises:
        ArmDesignError: a load case exists at no pose, the machine is unstable at its worst pose,
            or ``within`` is no share.

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> workspace = ad.Workspace.grid(machine, points=3)
        >>> worth = ad.sensitivity(machine, workspace)
        >>> rows = worth.frame.set_index("key")
        >>> print(rows.loc["cylinder.lift.bore_mm", "hz_per_unit"].round(3), "Hz per mm")
        0.287 Hz per mm
    """
    if not 0 <= within <= 10:
        raise ArmDesignError("within", f"{within!r} is not allowed", "give a share in [0, 10]")
    workspace = workspace or Workspace.grid(machine)
    poses = rivals(machine, workspace, within)
    numbers = list(numbers_of(machine.section).values())
    derivatives = np.stack([slopes(machine, rival, numbers) for rival in poses])
    effect = np.abs(derivatives).max(axis=2) * [abs(number.step[0]) for number in numbers]
    known = np.flatnonzero(effect.max(axis=0) > NEGLIGIBLE * poses[0].frequency)
    chosen, derivatives = [numbers[k] for k in known], derivatives[:, known]
    steps = np.array([_ways(machine, number) for number in chosen]).reshape(-1, 2)
    exact = _exact(machine, workspace, poses, chosen, steps)
    changes = np.stack([_linear(poses, steps, derivatives), exact], axis=2)
    size = np.nan_to_num(np.abs(changes[:, :, 0])).max(axis=1)
    order = np.argsort(-size, kind="stable")
    return Sensitivity(
        machine=machine,
        rivals=poses,
        numbers=tuple(chosen[k] for k in order),
        slopes=derivatives[:, order],
        changes=changes[order],
        left_out=len(numbers) - len(known),
    )


def _ways(machine: Machine, number: Number, share: float = 1.0) -> list[float]:
    """A share of a natural step up and down; NaN where the file cannot have it."""
    steps = (share * number.step[0], -share * number.step[0])
    return [step if _fits(machine, number, number.value + step) else np.nan for step in steps]


def _fits(machine: Machine, number: Number, value: float) -> bool:
    """Whether the file can have another number, by itself and beside all others."""
    if not number.low <= value <= number.high:
        return False
    section = with_values(machine.section, {number.location: value})
    return not any(contradictions(section, machine.name))


def _linear(poses: Sequence[Rival], steps: Array, derivatives: Array) -> Array:
    """Change of the worst frequency by steps up and down (k, 2) [Hz], by the derivatives."""
    start = np.array([rival.frequency for rival in poses])[:, None, None]
    slope = np.where(steps >= 0, derivatives[:, :, :1], derivatives[:, :, 1:])
    return np.asarray((start + slope * steps).min(axis=0) - start[0])


def _exact(
    machine: Machine,
    workspace: Workspace,
    poses: Sequence[Rival],
    numbers: Sequence[Number],
    steps: Array,
) -> Array:
    """Change of the worst frequency by steps up and down (k, 2) [Hz], by searches."""
    lowest = np.full((len(poses), *steps.shape), np.nan)
    batched = [k for k, number in enumerate(numbers) if can_matter(number.location)]
    for way in (0, 1):
        fits = [k for k in batched if np.isfinite(steps[k, way])]
        values = {
            numbers[k].location: numbers[k].value + np.where(np.arange(len(fits)) == i, step, 0.0)
            for i, (k, step) in enumerate(zip(fits, steps[fits, way], strict=True))
        }
        family = Family.of(machine, values, len(fits))
        if fits:
            near = np.fmin.reduce([rival.lowest_near(family) for rival in poses])
            beyond = lowest_anywhere(family, workspace)
            lowest[:, fits, way] = np.where(beyond < (1 - LOWER) * near, beyond, near)
        for k in set(range(len(numbers))) - set(batched):
            if np.isfinite(steps[k, way]):
                value = numbers[k].value + steps[k, way]
                lowest[:, k, way] = [_alone(machine, one, numbers[k], value) for one in poses]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # NaN alone
        return np.asarray(np.nanmin(lowest, axis=0) - poses[0].frequency)


def _alone(machine: Machine, rival: Rival, number: Number, value: float) -> float:
    """A rival's frequency [Hz] with another number that no family can have as an array.

    Where joints change no frequency, also sought from the turn that the number makes the worst.
    """
    other = rebuilt(machine, {number.location: value})
    one = rival.of(other)
    starts = np.unique([rival.pose.q, at_worst_turn(machine, one)[1]], axis=0)
    return float(np.fmin.reduce(one.at(starts).lowest_near(Family.of(other, {}, len(starts)))))
