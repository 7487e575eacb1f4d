"""Answers at measurements: poses from lengths, open and stuck chambers, measured pressures."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest

import armdesign as ad
from armdesign.calibration.measured import measured_of
from armdesign.calibration.prediction import Predictor, positions
from tests.calibration.synthetic import AIR, BETA, LIFT, crane, measurements, poses


def predicted(machine: ad.Machine, table: pd.DataFrame) -> np.ndarray:
    measured = measured_of(table.to_dict("records"), machine)
    return np.asarray(Predictor(machine, measured)(machine).frequencies)


def test_lengths_say_what_joints_say() -> None:
    """Pin-to-pin lengths of the poses, a direct cylinder, a four-bar and a slide."""
    machine, q = crane(), poses()
    lengths = machine.at(q).lengths
    table = measurements(machine, q).drop(columns=["lift_boom_deg", "tilt_boom_deg"])
    table = table.drop(columns="extension_mm").assign(
        lift_length_mm=1e3 * lengths[:, 0],
        tilt_length_mm=1e3 * lengths[:, 1],
        extension_length_mm=1e3 * lengths[:, 2],
    )
    measured = measured_of(table.to_dict("records"), machine)
    assert positions(machine, measured) == pytest.approx(q, abs=1e-9)
    assert predicted(machine, table) == pytest.approx(table["frequency_hz"].to_numpy(), rel=1e-9)


def test_an_open_chamber_is_one_of_endless_volume() -> None:
    """Limiting case: 10 000 l on the annulus side hold nothing."""
    machine, q = crane(), poses()
    open_ = measurements(machine, q, lift_chambers="cap")
    endless = machine.replace({"cylinder.lift.dead_volume_l.annulus": 10_000.0})
    reference = measurements(endless, q)["frequency_hz"].to_numpy()
    assert predicted(machine, open_) == pytest.approx(reference, rel=1e-4)


def test_a_stuck_piston_leaves_the_compliance() -> None:
    """One joint by hand: ω² = (r²/c − F H + ∂g/∂q)/M."""
    machine = ad.load("paper_1dof")
    c = 2e-7
    (cylinder,) = machine.cylinders
    yielding = machine.replace({f"cylinder.{cylinder.name}.compliance_m_per_N": c})
    q = machine.ranges.mean(axis=1)[None]
    at = machine.at(q)
    (joint,) = machine.joints
    row = {f"{joint}_deg": math.degrees(q[0, 0]), "frequency_hz": 1.0}
    row[f"{cylinder.name}_chambers"] = "stuck"  # type: ignore[assignment]
    without_oil = at.gravity_stiffness[0, 0, 0] + at.geometric_stiffness[0, 0, 0]
    squared = (at.moment_arms[0, 0, 0] ** 2 / c + without_oil) / at.mass_matrix[0, 0, 0]
    predicted_row = predicted(yielding, pd.DataFrame([row]))
    assert predicted_row == pytest.approx(math.sqrt(squared) / (2 * math.pi), rel=1e-9)


def test_air_stands_at_the_measured_pressures() -> None:
    """A valve's preload raises the empty chamber just so."""
    preload = 20.0
    machine = crane().replace({AIR: 0.8})
    preloaded = machine.replace({"cylinder.lift.valve.preload_bar": preload})
    q = poses()[3::2]  # under the full load the lift cylinder pushes at all of them
    loaded = preloaded.with_payload("full")
    force, lift = loaded.at(q).cylinder_forces[:, 0], machine.cylinders[0]
    assert np.all(force > 0)
    cap = (force / 1e5 + lift.annulus_area * preload) / lift.bore_area
    rows = measurements(machine, q, lift_annulus_bar=preload).assign(payload="full")
    rows["lift_cap_bar"] = cap
    reference = ad.natural_modes(loaded.at(q)).frequencies[:, 0]
    assert predicted(machine, rows) == pytest.approx(reference, rel=1e-9)
    unknown = rows.drop(columns=["lift_cap_bar", "lift_annulus_bar"])
    assert np.all(predicted(machine, unknown) < 0.99 * reference)


def test_higher_modes_are_counted_from_one() -> None:
    machine, q = crane().replace({LIFT: 1e-8, BETA: 900.0}), poses(3)
    table = measurements(machine, q, mode=2)
    reference = [
        ad.natural_modes(machine.with_payload(p).at(one)).frequencies[0, 1]
        for p, one in zip(table["payload"], q, strict=True)
    ]
    assert predicted(machine, table) == pytest.approx(reference, rel=1e-9)
