"""Sheet of oil, thrust, static pressure and digging force of the cylinders of machines."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING

from armdesign.report.sheet import Sheet
from armdesign.units import WORKSHOP, Units

if TYPE_CHECKING:
    from armdesign.frequency.workspace import Workspace
    from armdesign.machine.machine import Machine


def loads_sheet(
    machines: Mapping[str, tuple[Machine, Workspace]],
    digging: Collection[str],
    units: Units = WORKSHOP,
) -> Sheet:
    """Oil, thrust, static pressures and digging force of every cylinder, on the workspaces.

    Args:
        machines: by label, the one that the others are compared with first.
        digging: cylinders whose digging force counts.
        units: of the numbers.
    """
    first = next(iter(machines))
    rows_of: dict[str, list[tuple[str, ...]]] = {}
    for label, (machine, workspace) in machines.items():
        for name, cells in _cells(machine, workspace, digging, units).items():
            new = "" if name in rows_of else name
            head = new if label == first else f"{new} → {label}".strip()
            rows_of.setdefault(name, []).append((head, *cells))
    rows = tuple(row for group in rows_of.values() for row in group)
    litres, newtons, pressure = (units.name(unit) for unit in ("m³", "N", "Pa"))
    cap, rod = (_totals(machines, side, units) for side in ("bore_area", "annulus_area"))
    return Sheet(
        title="Oil volume, thrust, static pressure, digging force",
        columns=(
            "cylinder",
            *(f"cap oil [{litres}]", f"rod oil [{litres}]", f"thrust [{newtons}]"),
            *(f"cap [{pressure}]", f"rod [{pressure}]", f"digging [{newtons}]"),
        ),
        rows=rows,
        note=(
            f"total oil: cap {cap}, rod {rod}; cap and rod [{pressure}]: largest static pressure"
            " of the loaded chamber, with the other at return pressure or at its valve's preload"
        ),
        bold=tuple(k for k, row in enumerate(rows) if "→" in row[0]),
    )


def _cells(
    machine: Machine, workspace: Workspace, digging: Collection[str], units: Units
) -> dict[str, tuple[str, ...]]:
    """Cells of one machine by the name of the cylinder."""
    from armdesign.design.requirements.check import digging_forces, static_loads

    loads, forces = static_loads(machine, workspace), digging_forces(machine)
    oil = [
        units.numbers([getattr(c, side) * c.stroke for c in machine.cylinders], "m³")
        for side in ("bore_area", "annulus_area")
    ]
    thrust = [c.available_pressure(machine.supply) * c.bore_area for c in machine.cylinders]
    digs = [forces.get(c.name, math.nan) for c in machine.cylinders]
    columns = (*oil, units.numbers(thrust, "N", 0), units.numbers(digs, "N"))
    cells = {}
    for i, (cylinder, *numbers, digging_force) in enumerate(
        zip(machine.cylinders, *columns, strict=True)
    ):
        pressures = [
            cylinder.static_pressures(force[i] * sign, machine.supply)[side]
            for force, sign, side in zip(loads, (1, -1), (0, 1), strict=True)
        ]
        shown = cylinder.name in digging and cylinder.name in forces
        cells[cylinder.name] = (
            *numbers,
            *(units.number(float(pressure), "Pa") for pressure in pressures),
            digging_force if shown else "–",
        )
    return cells


def _totals(machines: Mapping[str, tuple[Machine, Workspace]], side: str, units: Units) -> str:
    """Swept volume of one side of all cylinders, machine by machine."""
    volumes = [
        sum(getattr(cylinder, side) * cylinder.stroke for cylinder in machine.cylinders)
        for machine, _ in machines.values()
    ]
    return f"{' → '.join(units.numbers(volumes, 'm³'))} {units.name('m³')}"
