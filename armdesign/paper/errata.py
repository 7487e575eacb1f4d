"""The paper's errata, THEORY section 5, and what each does to the frequency."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arrays import Array
from armdesign.paper import formulas
from armdesign.paper.configurations import Mechanism, rms_error
from armdesign.units import GRAVITY

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False)
class Erratum:
    """A misprint or slip of the paper and what it does to a frequency, all else being right.

    Attributes:
        equation: its number.
        printed: what the paper has.
        right: what it should be.
        wrong_frequency: with it (n,) [Hz]; None: it is in no frequency.
        right_frequency: without it (n,) [Hz].
        remark: what to know about the comparison.
    """

    equation: str
    printed: str
    right: str
    wrong_frequency: Any = None
    right_frequency: Any = None
    remark: str = ""

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


def _errata_of_gravity(at: Mechanism, exact: Any) -> list[Erratum]:
    """Errata of inertia, static force and gravity stiffness, beside the exact frequency [Hz]."""
    weight, a1, d1, l2 = (
        at.load_mass * GRAVITY,
        at.link_pin_distance,
        at.base_pin_distance,
        at.link_length,
    )
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
    """One row per erratum: least and largest relative change, root mean square [rad/s].

    Cells are empty where an erratum is in no frequency.
    """
    import pandas as pd

    rows = []
    for item in errata:
        change = item.change
        row: dict[str, Any] = {
            "equation": item.equation,
            "printed": item.printed,
            "right": item.right,
        }
        if change is not None:
            row |= {"least": change.min(), "largest": change.max(), "rms_rad_per_s": item.error}
        rows.append(row | {"remark": item.remark})
    return pd.DataFrame(
        rows,
        columns=["equation", "printed", "right", "least", "largest", "rms_rad_per_s", "remark"],
    )
