"""Measured frequencies and pressures at known poses and load cases, read from a CSV file.

One row for each measurement, columns by name, in any order; lines that begin with ``#`` are
comments.

``<joint>_deg``, of a slide ``<joint>_mm``
    Position of a joint; or instead
``<actuator>_length_mm``
    the pin-to-pin length of a cylinder that alone moves that joint.
``payload``
    Name of a load case, or a mass in kg; blank: the machine's load case at work.
``frequency_hz``, ``deviation_hz``
    Natural frequency and its standard deviation, systematic errors included; 1 % if not given. The
    frequency may be blank where pressures are fitted.
``mode``
    Which of the coupled modes it is; 1, the lowest, if not given.
``<actuator>_cap_bar``, ``<actuator>_annulus_bar``
    Chamber pressures, at which oil with air has its modulus; if not given, those that hold the
    pose.
``pressure_deviation_bar``
    Standard deviation of the pressures; where it is given, the load that they carry is fitted too.
``<actuator>_chambers``
    What holds the piston: ``both`` chambers (if not given), ``cap`` or ``annulus`` where the other
    is open, ``stuck`` where friction holds it and only what lies in series with the oil yields.

``begin_s``, ``end_s``, ``signal``, ``amplitude``, ``damping_ratio``, ``damping_deviation``,
``remark`` and ``label`` are known, but not used.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from armdesign.arrays import Array, ReadOnly
from armdesign.csv_rows import read_rows
from armdesign.errors import ArmDesignError, choose
from armdesign.hydraulics.actuator import SIDES
from armdesign.machine.machine import Machine
from armdesign.machine.measured_poses import INCLINOMETER, inclined, joint_columns
from armdesign.units import bar, mm

DEVIATION = 0.01  # of a frequency, where none is given
SURE = 4.0  # deviations by which two frequencies of one mode do not differ
CHAMBERS = ("both", "cap", "annulus", "stuck")
UNUSED = (
    "begin_s",
    "end_s",
    "damping_ratio",
    "damping_deviation",
    "label",
    "signal",
    "amplitude",
    "remark",
)
KNOWN = ("payload", "frequency_hz", "deviation_hz", "mode", "pressure_deviation_bar")
SMALLEST, LARGEST = 1e-100, 1e6  # numbers that are measured, in their units
ENDS = ("length_mm", "cap_bar", "annulus_bar", "chambers")  # of an actuator's columns

Rows = Sequence[Mapping[str, Any]]


@dataclass(frozen=True, eq=False, kw_only=True)
class Measured(ReadOnly):
    """n measurements of a machine with nq joints and nc actuators; arrays are read-only.

    Attributes:
        source: file or other origin, for messages.
        payloads: load case of each (n), by name or mass [kg]; None: the one at work.
        joints: positions of the joints (n, nq) [rad, m], NaN where lengths tell them.
        lengths: pin-to-pin lengths (n, nc) [m], NaN where joints tell them.
        frequencies: natural frequencies (n,) [Hz], NaN where none is measured.
        deviations: their standard deviations (n,) [Hz].
        modes: which coupled mode each is (n,), 0 the lowest.
        pressures: of cap and annulus (n, nc, 2) [Pa], NaN where not measured.
        pressure_deviations: their standard deviations (n,) [Pa], NaN where they are not fitted.
        chambers: what holds each piston (n, nc), words of ``CHAMBERS``.
        warnings: what a reader of the answer should know of the measurements.
    """

    source: str
    payloads: tuple[str | float | None, ...]
    joints: Array
    lengths: Array
    frequencies: Array
    deviations: Array
    modes: Array
    pressures: Array
    pressure_deviations: Array
    chambers: Array
    warnings: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.payloads)


def read_measured(path: str | Path, machine: Machine) -> Measured:
    """Measurements of a CSV file, see the module for its columns.

    Raises:
        ArmDesignError: a file that cannot be read, a missing column, or a value that cannot be.
    """
    names, rows = read_rows(path)
    table = [dict(zip(names, fields, strict=True)) for _, fields in rows]
    return measured_of(table, machine, str(path))


def measured_of(rows: Rows, machine: Machine, source: str = "measured") -> Measured:
    """Measurements from rows: mappings from column names to texts or numbers.

    Raises:
        ArmDesignError: a missing column, or a value that cannot be.
    """
    if not rows:
        raise ArmDesignError(source, "holds no measurement", "give a row for each")
    return _MeasuredRows(rows, machine, source).measured()


@dataclass(frozen=True, eq=False)
class _MeasuredRows:
    """Rows on their way to measurements of a machine."""

    rows: Rows
    machine: Machine
    source: str

    def measured(self) -> Measured:
        """All columns that the machine knows."""
        actuators = [actuator.name for actuator in self.machine.actuators]
        sides = [[self._numbers(f"{a}_{side}_bar") for side in SIDES] for a in actuators]
        pressures: Array = np.moveaxis(np.array(sides), -1, 0)  # (n, nc, 2)
        frequencies = self._numbers("frequency_hz", positive=True)
        deviations = self._numbers("deviation_hz", positive=True)
        loads = self._numbers("pressure_deviation_bar", positive=True)
        counted = np.where(np.isnan(deviations), DEVIATION * frequencies, deviations)
        joints, lengths = self._poses()
        self._refuse_empty(frequencies, pressures, loads)
        pressures[np.isnan(pressures).any(axis=2)] = np.nan
        return Measured(
            source=self.source,
            payloads=tuple(self._payload(row, n) for n, row in enumerate(self.rows, 1)),
            joints=joints,
            lengths=lengths,
            frequencies=frequencies,
            deviations=counted,
            modes=self._modes(),
            pressures=pressures * bar,
            pressure_deviations=loads * bar,
            chambers=np.array([self._chambers(row, n) for n, row in enumerate(self.rows, 1)]),
            warnings=(
                *self._warnings(actuators, deviations),
                *self._contradictions(frequencies, counted),
            ),
        )

    @property
    def columns(self) -> dict[str, None]:
        """Names of all columns, in their order."""
        return {name: None for row in self.rows for name in row}

    def _poses(self) -> tuple[Array, Array]:
        """Joint positions (n, nq) and lengths (n, nc), NaN where there is no column."""
        machine = self.machine
        joints = np.full((len(self.rows), len(machine.joints)), np.nan)
        lengths = np.full((len(self.rows), len(machine.actuators)), np.nan)
        for column in joint_columns(machine):
            given = [name for name in column.all if name in self.columns]
            if len(given) != 1:
                fault = " and ".join(given) or "no column"
                fault += f" {'say' if given else 'says'} where joint {column.name} stands"
                remedy = f"give one column: {' or '.join(column.all)}"
                raise ArmDesignError(self.source, fault, remedy)
            values = self._numbers(given[0], blank=False)
            if given[0] == column.own:
                joints[:, column.joint] = values * column.factor
            else:
                lengths[:, column.lengths[given[0]]] = values * mm
        return joints, lengths

    def _numbers(self, column: str, positive: bool = False, blank: bool = True) -> Array:
        """A column (n,), NaN where it is blank or missing."""
        return np.array(
            [self._number(row, n, column, positive, blank) for n, row in enumerate(self.rows, 1)]
        )

    def _number(
        self, row: Mapping[str, Any], n: int, column: str, positive: bool, blank: bool
    ) -> float:
        value, part = row.get(column), f"{self.source}: row {n}, {column}"
        if blank and (value is None or str(value).strip().lower() in ("", "nan")):
            return math.nan
        try:
            number = float(value)  # type: ignore[arg-type]
        except (TypeError, ValueError, OverflowError):
            number = math.nan
        least = SMALLEST if positive else -LARGEST
        if not least <= number <= LARGEST:
            remedy = f"give a number in [{least:g}, {LARGEST:g}]"
            raise ArmDesignError(part, f"{value!r:.40} is not allowed", remedy)
        return number

    def _modes(self) -> Array:
        modes, most = self._numbers("mode"), len(self.machine.arm.coordinates)
        modes = np.where(np.isnan(modes), 1.0, modes)
        for n, mode in enumerate(modes, 1):
            if mode not in range(1, most + 1):
                part = f"{self.source}: row {n}, mode"
                raise ArmDesignError(part, f"{mode:g} is not there", f"give 1 to {most}")
        return modes.astype(int) - 1

    def _payload(self, row: Mapping[str, Any], n: int) -> str | float | None:
        word = str(row.get("payload") or "").strip()
        if not word or word in {case.name for case in self.machine.payloads}:
            return word or None
        try:
            payload: str | float = float(word)
        except ValueError:
            payload = word
        try:
            self.machine.with_payload(payload)
        except ArmDesignError as error:
            part = f"{self.source}: row {n}, {error.part}"
            raise ArmDesignError(part, error.fault, error.remedy) from None
        return payload

    def _chambers(self, row: Mapping[str, Any], n: int) -> list[str]:
        words = []
        for actuator in self.machine.actuators:
            column = f"{actuator.name}_chambers"
            words.append(str(row.get(column) or "both").strip())
            if words[-1] not in CHAMBERS:
                part = f"{self.source}: row {n}, {column}"
                remedy = f"give one of {', '.join(CHAMBERS)}"
                raise ArmDesignError(part, f'"{words[-1]}" is not known', remedy)
        return words

    def _refuse_empty(self, frequencies: Array, pressures: Array, deviations: Array) -> None:
        """Raise for a row without a measurement, or of a load with one pressure of two."""
        for n, (frequency, both, deviation) in enumerate(
            zip(frequencies, pressures, deviations, strict=True), 1
        ):
            part, known = f"{self.source}: row {n}", np.isfinite(both)
            for actuator, (cap, annulus) in zip(self.machine.actuators, known, strict=True):
                if cap != annulus and not math.isnan(deviation):
                    has, lacks = SIDES if cap else SIDES[::-1]
                    fault = f"{actuator.name}_{has}_bar without {actuator.name}_{lacks}_bar"
                    raise ArmDesignError(part, fault, "give both pressures, or neither")
            if math.isnan(frequency) and (math.isnan(deviation) or not known.any()):
                remedy = "give frequency_hz, or pressures with pressure_deviation_bar"
                raise ArmDesignError(part, "holds no measurement", remedy)

    def _alone(self, actuator: str) -> bool:
        """Whether any row holds the pressure of one of its chambers alone."""
        cap, annulus = (np.isfinite(self._numbers(f"{actuator}_{side}_bar")) for side in SIDES)
        return bool((cap != annulus).any())

    def _warnings(self, actuators: list[str], deviations: Array) -> list[str]:
        """Notes on the measurements: columns that are not used, inclinometers, deviations."""
        joints = [name for column in joint_columns(self.machine) for name in column.all]
        springs = [f"{one.joint}_{unit}" for one in self.machine.springs for unit in ("deg", "mm")]
        known = [
            *springs,
            *joints,
            *KNOWN,
            *(f"{a}_{end}" for a in actuators for end in ENDS),
            *UNUSED,
        ]
        known = list(dict.fromkeys(known))
        words = [
            f'column "{name}" is not used: '
            + (INCLINOMETER if inclined(name) else choose(name, known))
            for name in self.columns
            if name not in known
        ]
        words += [
            f"{a}: one chamber's pressure without the other's is not used"
            for a in actuators
            if self._alone(a)
        ]
        if np.isnan(deviations[np.isfinite(self._numbers("frequency_hz"))]).any():
            words.append(f"frequencies without deviation_hz count as known to {DEVIATION:.0%}")
        return words

    def _contradictions(self, frequencies: Array, deviations: Array) -> Iterator[str]:
        """Rows that differ in their frequency alone, and by more than its deviations allow."""
        own = ("frequency_hz", "deviation_hz", *UNUSED)
        told = [name for name in self.columns if name not in own]
        groups: dict[tuple[str, ...], list[int]] = {}
        for n in map(int, np.flatnonzero(np.isfinite(frequencies))):
            groups.setdefault(tuple(str(self.rows[n].get(name)) for name in told), []).append(n)
        for group in groups.values():
            low, high = (group[int(end(frequencies[group]))] for end in (np.argmin, np.argmax))
            difference = frequencies[high] - frequencies[low]
            if difference > SURE * math.hypot(deviations[low], deviations[high]):
                yield (
                    f"rows {low + 1} and {high + 1} are of one pose, load case and mode, but of"
                    f" {frequencies[low]:.4g} and {frequencies[high]:.4g} Hz: tell their modes, or"
                    " larger deviations"
                )
