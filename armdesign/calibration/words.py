"""Findings of a calibration in words: what fits, is not determined, looks alike."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array
from armdesign.calibration.fit import LOOSE, Fit
from armdesign.calibration.unknowns import Unknown
from armdesign.machine.file.likely_values import USUAL
from armdesign.units import percent, share_text

if TYPE_CHECKING:
    import pandas as pd

ALIKE = 0.98  # cosine of two unknowns' effects on all measurements, from which they look alike
CHANGE = 0.10  # of the unknown that changes most in a weak direction
PART = 0.1  # of the largest part of a direction below which an unknown is not named
SOFTEST = 5.0  # times the oil's own compliance; measured machines have 0.4 to 1.5
COMPLIANCES = ("compliance_m_per_N", "compliance_rad_per_N_m")
MOST_AIR = 20.0  # [%]
POOR = 3.0  # times the measurements' deviations by which a machine may miss


def findings(
    of_all: Fit,
    fit: Fit | None,
    loose: Mapping[str, float],
    frame: pd.DataFrame,
    warnings: tuple[str, ...],
) -> tuple[str, ...]:
    """Sentences without their full stops.

    Args:
        of_all: the fit of all unknowns.
        fit: the fit of the unknowns which are determined; None if none is.
        loose: relative deviations of the others by key path.
        frame: measurements and answers, see ``Calibration``.
        warnings: of the measurements.
    """
    sentences = [_errors(frame)] if frame["measured_hz"].notna().any() else []
    if (best := fit or of_all).scale > POOR:
        values = "no values" if fit is None else "the fitted values do not"
        sentences.append(
            f"{values} explain the measurements: these are missed by {best.scale:.1f} times their"
            " deviations"
        )
    for one in of_all.problem.unknowns:
        if one.path in loose:
            how = "no measurement depends on it where it fits best"
            if math.isfinite(loose[one.path]):
                how = f"known to {_width(one, loose[one.path])} at best"
            held = f"held at {one.value:g} {one.unit}".rstrip()
            if fit is not None:
                held += ", and the intervals of the others allow for all that it may be"
            sentences.append(f"{one.path} is not determined by these measurements ({how}): {held}")
    return (*sentences, *_implausible(fit), *_apart(of_all), *warnings)


def _width(one: Unknown, deviation: float) -> str:
    """How near an unknown with a relative deviation is known, in words."""
    if one.positive:
        return f"a factor of {math.exp(min(deviation, 9.0)):.2g}"
    return f"± {deviation * one.size:.2g} {one.unit}".rstrip()


def _implausible(fit: Fit | None) -> Iterator[str]:
    """Which fitted values no oil or structure has."""
    if fit is None:
        return
    machine = fit.problem.machine
    softest = {
        f"{a.kind}.{a.name}.{key}": SOFTEST * a.oil_compliance(machine.fluid, machine.supply)
        for a in machine.actuators
        for key in COMPLIANCES
    }
    for one, u in zip(fit.problem.unknowns, fit.u, strict=True):
        value, keys = one.number(float(u)), tuple(one.path.split("."))
        low, high = USUAL.get(keys[-1], (0.0, math.inf))
        if one.path == "fluid.entrained_air_percent":
            high = MOST_AIR
        high = softest.get(one.path, high)
        if not low <= value <= high:
            ends = f"{low:.3g} to {high:.3g} {one.unit}".rstrip()
            yield (
                f"{one.path} {value:.3g} {one.unit} is implausible: machines have {ends}, so what"
                " is fitted stands in for something else"
            )


def _errors(frame: pd.DataFrame) -> str:
    """Errors of frequencies before, after and left out."""
    spans = []
    for name in ("before", "calibrated", "left_out"):
        errors = frame[f"{name}_error"].dropna()
        if len(errors):
            spans.append(f"{percent(errors.min()).removesuffix(' %')} … {percent(errors.max())}")
    count = int(frame["measured_hz"].notna().sum())
    words = f"{count} measured frequencies: computed {spans[0]} before, {spans[1]} calibrated"
    return words + (f", {spans[2]} where each is left out of the fit" if spans[2:] else "")


def _apart(fit: Fit) -> list[str]:
    """Which unknowns these measurements tell apart, and which not."""
    names = [one.path for one in fit.problem.unknowns]
    if len(names) < 2:
        return []
    sizes = np.linalg.norm(fit.jacobian, axis=0)
    sentences = []
    for i, j in itertools.combinations(np.flatnonzero(sizes > 1e-9), 2):
        cosine = float(fit.jacobian[:, i] @ fit.jacobian[:, j] / sizes[i] / sizes[j])
        verb = "look alike" if abs(cosine) >= ALIKE else "can be told apart"
        sentences.append(
            f"{names[i]} and {names[j]} {verb} (cosine of their effects {cosine:.3f})"
        )
    for deviation, direction in zip(*fit.directions, strict=True):
        several = (np.abs(direction) >= PART * np.abs(direction).max()).sum() > 1
        if not math.isfinite(deviation) or not several:
            continue  # of an unknown alone its own deviation says it
        weak = "cannot be told apart" if deviation > LOOSE else "is known least"
        sentences.append(f"what {weak}: {_direction(fit, names, direction)}")
        break
    return sentences


def _direction(fit: Fit, names: list[str], direction: Array) -> str:
    """A direction as changes of the unknowns, and what it does to the measurements."""
    direction = direction / np.abs(direction).max()
    order = np.argsort(-np.abs(direction))
    direction = direction * np.sign(direction[order[0]])
    parts = [
        f"{names[k]} {100 * CHANGE * direction[k]:+.2g} %"
        for k in order
        if abs(direction[k]) >= PART
    ]
    known = np.isfinite(fit.problem.predictor.measured.frequencies)
    deviations = fit.problem.predictor.measured.deviations[known]
    shares = deviations / fit.problem.predictor.measured.frequencies[known]
    effect = CHANGE * np.abs(fit.jacobian[: len(shares)] @ direction) * shares
    most = f"by at most {share_text(effect.max())}" if len(shares) else "not at all"
    return f"{', '.join(parts)} together change the frequencies {most}"


def sentence(text: str) -> str:
    """Words with their full stop; a question has its mark."""
    return text if text.endswith("?") else f"{text}."


def capital(text: str) -> str:
    """A sentence that begins with a capital, unless it begins with a key path or column."""
    return text if "." in text.split(" ")[0] else text[:1].upper() + text[1:]
