"""Sweeps of a validation in a journal: interrupted, it goes on where it was, bit by bit."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pandas as pd
import pytest

import armdesign as ad
from armdesign.errors import SimulationError
from armdesign.journal.finished import keeping
from armdesign.simulation import validation
from armdesign.simulation.identification.modal_fit import ModalFit
from armdesign.simulation.kept_sweeps import form
from armdesign.simulation.sweeps import Failure, FittedMode, SweptMode

POSES = [[0.0], [-0.4]]  # a run, and one that the pump cannot hold


def machine() -> ad.Machine:
    """With too weak a pump for one pose."""
    return ad.load("paper_1dof").replace({"supply.pressure_bar": 70.0})


def assert_equal(one: Any, other: Any) -> None:
    """Every field of two sweeps, to the last bit; errors by what they say."""
    assert type(one) is type(other)
    if dataclasses.is_dataclass(one):
        for field in dataclasses.fields(one):
            assert_equal(getattr(one, field.name), getattr(other, field.name))
    elif isinstance(one, np.ndarray):
        assert one.dtype == other.dtype
        assert one.shape == other.shape
        assert one.tobytes() == other.tobytes()
    elif isinstance(one, ad.ArmDesignError):
        assert vars(one) == vars(other)
    else:
        assert repr(one) == repr(other)


@pytest.mark.slow
def test_interrupted_it_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    undisturbed, real, stacks = ad.validate(machine(), POSES), validation.attempt_all, []

    def interrupted(cases: Any, **options: Any) -> Any:
        stacks.append(len(cases))
        if len(stacks) == 2:
            raise KeyboardInterrupt
        return real(cases, **options)

    monkeypatch.setattr(validation, "attempt_all", interrupted)
    with pytest.raises(KeyboardInterrupt), keeping(tmp_path / "j.sqlite"):
        ad.validate(machine(), POSES)
    with keeping(tmp_path / "j.sqlite") as pieces:
        again = ad.validate(machine(), POSES)
        assert pieces.answered == 1
    assert stacks == [2, 0, 0], "the first pose is not run again"
    pd.testing.assert_frame_equal(again.frame, undisturbed.frame, check_exact=True)
    for one, other in zip(again.sweeps, undisturbed.sweeps, strict=True):
        assert_equal(one, other)


def drawn(rng: np.random.Generator, with_friction: FittedMode | Failure | None) -> FittedMode:
    """A run of numbers that nothing has rounded, with those that JSON has no words for."""
    numbers = rng.normal(size=(6, 3))
    numbers[0, 0], numbers[1, 0], numbers[2, 0] = np.nan, -0.0, np.inf
    lines = numbers[3] + 1j * numbers[4]
    lines[0] = complex(-0.0, -0.0)
    fit = ModalFit(*numbers, numbers[0], lines, lines, numbers[:2], 0.1)  # type: ignore[call-arg]
    named = {"pose": "worst", "payload": "full", "cylinder": "boom", "mode": 2, "fitted_mode": 1}
    linear = {"linear_frequency": 1 / 3, "frequency_at_rest": np.nan, "linear_damping": 5e-324}
    figures = {"amplitude": 0.1, "peak": 2.0, "energy_error": 1e-5, "remark": "agrees"}
    arrays = {"q": numbers[5], "mean": numbers[4], "span": numbers[3], "on_resonance": numbers[:2]}
    return FittedMode(**named, **linear, **figures, **arrays, fit=fit, with_friction=with_friction)


def test_what_is_kept_is_all() -> None:
    """By way of the journal's JSON."""
    rng = np.random.default_rng(1)
    plain = drawn(rng, None)
    sweep = {one.name: getattr(plain, one.name) for one in dataclasses.fields(SweptMode)}
    failure = Failure(**sweep, error=SimulationError("arm: run", "gave up", "shorten it", 7, "a"))
    sweeps = [plain, failure, drawn(rng, plain), drawn(rng, failure)]
    kept = json.loads(json.dumps(form().write(0, sweeps)))
    for one, other in zip(form().read(0, kept), sweeps, strict=True):
        assert_equal(one, other)


@pytest.mark.slow
def test_another_question_finds_nothing_of_use(tmp_path: Path) -> None:
    """Another pose, amplitude or machine is another piece."""
    with keeping(tmp_path / "j.sqlite") as pieces:
        ad.validate(machine(), [0.0])
        for other, pose, options in (
            (machine(), [0.1], {}),
            (machine(), [0.0], {"amplitude": 0.01}),
            (machine().replace({"fluid.bulk_modulus_MPa": 1100.0}), [0.0], {}),
        ):
            ad.validate(other, pose, **options)
        assert (pieces.answered, len(pieces.entries)) == (0, 4)


def test_what_the_surroundings_lack_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """It was kept: a validation without numba's compiler failed for ever."""
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    monkeypatch.setattr(numba.config, "DISABLE_JIT", 1)
    workspace = ad.Workspace.grid(ad.load("paper_1dof"), points=3)
    (proof,) = validation.validate_maps([ad.frequency_map(workspace.machine, workspace)])
    assert all(isinstance(one, Failure) for one in proof.sweeps)
    assert form().write(0, list(proof.sweeps)) is None
