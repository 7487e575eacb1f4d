"""Bands of what is not known exactly: the worst case inside them is found, and no sample inside is
worse.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign.frequency.cases import scaled_links
from tests import machines

BANDS = ad.Bands(
    bulk_modulus=(0.8, 1.2), dead_volume=(0.9, 1.3), payload=(0.7, 1.25), link_mass=(0.9, 1.1)
)


@pytest.fixture(scope="module")
def workspace(excavator: ad.Machine) -> ad.Workspace:
    return ad.Workspace.grid(excavator, points=7)


def test_no_bands_are_the_machine_itself(excavator: ad.Machine, workspace: ad.Workspace) -> None:
    band = ad.frequency_band(excavator, workspace, ad.Bands())
    on_grid = ad.frequency_map(excavator, workspace).frame["f1_hz"].min()
    assert_allclose([band.low.frequency, band.nominal, band.high.frequency], on_grid, rtol=1e-12)


def test_one_joint_by_hand() -> None:
    """Without gravity's part ω² = β k/M: the band of f is √ of the band of β, over √ of that of
    all masses.

    Gravity's part, which goes with the masses, is subtracted first: K_g = M g-terms scale as the
    masses do.
    """
    machine = ad.load("paper_1dof")
    workspace = ad.Workspace.grid(machine, points=5)
    bands = ad.Bands(bulk_modulus=(0.81, 1.44), payload=(1.1, 1.1), link_mass=(1.1, 1.1))
    band = ad.frequency_band(machine, workspace, bands)
    for extreme, modulus in ((band.low, 0.81), (band.high, 1.44)):
        poses = machine.with_payload(extreme.payload).at(extreme.q)
        oil, rest = (
            poses.hydraulic_stiffness[0, 0, 0],
            poses.stiffness_matrix[0, 0, 0] - poses.hydraulic_stiffness[0, 0, 0],
        )
        squared = (modulus * oil + 1.1 * rest) / (1.1 * poses.mass_matrix[0, 0, 0])
        assert_allclose(extreme.frequency, math.sqrt(squared) / (2 * math.pi), rtol=1e-9)


@pytest.mark.slow
@settings(max_examples=40)
@given(
    shares=st.tuples(
        st.floats(0.8, 1.2), st.floats(0.9, 1.3), st.floats(0.7, 1.25), st.floats(0.9, 1.1)
    ),
    name=st.sampled_from(["excavator_20t", "branched", "four_bar_right"]),
)
def test_no_sample_within_the_bands_is_worse(
    shares: tuple[float, float, float, float], name: str
) -> None:
    """Monte Carlo through the front door: the machine with other oil, volumes, load and links, by
    its own map.
    """
    machine = machines.named(name)
    workspace = ad.Workspace.grid(machine, points=4)
    low = ad.frequency_band(machine, workspace, BANDS).low.frequency
    modulus, volume, load, link = shares
    changes: dict[str, object] = {
        "fluid.bulk_modulus_MPa": modulus * machine.section.fluid.bulk_modulus_MPa
    }
    for key, cylinder in machine.section.cylinder.items():
        for side in ("cap", "annulus"):
            changes[f"cylinder.{key}.dead_volume_l.{side}"] = volume * getattr(
                cylinder.dead_volume_l, side
            )
    for key, payload in machine.section.payload.items():
        changes[f"payload.{key}.mass_kg"] = load * payload.mass_kg
    sample = machine.replace(changes)
    lowest = math.inf
    for payload in sample.payloads:
        case = sample.with_payload(payload.name)
        rigid = workspace.rigid[case.holds(workspace.rigid)]
        lowest = min(
            lowest,
            ad.natural_modes(case.evaluate(scaled_links(rigid, link))).frequencies[:, 0].min(),
        )
    assert lowest >= low * (1 - 1e-9)


def test_softer_oil_more_air_more_volume_are_never_better(
    excavator: ad.Machine, workspace: ad.Workspace
) -> None:
    reached = [
        ad.frequency_band(excavator, workspace, bands).low.frequency
        for bands in (
            ad.Bands(),
            ad.Bands(air=(0.0, 0.005)),
            ad.Bands(air=(0.0, 0.02)),
            ad.Bands(air=(0.0, 0.02), bulk_modulus=(0.7, 1.0)),
            ad.Bands(air=(0.0, 0.02), bulk_modulus=(0.7, 1.0), dead_volume=(1.0, 1.5)),
        )
    ]
    assert np.all(np.diff(reached) < 0)


def test_bands_are_read_from_the_file(excavator: ad.Machine) -> None:
    text = (
        excavator.text
        + "\n[bands]\nbulk_modulus_share = [0.7, 1.1]\nentrained_air_percent = [0, 1.5]\n"
    )
    machine = ad.Machine.from_text(text, excavator.urdf_text, excavator.source)
    assert ad.Bands.of(machine) == ad.Bands(bulk_modulus=(0.7, 1.1), air=(0.0, 0.015))


FAULTS = [
    (
        "bulk_modulus_share = [1.2, 0.8]",
        r"bands\.bulk_modulus_share: \[1\.2, 0\.8\] is in the wrong order; give \[lower, upper\]",
    ),
    (
        "payload_share = [0, 1]",
        r"bands\.payload_share\.0: 0 is not allowed; give a number in \[0\.1, 10\]",
    ),
    (
        "link_mass_share = [1]",
        r"bands\.link_mass_share: \[1\] is not allowed; give a list of 2 values",
    ),
]


@pytest.mark.parametrize(("line", "message"), FAULTS)
def test_faults_are_said(excavator: ad.Machine, line: str, message: str) -> None:
    with pytest.raises(ad.ArmDesignError, match=message):
        ad.Machine.from_text(
            f"{excavator.text}\n[bands]\n{line}\n", excavator.urdf_text, excavator.source
        )


@pytest.mark.parametrize("band", [(1.2, 0.8), (0.0, 1.0), (float("nan"), 1.0), (1.0,), ("a", 1.0)])
def test_impossible_bands_are_refused(band: tuple[float, ...]) -> None:
    with pytest.raises(
        ad.ArmDesignError, match=r"bands\.payload: .* is not allowed; give \(lower, upper\) within"
    ):
        ad.Bands(payload=band)  # type: ignore[arg-type]
