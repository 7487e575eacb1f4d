"""Two machines, or two versions of one: frequencies, limiting cylinders, differing values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from armdesign.design.requirements.settings import Requirements
from armdesign.frequency.maps import FrequencyMap, frequency_map
from armdesign.frequency.workspace import MARGIN_TOLERANCE, Workspace
from armdesign.machine.file import machine_file
from armdesign.machine.machine import Machine
from armdesign.machine.parts import coordinates
from armdesign.machine.poses import pose_text
from armdesign.report.lift_charts import lift_charts, lift_sheet
from armdesign.report.loads import loads_sheet
from armdesign.report.maps import between_poses, spread_sheet
from armdesign.report.performance import figures, performance_sheet
from armdesign.report.sheet import Sheet
from armdesign.units import WORKSHOP, Units, percent

if TYPE_CHECKING:
    import pandas as pd

    from armdesign.machine.lift_chart import LiftChart
    from armdesign.plots.canvas import Figure

WORST_POSE = ".worst"  # after the load case, in names of what stands at its worst pose
SHOWN = 40  # differing keys that are printed; the CSV has them all


@dataclass(frozen=True, eq=False)
class Comparison:
    """Frequency maps of two machines by their labels.

    Attributes:
        maps: of both.
        apart: why they are not in one workspace; empty where they are.
    """

    maps: dict[str, FrequencyMap]
    apart: str = ""

    @property
    def same_workspace(self) -> bool:
        """Whether both are mapped at the same poses."""
        return not self.apart

    @property
    def sentences(self) -> list[str]:
        """What is not compared, and why; nothing where all is."""
        said = [f"{self.apart}: each is mapped in its own workspace"] if self.apart else []
        one, other = (m.machine for m in self.maps.values())
        if one.joints != other.joints:
            said += ["no overlay.png is drawn, and what only one of them has stands without ratio"]
        first, second = self.maps
        if not self.lift_charts:
            said += [f"no lift charts are compared: {first} has none"]
        elif second not in self.lift_charts:
            said += [f"{second} reaches no place of the lift chart of {first}"]
        return [f"{'; '.join(said)}."] if said else []

    @cached_property
    def differences(self) -> dict[str, tuple[Any, Any]]:
        """Values that differ, by key path, in the files' units; None where a file has none."""
        one, other = (machine_file.flat(m.machine.section) for m in self.maps.values())
        return machine_file.differing(one, other)

    @property
    def frame(self) -> pd.DataFrame:
        """One row for each compared quantity: name, SI unit, both values, relative change.

        Joint positions, whose zero means nothing, have no relative change.

        Values of the files follow as they are written there, in the unit that their key names:
        their unit is "file".
        """
        import pandas as pd

        rows: list[tuple[Any, ...]] = []
        one, other = (quantities(m) for m in self.maps.values())
        for name in [*one, *(name for name in other if name not in one)]:
            unit = (one.get(name) or other[name])[1]
            rows.append((name, unit, *(values.get(name, (None,))[0] for values in (one, other))))
        rows += [(path, "file", *map(_words, pair)) for path, pair in self.differences.items()]
        frame = pd.DataFrame(rows, columns=["quantity", "unit", *self.maps], dtype=object)
        frame["change"] = [None if is_position(n) else _change(a, b) for n, _, a, b in rows]
        return frame.map(lambda x: float(f"{x:.9g}") if isinstance(x, float) else x)

    def items(self, units: Units = WORKSHOP) -> list[Sheet | str]:
        """The comparison as tables, after what it leaves out."""
        return [*self.sentences, *self.sheets(units)]

    def sheets(self, units: Units = WORKSHOP) -> list[Sheet]:
        """The comparison as tables."""
        pairs = {label: (m.machine, m.workspace) for label, m in self.maps.items()}
        digging = {
            name for machine, _ in pairs.values() for name in Requirements.of(machine).digging
        }
        return [
            self._worst(units),
            spread_sheet(self.maps),
            self._limiting(),
            self.differing(),
            loads_sheet(pairs, digging, units),
            performance_sheet({label: m.machine for label, m in self.maps.items()}, units),
            lift_sheet(self.lift_charts, units),
        ]

    @cached_property
    def lift_charts(self) -> dict[str, LiftChart]:
        """Lift charts of both on the grid of the first, without a machine that has none."""
        return lift_charts({label: m.machine for label, m in self.maps.items()})

    def _worst(self, units: Units) -> Sheet:
        rows: list[tuple[str, ...]] = []
        one, other = (m.worst_of for m in self.maps.values())
        for payload in [*one, *(name for name in other if name not in one)]:
            cases = [
                (label, m, m.worst_of[payload])
                for label, m in self.maps.items()
                if payload in m.worst_of
            ]
            for label, m, worst in cases:
                where = pose_text(m.machine, worst.q, units)
                case = payload if label == cases[0][0] else ""
                rows.append((case, label, f"{worst.frequency:.3f}", worst.cylinder, where))
            if len(cases) == 2 and cases[0][2].frequency > 0:
                change = percent(cases[1][2].frequency / cases[0][2].frequency - 1)
                rows.append(("", "change", change, "", ""))
        kind = "each in its own workspace"
        if self.same_workspace:
            kind = "both in the workspace of the first machine"
        return Sheet(
            title="Worst natural frequency [Hz]",
            columns=("payload", "machine", "frequency", "cylinder", "where"),
            rows=tuple(rows),
            note="; ".join(filter(None, [kind, between_poses(self.maps)])),
            bold=tuple(k for k, row in enumerate(rows) if row[1] == "change"),
        )

    def _limiting(self) -> Sheet:
        shares = [m.limiting_shares for m in self.maps.values()]
        rows = []
        for name in dict.fromkeys(name for share in shares for name in share.index):
            known = (100 * share[name] if name in share.index else None for share in shares)
            rows.append((name, *("–" if share is None else f"{share:.1f} %" for share in known)))
        title, heads = "Share of poses that each cylinder limits", ("cylinder", *self.maps)
        return Sheet(title=title, columns=heads, rows=tuple(rows))

    def differing(self) -> Sheet:
        """Keys of the files whose values differ."""
        rows = [(path, *map(_words, values)) for path, values in self.differences.items()]
        hidden = len(rows) - SHOWN
        urdfs = {m.machine.urdf_text for m in self.maps.values()}
        linked = any(m.machine.section.links for m in self.maps.values())
        notes = ["values as in the files, each in the unit that its key names"] if rows else []
        notes += [f"{hidden} more in compare.csv"] if hidden > 0 else []
        notes += ["the URDFs differ too"] if len(urdfs) > 1 and not linked else []
        return Sheet(
            title="Differences of the files" if rows else "The files do not differ",
            columns=("key", *self.maps) if rows else (),
            rows=tuple(rows[:SHOWN]),
            note="; ".join(notes),
        )

    def plot(self, plane: str = "joints") -> Figure:
        """Both heatmaps on one colour scale; returns the figure."""
        from armdesign import plots

        return plots.side_by_side(self.maps, plane)


def compare(
    first: Machine, second: Machine, points: int | Sequence[int] | None = None
) -> Comparison:
    """Map two machines.

    The second is mapped in the workspace of the first if it has the same arm and can take all of
    its poses; else each is mapped in its own.
    """
    workspace, labels = Workspace.grid(first, points), _labels(first, second)
    apart = _apart(first, second, workspace, labels)
    own = Workspace.grid(second, points) if apart else workspace
    maps = (frequency_map(first, workspace), frequency_map(second, own))
    return Comparison(dict(zip(labels, maps, strict=True)), apart)


def _apart(one: Machine, other: Machine, workspace: Workspace, labels: tuple[str, str]) -> str:
    """Why a machine cannot be mapped in the workspace of another; empty if it can."""
    if one.joints != other.joints:
        both = zip(labels, (one, other), strict=True)
        joints = "; ".join(f"{label}: {', '.join(machine.joints)}" for label, machine in both)
        return f"The joints differ ({joints})"
    if (one.urdf_text, coordinates(one.section)) != (other.urdf_text, coordinates(other.section)):
        return "The links differ"
    if other.margins(workspace.q).min() < -MARGIN_TOLERANCE:
        return f"The cylinders of {labels[1]} do not reach all poses of {labels[0]}"
    return ""


def _labels(first: Machine, second: Machine) -> tuple[str, str]:
    """Labels that tell two machines apart: name, file or folder."""
    candidates = ((m.name, m.source.stem, m.source.resolve().parent.name) for m in (first, second))
    for one, other in zip(*candidates, strict=True):
        if one != other:
            return one, other
    return f"{first.name} A", f"{first.name} B"


def is_position(name: str) -> bool:
    """Whether a quantity is the position of a joint at a worst pose."""
    return f"{WORST_POSE}." in name


def quantities(frequencies: FrequencyMap) -> dict[str, tuple[Any, str]]:
    """Value and SI unit of everything that the comparison writes, by name."""
    machine = frequencies.machine
    values: dict[str, tuple[Any, str]] = {}
    spread = frequencies.percentiles((5, 50, 95))
    for payload, worst in frequencies.worst_of.items():
        values[f"{payload}.worst"] = (worst.frequency, "Hz")
        values[f"{payload}{WORST_POSE}.cylinder"] = (worst.cylinder, "")
        for joint, position in zip(machine.arm.joints, worst.q, strict=True):
            values[f"{payload}{WORST_POSE}.{joint.name}"] = (float(position), joint.unit)
        for rank, value in zip((5, 50, 95), spread.loc[payload], strict=True):
            values[f"{payload}.percentile_{rank}"] = (float(value), "Hz")
    for name, share in frequencies.limiting_shares.items():
        values[f"limiting.{name}"] = (float(share), "")
    for c in machine.cylinders:
        values[f"{c.name}.oil_cap"] = (c.bore_area * c.stroke, "m³")
        values[f"{c.name}.oil_annulus"] = (c.annulus_area * c.stroke, "m³")
        values[f"{c.name}.thrust"] = (c.available_pressure(machine.supply) * c.bore_area, "N")
    for figure in figures(machine):
        for key, value in zip(figure.keys, figure.values or (None,), strict=False):
            values[f"{figure.part}.{key}"] = (value, figure.unit)
    return values


def _words(value: Any) -> str:
    """A value of a file as it is written there, short."""
    if value is None:
        return "–"
    if isinstance(value, list):
        return ", ".join(map(_words, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


def _change(one: Any, other: Any) -> float | None:
    try:
        a, b = float(one), float(other)
    except (TypeError, ValueError):
        return None
    return b / a - 1 if a else None
