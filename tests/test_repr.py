"""What an interactive session shows of machines and results fits on a screen."""

from __future__ import annotations

import dataclasses
import inspect

import numpy as np
import pytest

import armdesign as ad
from armdesign.machine.loading import shipped
from armdesign.machine.poses import pose_text


@pytest.mark.parametrize("name", [*shipped()])
def test_a_machine_is_a_few_lines(name: str) -> None:
    machine = ad.load(name)
    lines = repr(machine).splitlines()
    assert len(lines) <= 10
    assert max(map(len, lines)) < 400
    for word in (name, *machine.joints, *(c.name for c in machine.payloads)):
        assert word in repr(machine)


def test_units_are_public() -> None:
    """π rad are 180°, 1 bar is 1e5 Pa."""
    assert 180 * ad.units.deg == pytest.approx(3.14159265358979)
    assert 350 * ad.units.bar == 35e6


# These say themselves what matters, or hold a few numbers as they were given.
OTHERS = (ad.Machine, ad.Bands, ad.Step, ad.SweptSine, ad.Table, ad.WorstPose)
RESULTS = [
    kind
    for name in ad.__all__
    if inspect.isclass(kind := getattr(ad, name))
    and dataclasses.is_dataclass(kind)
    and kind not in OTHERS
    and not hasattr(kind, "headline")
]


@pytest.mark.parametrize("kind", RESULTS, ids=lambda kind: kind.__name__)
def test_every_public_object_is_at_most_ten_lines(kind: type) -> None:
    """Also with more poses than fit on a screen, and a text for every field."""
    value = object.__new__(kind)
    for field in dataclasses.fields(kind):
        object.__setattr__(value, field.name, np.linspace(-7, 1, 4000).reshape(1000, 2, 2))
    lines = repr(value).splitlines()
    assert len(lines) <= 10
    assert max(map(len, lines)) < 100
    shown = [field.name for field in dataclasses.fields(kind) if field.repr]
    assert shown[0] in repr(value)


def test_what_matters_is_in_it() -> None:
    machine = ad.load("paper_1dof")
    frequencies = ad.frequency_map(machine, ad.Workspace.grid(machine, points=5))
    shown = repr(frequencies)
    assert f"{frequencies.worst.frequency:.6g}" in shown
    assert frequencies.worst.payload in shown
    assert "paper_1dof" in shown
    assert repr(ad.Requirements(lift_share=0.8)) == "Requirements: lift_share 0.8"
    assert repr(ad.Requirements()) == "Requirements: as by default"


WORST = (
    "FrequencyMap of paper_1dof: worst 7.452 Hz at boom -46.9°, load case load, limited by lift"
)


def test_headlines_say_what_fields_do_not() -> None:
    machine = ad.load("paper_1dof")
    workspace = ad.Workspace.grid(machine, points=3)
    design = ad.size_cylinders(machine, workspace, ad.Requirements(oil_total_share=1.05))
    linear, wider = ad.linearize(machine, [0.0]), {"cylinder.lift.bore_mm": 70.0}
    for result, words in (
        (design, "Design of paper_1dof: worst 7.452 → 7.77 Hz, +4.3 %, aim nominal; binding: oil"),
        (ad.frequency_map(machine, workspace), WORST),
        (linear, f"LinearModel of paper_1dof: {linear.natural_frequencies[0]:.4g} Hz (ζ "),
        (ad.linear_models(machine, [[0.0], [0.1]]), "LinearModels of paper_1dof: 2 poses, 2 stab"),
        (ad.sensitivity(machine, workspace), "Sensitivity of paper_1dof: worst 7.452 Hz, by 21"),
        (ad.what_if(machine, wider, points=3), "WhatIf of paper_1dof: worst 7.452 → 9.558 Hz"),
        (ad.validate(machine, [0.0]), "Validation over boom: 2 of 2 sweeps fitted, largest devi"),
        (ad.bandwidth_map(machine, workspace, damping=0.02), "BandwidthMap of paper_1dof: worst "),
        (ad.frequency_band(machine, workspace), "FrequencyBand from 4.764 to 7.452 Hz, 7.452 Hz"),
    ):
        lines = repr(result).splitlines()
        assert lines[0].startswith(words)
        assert len(lines) <= 10
        assert max(map(len, lines)) < 100
        assert "nan" not in repr(result)
    assert f"binding: {design.binding[0].name}" in repr(design).splitlines()[0]


def test_a_long_headline_has_two_lines() -> None:
    """The worst pose of three joints is longer than a line, and stands there whole."""
    machine = ad.load("excavator_20t")
    frequencies = ad.frequency_map(machine, ad.Workspace.grid(machine, points=3))
    lines = repr(frequencies).splitlines()
    where = pose_text(machine, frequencies.worst.q)
    assert f"{where}, load case full, limited by boom" in " ".join(
        line.strip() for line in lines[:2]
    )
    assert len(lines) <= 10
    assert max(map(len, lines)) < 100


@pytest.mark.slow
def test_a_design_within_bands_says_its_least_gain_there() -> None:
    machine = ad.load("paper_1dof")
    workspace, bands = ad.Workspace.grid(machine, points=3), ad.Bands(bulk_modulus=(0.8, 1.2))
    design = ad.size_cylinders(machine, workspace, bands=bands)
    least = f"at least {ad.units.percent(design.least_gain)} within the bands, aim gain"
    assert least in " ".join(line.strip() for line in repr(design).splitlines()[:2])
    assert len(repr(design).splitlines()) <= 10
