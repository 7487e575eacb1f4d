"""Sweeps in a journal: what is kept of those at one pose, and the sweeps of that."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from armdesign.errors import SimulationError
from armdesign.journal.finished import Form
from armdesign.simulation.identification.modal_fit import ModalFit
from armdesign.simulation.sweeps import Failure, FittedMode

ERROR = ("part", "fault", "remedy", "line", "key")
COMPLEX = "real and imaginary parts"


def form() -> Form[list[FittedMode | Failure]]:
    """Form in which the sweeps at a pose are kept, every bit of them.

    But for those of which one failed as it may not fail again.
    """

    def write(_: int, sweeps: list[FittedMode | Failure]) -> dict[str, Any] | None:
        passing = any(_failed_for_now(one) for one in sweeps)
        return None if passing else {"sweeps": [_kept(one) for one in sweeps]}

    return Form(write=write, read=lambda _, answer: [_sweep(one) for one in answer["sweeps"]])


def _failed_for_now(sweep: FittedMode | Failure | None) -> bool:
    """Whether a sweep failed, with dry friction or without, for what the surroundings lack."""
    if isinstance(sweep, FittedMode):
        return _failed_for_now(sweep.with_friction)
    return sweep is not None and sweep.error.passing


def _kept(value: Any) -> Any:
    """A sweep, or a part of one, as JSON has it."""
    if isinstance(value, np.ndarray):
        if np.iscomplexobj(value):
            return {COMPLEX: np.stack([value.real, value.imag], axis=-1).tolist()}
        return value.tolist()
    if isinstance(value, SimulationError):
        return {name: getattr(value, name) for name in ERROR}
    if isinstance(value, FittedMode | Failure | ModalFit):
        return {one.name: _kept(getattr(value, one.name)) for one in fields(value)}
    return value


def _sweep(kept: Mapping[str, Any]) -> FittedMode | Failure:
    """A sweep that was kept."""
    values = _values(kept)
    if "error" in kept:
        return Failure(**{**values, "error": SimulationError(**kept["error"])})
    rough = kept["with_friction"]
    values["with_friction"] = None if rough is None else _sweep(rough)
    return FittedMode(**{**values, "fit": ModalFit(**_values(kept["fit"]))})


def _values(kept: Mapping[str, Any]) -> dict[str, Any]:
    """Numbers and words by name, lists as arrays."""
    return {name: _array(value) for name, value in kept.items()}


def _array(value: Any) -> Any:
    if isinstance(value, Mapping) and COMPLEX in value:
        return np.array(value[COMPLEX], dtype=float).view(complex)[..., 0]
    return np.array(value, dtype=float) if isinstance(value, list) else value
