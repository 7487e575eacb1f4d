"""Which cylinders and grids would give the one error that the paper prints: ``scan``."""

from __future__ import annotations

import math
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array
from armdesign.machine.loading import load
from armdesign.paper.configurations import FORMULAS, LENGTHS, MACHINE, MASSES, Mechanism, rms_error
from armdesign.units import GRAVITY, MPa, litre, mm

if TYPE_CHECKING:
    import pandas as pd

# What ``scan`` combines: sizes of ISO 3320, pins in the proportions of the machine, supply
# pressure as there.
BORES_AND_RODS = ((40, 22), (50, 28), (63, 36), (80, 45), (100, 56), (125, 70))  # [mm]
STROKES = (200, 400, 600, 800)  # [mm]
DEAD_VOLUMES = (0.1, 0.3, 1.0)  # of each chamber [l]
BULK_MODULI = (800, 1200)  # [MPa]
# first and last [kg]
LOADS = (25, 200), (50, 400), (100, 450), (100, 800), (200, 1600), (250, 600), (500, 1200)
REACHES = ((0.5, 1.5), (0.25, 0.75), (0.5, 1.0), (1.0, 2.0), (1.0, 3.0))  # first and last [m]
HELD = 0.87  # largest share of supply pressure × area for a load that counts as held


def scan() -> pd.DataFrame:
    """Errors [rad/s] of every formula for dimensions that the paper might have had.

    Pins keep the proportions of ``paper_1dof`` to the stroke; the piston stands at mid-stroke. One
    row per combination of the constants above: sizes, first and last mass and length, ``held``
    (largest static force over supply pressure × annulus area: the load pulls), lowest and highest
    exact frequency, an error per formula. Rows that no supply holds (``held`` > ``HELD``) are left
    out.
    """
    import pandas as pd

    machine = load(MACHINE)
    choices = product(BORES_AND_RODS, STROKES, DEAD_VOLUMES, BULK_MODULI, LOADS, REACHES)
    names = ["bore_mm", "rod_mm", "stroke_mm", "dead_volume_l", "bulk_modulus_MPa"]
    names += ["mass_from_kg", "mass_to_kg", "length_from_m", "length_to_m"]
    rows = [(*sizes, S, V, beta, *mass, *reach) for sizes, S, V, beta, mass, reach in choices]
    table = pd.DataFrame(rows, columns=names, dtype=float)
    at = _candidates(table, Mechanism.of(machine, 1.0, 1.0))
    frequencies = at.frequencies
    force = at.static_mass * GRAVITY / (machine.supply.pressure * at.annulus_area)
    table["held"] = force.max(axis=(1, 2))
    exact = frequencies["joint_exact"]
    table["lowest_hz"], table["highest_hz"] = exact.min(axis=(1, 2)), exact.max(axis=(1, 2))
    for name in FORMULAS:
        table[name] = rms_error(frequencies[name], exact, axis=(1, 2))
    return table[table["held"] <= HELD].reset_index(drop=True)


def _candidates(table: pd.DataFrame, shipped: Mechanism) -> Mechanism:
    """Rows of the scan as one mechanism of arrays (rows, masses, lengths)."""

    def column(name: str) -> Array:
        return np.asarray(table[name])[:, None, None]

    stroke, dead = column("stroke_mm") * mm, column("dead_volume_l") * litre
    bore, ring = (
        math.pi / 4 * (column("bore_mm") * mm) ** 2,
        math.pi / 4 * (column("rod_mm") * mm) ** 2,
    )
    masses = np.linspace(
        column("mass_from_kg")[:, 0], column("mass_to_kg")[:, 0], len(MASSES), axis=1
    )
    lengths = np.linspace(
        column("length_from_m")[:, 0], column("length_to_m")[:, 0], len(LENGTHS), axis=2
    )
    scale = stroke / shipped.stroke
    return Mechanism(
        load_mass=masses,
        link_length=lengths,
        link_pin_distance=shipped.link_pin_distance * scale,
        base_pin_distance=shipped.base_pin_distance * scale,
        bore_area=bore,
        annulus_area=bore - ring,
        cap_volume=bore * stroke / 2 + dead,
        annulus_volume=(bore - ring) * stroke / 2 + dead,
        stroke=stroke,
        bulk_modulus=column("bulk_modulus_MPa") * MPa,
    )
