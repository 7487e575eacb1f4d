"""Figures of the page ``docs/validation.md``: each computed afresh and compared by a slow test.

``python -m tests.validation_figures`` writes them to ``docs/validation.json``.
"""

from __future__ import annotations

import importlib.util
import json
import math
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

import armdesign as ad
from armdesign.design.requirements.check import digging_forces
from armdesign.paper.configurations import grid
from armdesign.units import mm
from tests import machines

ROOT = Path(__file__).parents[1]
FILE = ROOT / "docs" / "validation.json"


def worked_example() -> str:
    """4 in bore, 2.5 in rod, 12 in stroke, middle, 180 000 psi, 1000 lb."""
    inch = 25.4 * mm
    bore, rod = (math.pi / 4 * (diameter * inch) ** 2 for diameter in (4, 2.5))
    frequency = ad.formulas.rigid_load_asymmetric(
        mass=1000 * 0.45359237,
        bulk_modulus=180e3 * 6894.757293,
        bore_area=bore,
        annulus_area=bore - rod,
        cap_volume=6 * inch * bore,
        annulus_volume=6 * inch * (bore - rod),
    )
    return f"{frequency:.2f} Hz"


def one_joint() -> str:
    """Largest relative difference of eigenvalue and closed form over the paper's 40 cases."""
    machine = ad.load("paper_1dof")
    mechanism = grid(machine)
    exact = mechanism.frequencies["joint_exact"]
    lines = []
    for mass, length in np.broadcast(mechanism.load_mass, mechanism.link_length):
        place = [1000 * float(length), 0, 1000 * float(mechanism.link_pin_distance)]
        changes = {"payload.load.mass_kg": float(mass), "payload.load.at_mm": place}
        modes = ad.natural_modes(machine.replace(changes).at([[0.0]]))
        lines.append(modes.frequencies[0, 0])
    return decade(np.abs(np.array(lines) / exact - 1).max())


def worst_of(machine: ad.Machine) -> str:
    """The worst natural frequency."""
    return f"{ad.frequency_map(machine, ad.Workspace.grid(machine)).worst.frequency:.6f} Hz"


def simulated() -> str:
    """Largest deviation of nonlinear runs at the worst pose of the rigid, undamped 20 t arm."""
    machine = machines.rigid("excavator_20t").replace({"damped": False}).with_payload("full")
    worst = ad.frequency_map(machine, ad.Workspace.grid(machine)).worst
    frame = ad.validate(machine, worst.q).frame
    return f"{100 * frame['deviation'].abs().max():.2f} %"


ERRORS = {  # columns of study 08
    "data sheet alone": "data sheet, valves shut",
    "one number fitted": "one number",
    "two numbers fitted": "two numbers",
}


@cache
def measured_errors() -> Any:
    path = ROOT / "studies" / "08_calibration.py"
    spec = importlib.util.spec_from_file_location("calibration", path)
    study: Any = importlib.util.module_from_spec(spec)  # type: ignore[arg-type]
    spec.loader.exec_module(study)  # type: ignore[union-attr]
    return study.run()[0][: study.MOVING]


def measured(column: str) -> str:
    """Errors at the measured poses, from the least to the largest."""
    errors = measured_errors()[column]
    return f"{errors.min():+.1f} … {errors.max():+.1f} %"


def decade(deviation: float) -> str:
    """A deviation that is rounding: the power of ten that it stays below."""
    return f"below 1e{math.ceil(math.log10(max(deviation, 1e-9)))}"


def digging() -> str:
    """Of bucket and stick, after ISO 6015, as `armdesign check` prints them."""
    forces = digging_forces(ad.load("excavator_20t"))
    return " / ".join(f"{forces[name] / 1000:.1f}" for name in ("bucket", "stick")) + " kN"


CRANE = "recording (`robots/loader_crane/SOURCE.md`) of a moving PATU 655, six poses"
PLANAR = "independent planar implementation"
EXAMPLE = (
    "[worked example](https://forum.deltamotion.com/t/"
    "computing-the-natural-frequency-of-the-cylinder-and-load/1042)"
)
FIGURES: list[tuple[str, str, str, Callable[[], str]]] = [  # quantity, source, published, here
    ("mass on a 4/2.5/12 in cylinder, 1000 lb", EXAMPLE, "77.03 Hz", worked_example),
    ("one joint, 8 masses × 5 lengths", "exact linearisation", "equal", one_joint),
    (
        "worst pose of the 20 t machine",
        PLANAR,
        "0.767092 Hz",
        lambda: worst_of(ad.load("excavator_20t")),
    ),
    (
        "the same with rigid structure",
        PLANAR,
        "0.910210 Hz",
        lambda: worst_of(machines.rigid("excavator_20t")),
    ),
    (
        "digging forces of the 20 t machine",
        "Cat 320 sheet (`robots/excavator_20t/SOURCE.md`)",
        "140.5 / 106.7 kN",
        digging,
    ),
    ("nonlinear simulation there, three modes", "the linear answer", "equal", simulated),
    *(
        (f"measured crane, {name}: error", CRANE, "none", partial(measured, column))
        for name, column in ERRORS.items()
    ),
]


def rows() -> list[list[str]]:
    """Quantity, source, what is published, and what this version computes."""
    return [[*words, figure()] for *words, figure in FIGURES]


if __name__ == "__main__":
    text = json.dumps(rows(), indent=2, ensure_ascii=False)
    FILE.write_text(text + "\n", encoding="utf-8")
