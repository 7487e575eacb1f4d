"""The paper's errata (docs/errata.md), what each does to the frequency, and ``scan``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array, Numbers
from armdesign.machine.loading import load
from armdesign.paper import formulas
from armdesign.paper.configurations import FORMULAS, LENGTHS, MACHINE, MASSES, Mechanism, rms_error
from armdesign.units import GRAVITY, MPa, litre, mm

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False)
class Erratum:
    """A misprint or slip of the paper and what it does to a frequency, all else being right."""

    equation: str  # its number
    printed: str  # what the paper has
    right: str  # what it should be
    wrong_frequency: Numbers = None  # with it (n,) [Hz]; None: it is in no frequency
    right_frequency: Numbers = None  # without it (n,) [Hz]
    remark: str = ""  # what to know about the comparison

    @property
    def change(self) -> Array | None:
        """Relative change of the frequency (n,)."""
        if self.wrong_frequency is None:
            return None
        return np.asarray(self.wrong_frequency / self.right_frequency - 1)

    @property
    def error(self) -> float:
        """Root mean square of the difference [rad/s]; 0 where it is in no frequency."""
        if self.wrong_frequency is None:
            return 0.0
        return float(rms_error(self.wrong_frequency, self.right_frequency))


def errata(at: Mechanism) -> list[Erratum]:
    """The paper's errata over the configurations of a mechanism, each by itself."""
    frequencies = at.frequencies
    exact = frequencies["joint_exact"]
    static = (frequencies["static_12_as_printed"], frequencies["static_12"])
    off_centre = replace(
        at,
        cap_volume=at.cap_volume - at.bore_area * at.stroke / 4,
        annulus_volume=at.annulus_volume + at.annulus_area * at.stroke / 4,
    ).frequencies["joint_exact"]
    volumes = ("V1 = V2 = V0", "V1, V2 by position", exact, off_centre)
    bore_alone = formulas.joint_coupled(**at.loaded, **at.symmetric)
    inverse = 1 / (2 * math.pi) / (2 * math.pi * exact)
    return [
        Erratum("(12)", "2β/M", "β/M", *static, "static mass"),
        Erratum("(13)", "missing", "the cosine formula"),
        *_errata_of_gravity(at, exact),
        Erratum("(34) volumes", *volumes, "piston at a quarter of its stroke"),
        Erratum("(34) areas", "one A", "A1, A2", bore_alone, exact, "A = A1; the paper is silent"),
        Erratum("(40)", "2 in μ", "1 in μ", remark="the gain doubles"),
        Erratum("(42) root", "√(K/Q)", "√(Q/K)", inverse, exact, "the inverse of a frequency"),
    ]


def _errata_of_gravity(at: Mechanism, exact: Numbers) -> list[Erratum]:
    """Errata of inertia, static force and gravity stiffness, beside the exact frequency [Hz]."""
    weight, l2, (a1, d1) = at.load_mass * GRAVITY, at.link_length, at.pins.values()
    pull = weight * a1 * l2 * d1 / (a1**2 + d1**2)  # F0 ∂r/∂θ
    without_pull, printed = at.with_gravity(weight * a1), at.with_gravity(weight * l2)
    literal = at.with_gravity(weight * a1 + pull, inertia=l2)
    flipped = at.with_gravity(weight * a1 - pull)
    inertias = ("lengths l1, l2", "inertias I1, I2", literal, exact)
    right = "−m2 g a1 (1 + l2 d1/x²)"
    return [
        Erratum("(16)", *inertias, "I2 = l2 in number, though (42) has neither"),
        Erratum("(27)", "+m2 g l2", "−m2 g l2", flipped, exact, "through F0 ∂r/∂θ, not in (42)"),
        Erratum("(33) ∂g/∂θ", "−m2 g l2", "−m2 g a1", printed, without_pull, "without F0 ∂r/∂θ"),
        Erratum("(33) −F0 ∂r/∂θ", "missing", "−m2 g a1 l2 d1/x²", without_pull, exact),
        Erratum("(38), (39), (42)", "−m2 g l2", right, printed, exact, "both errata of (33)"),
    ]


def errata_frame(errata: Sequence[Erratum]) -> pd.DataFrame:
    """A row per erratum: least and largest relative change, rms [rad/s]; or empty."""
    import pandas as pd

    rows = []
    for item in errata:
        effect: tuple[Numbers, ...] = (None, None, None)
        if (change := item.change) is not None:
            effect = change.min(), change.max(), item.error
        rows.append((item.equation, item.printed, item.right, *effect, item.remark))
    effects = ["least", "largest", "rms_rad_per_s"]
    frame = pd.DataFrame(rows, columns=["equation", "printed", "right", *effects, "remark"])
    return frame.astype(dict.fromkeys(effects, float))


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
    combinations = product(BORES_AND_RODS, STROKES, DEAD_VOLUMES, BULK_MODULI, LOADS, REACHES)
    names = ["bore_mm", "rod_mm", "stroke_mm", "dead_volume_l", "bulk_modulus_MPa"]
    names += ["mass_from_kg", "mass_to_kg", "length_from_m", "length_to_m"]
    rows = [(*sizes, S, V, beta, *mass, *reach) for sizes, S, V, beta, mass, reach in combinations]
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
    bore, ring = (math.pi / 4 * (column(name) * mm) ** 2 for name in ("bore_mm", "rod_mm"))
    first, last = (column(f"mass_{end}_kg")[:, 0] for end in ("from", "to"))
    masses = np.linspace(first, last, len(MASSES), axis=1)
    first, last = (column(f"length_{end}_m")[:, 0] for end in ("from", "to"))
    lengths = np.linspace(first, last, len(LENGTHS), axis=2)
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
