"""Bands of what is not known exactly: the worst case inside them is found, and no sample inside is
worse.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign.frequency.bands import OIL, STRUCTURE, Corner
from armdesign.frequency.cases import scaled_links
from armdesign.frequency.frequency_band import FrequencyBand, Scenario
from armdesign.frequency.worst_frequency import worst_anywhere, worst_frequency
from tests import machines
from tests.machines import machine_with
from tests.sprung import rocking

BANDS = ad.Bands(
    bulk_modulus=(0.8, 1.2), dead_volume=(0.9, 1.3), payload=(0.7, 1.25), link_mass=(0.9, 1.1)
)


@pytest.fixture(scope="module")
def workspace(excavator: ad.Machine) -> ad.Workspace:
    return ad.Workspace.grid(excavator, points=7)


def test_bands_of_arrays_are_those_of_tuples() -> None:
    pairs: Any = np.array([[0, 1], [0, 2]])
    given = ad.Bands(structure=pairs[0], structures={"lift": pairs[1]})
    assert given == ad.Bands(structure=(0.0, 1.0), structures={"lift": (0.0, 2.0)})
    assert repr(given) == "Bands(structure=(0.0, 1.0), structures={'lift': (0.0, 2.0)})"


def test_no_bands_are_the_machine_itself(excavator: ad.Machine, workspace: ad.Workspace) -> None:
    band = ad.frequency_band(excavator, workspace, ad.Bands())
    on_grid = ad.frequency_map(excavator, workspace).frame["f1_hz"].min()
    assert_allclose([band.low.frequency, band.nominal, band.high.frequency], on_grid, rtol=1e-12)


def test_one_joint_by_hand() -> None:
    """Without gravity's part ω² = β k/M: the band of f is √ of the band of β over √ of the band of
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
        oil, without_oil = (
            poses.hydraulic_stiffness[0, 0, 0],
            poses.stiffness_matrix[0, 0, 0] - poses.hydraulic_stiffness[0, 0, 0],
        )
        squared = (modulus * oil + 1.1 * without_oil) / (1.1 * poses.mass_matrix[0, 0, 0])
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


def test_structure_in_series_by_hand() -> None:
    """At an end of s a cylinder with A1 ≠ A2 has 1/k = 1/k_oil + s c, with c = V/(β A²) of both
    chambers at mid stroke from the file's own numbers; oil with its own bands leaves c alone.
    """
    machine = machines.rigid("excavator_20t")
    bands = ad.Bands(structure=(0.3, 1.5), bulk_modulus=(0.8, 1.2))
    at_ends = (1.5, 0.8), (0.3, 0.8), (1.5, 1.2), (0.3, 1.2)
    for soft, (share, modulus) in zip(bands.ends, at_ends, strict=True):
        for cylinder in bands.at_end(machine, soft).cylinders:
            text = machine.section.cylinder[cylinder.name]
            bore, annulus = (
                text.count * math.pi / 4 * (text.bore_mm**2 - rod**2) * 1e-6
                for rod in (0, text.rod_mm)
            )
            middle, dead = text.stroke_mm / 2000, text.dead_volume_l
            of_oil = 1200e6 * (
                bore**2 / (bore * middle + dead.cap * 1e-3)
                + annulus**2 / (annulus * middle + dead.annulus * 1e-3)
            )
            assert_allclose(cylinder.compliance, share / of_oil, rtol=1e-12)
        q = machine.ranges.mean(axis=1)
        poses = replace(bands.at_end(machine, soft), cylinders=tuple(
            replace(c, compliance=0.0) for c in bands.at_end(machine, soft).cylinders
        )).at(q)  # fmt: skip
        plain = machine.replace({"fluid.bulk_modulus_MPa": 1200 * modulus}).at(q)
        assert_allclose(poses.oil_stiffness, plain.oil_stiffness, rtol=1e-12)


def test_structure_of_the_20_t_machine(rigid_excavator: ad.Machine) -> None:
    """Issue 13: oil 42.9, 22.6, 17.9 MN/m at mid stroke; worst 0.910 Hz rigid, 0.767 at 0.4 of the
    oil's compliance, 0.640 where structure is as soft as the oil, found with another program.
    """
    machine = rigid_excavator
    oil = [1e-6 / c.oil_compliance(machine.fluid, machine.supply) for c in machine.cylinders]
    assert_allclose(oil, [42.9, 22.6, 17.9], atol=0.05)
    workspace = ad.Workspace.grid(machine, points=(9, 9, 17))
    for share, frequency in ((0.0, 0.910), (0.4, 0.767), (1.0, 0.640)):
        band = ad.frequency_band(machine, workspace, ad.Bands(structure=(share, 1.0)))
        assert band.high.frequency == pytest.approx(frequency, abs=5e-4)


def test_structure_of_single_actuators() -> None:
    """A share by name comes before the common one; without a common one the others stay."""
    machine = machines.named("excavator_20t")
    oil = [c.oil_compliance(machine.fluid, machine.supply) for c in machine.cylinders]
    common = ad.Bands(structure=(0.0, 0.5), structures={"stick": (0.1, 2.0)})
    shares = [0.5, 2.0, 0.5], [0.5, 0.1, 0.5], [0.0, 2.0, 0.0], [0.0, 0.1, 0.0]
    for soft, share in zip(common.ends, shares, strict=True):
        at_end = common.at_end(machine, soft).cylinders
        assert_allclose([c.compliance for c in at_end], np.array(share) * oil)
    single = ad.Bands(structures={"stick": (0.1, 2.0)})
    boom, stick, bucket = single.at_end(machine, single.ends[0]).cylinders
    assert (boom, bucket) == (machine.cylinders[0], machine.cylinders[2])
    assert stick.compliance == pytest.approx(2.0 * oil[1])
    with pytest.raises(ad.ArmDesignError, match=r"structures\.stik: excavator_20t has no such ac"):
        ad.Bands(structures={"stik": (0, 1)}).at_end(machine, frozenset())


def test_the_bands_of_the_crane_are_of_what_was_measured() -> None:
    """Tilt and extension, of which nothing is known, stay as their file has them."""
    crane = ad.load("loader_crane")
    bands = ad.Bands.of(crane)
    soft = bands.at_end(crane, bands.ends[0])
    assert soft.cylinders[0].compliance > crane.cylinders[0].compliance
    assert [c.compliance for c in soft.cylinders[1:]] == [0.0, 0.0]


def test_places_between_the_corners_are_found_as_whole_machines_are(
    excavator: ad.Machine, workspace: ad.Workspace
) -> None:
    """One band's places are its sixteenths; two bands are met at the same fifteen shares each,
    but not together; the worst there is the worst of all poses.
    """
    bands = ad.Bands(structure=(0.0, 1.0), payload=(0.8, 1.2))
    shares = np.arange(1, 16) / 16
    for name, low, width in (("structure", 0.0, 1.0), ("payload", 0.8, 0.4)):
        own = sorted(getattr(exact, name)[0] for exact in bands.between)
        assert_allclose(own, low + shares * width)
    band = ad.frequency_band(excavator, workspace, bands)
    for exact, frequency in list(zip(bands.between, band.between, strict=True))[::5]:
        whole = ad.frequency_band(excavator, workspace, exact)
        assert frequency == pytest.approx(whole.low.frequency, rel=1e-12)
    assert ad.Bands().between == []


def test_gains_are_judged_where_some_bands_are_soft_and_others_stiff(
    excavator: ad.Machine, workspace: ad.Workspace
) -> None:
    """Larger cylinders gain least on soft structure with stiff oil, at neither common end: a
    corner of their bands.
    """
    larger = tuple(replace(c, bore=1.2 * c.bore) for c in excavator.cylinders)
    pair = excavator, replace(excavator, cylinders=larger)

    def gain(modulus: float, structure: float) -> float:
        bands = ad.Bands(bulk_modulus=(modulus,) * 2, structure=(structure,) * 2)
        today, new = (
            [
                s.frequency
                for s in ad.frequency_band(m, workspace, bands, today=excavator).scenarios
            ]
            for m in pair
        )
        return min(b / a for a, b in zip(today, new, strict=True)) - 1

    bands = ad.Bands(bulk_modulus=(0.5, 1.2), structure=(0.0, 1.0))
    today, new = (ad.frequency_band(m, workspace, bands, today=excavator) for m in pair)
    mixed = gain(1.2, 1.0)
    assert mixed < min(gain(0.5, 1.0), gain(1.2, 0.0)) - 0.01
    assert new.least_gain(today) == pytest.approx(mixed, rel=1e-9)


def test_a_new_machine_keeps_the_structure_of_todays() -> None:
    """In m/N: larger cylinders have stiffer oil, but brackets and pins are today's."""
    today = machines.named("excavator_20t")
    new = today.replace({"cylinder.boom.bore_mm": 150, "cylinder.stick.stroke_mm": 1600})
    bands = ad.Bands(structure=(0.0, 1.0))
    soft = bands.ends[0]
    kept, own = bands.at_end(new, soft, today), bands.at_end(new, soft)
    for one, other in zip(kept.cylinders, bands.at_end(today, soft).cylinders, strict=True):
        assert one.compliance == other.compliance
    assert own.cylinders[0].compliance < kept.cylinders[0].compliance
    assert own.cylinders[1].compliance > kept.cylinders[1].compliance


def test_least_gain_is_that_of_the_poorest_corner() -> None:
    """By hand: gains of 0.6/0.5, 0.9/1 and at the file's values 0.8/0.7; a place between."""
    today, new = (
        FrequencyBand(
            scenarios=tuple(
                Scenario(frequency=f, payload="full", q=np.zeros(1), corner=Corner(soft, 1.0, 1.0))
                for f, soft in ((low, frozenset({"structure"})), (high, frozenset[str]()))
            ),
            nominal=nominal,
            sample=tuple,
        )
        for low, nominal, high in ((0.5, 0.7, 1.0), (0.6, 0.8, 0.9))
    )
    assert new.least_gain(today) == pytest.approx(-0.1)
    assert today.least_gain(today) == 0
    amid = (replace(new, sample=lambda: (0.7, 0.6)), replace(today, sample=lambda: (0.75, 0.75)))
    assert amid[0].least_gain(amid[1]) == pytest.approx(-0.2)


def test_with_air_all_poses_count_between_the_masses_that_are_tried() -> None:
    """Load makes oil stiffer, at first fast, and the machine heavier: between the masses that are
    tried some poses are lower than at each of them. Against every pose alone.
    """
    machine = machines.build([machines.BOOM], [machines.LIFT])
    bands = ad.Bands(air=(0.05, 0.05), payload=(0.1, 1.5))
    workspace = ad.Workspace.grid(machine, points=9)
    expected = []
    for exact in bands.between:
        at_end = exact.at_end(machine, frozenset())
        each = [
            worst_frequency(at_end, workspace.subset(np.array([k])), *exact.payload[:1]).frequency
            for k in range(len(workspace))
        ]
        expected.append(min(each))
    band = ad.frequency_band(machine, workspace, bands)
    np.testing.assert_allclose(band.between, expected, rtol=1e-12)


def test_bands_are_read_from_the_file(excavator: ad.Machine) -> None:
    machine = machine_with(
        excavator,
        "bulk_modulus_share = [0.7, 1.1]\nentrained_air_percent = [0, 1.5]\nstructure = [0, 0.8]\n"
        "spring_stiffness_share = [0.5, 1.5]",
    )
    assert ad.Bands.of(machine) == ad.Bands(
        bulk_modulus=(0.7, 1.1),
        air=(0.0, 0.015),
        structure=(0.0, 0.8),
        spring_stiffness=(0.5, 1.5),
    )


FAULTS = [
    (
        "structure = [0.5, 0.2]",
        r"bands\.structure: \[0\.5, 0\.2\] is in the wrong order; give \[lower, upper\]",
    ),
    (
        "structures = { boom = [0.5, 0.2] }",
        r"bands\.structures\.boom: \[0\.5, 0\.2\] is in the wrong order; give \[lower, upper\]",
    ),
    (
        "structures = { bom = [0.2, 0.5] }",
        r'bands\.structures\.bom: no actuator "bom"; did you mean "boom"',
    ),
    (
        "structure = [-0.1, 1]",
        r"bands\.structure\.0: -0\.1 is not allowed; give a number in \[0, 10\]",
    ),
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
        machine_with(excavator, line)


@pytest.mark.parametrize(
    "band", [(1.2, 0.8), (0.0, 1.0), (float("nan"), 1.0), (1.0,), ("a", 1.0), 1.0]
)
def test_impossible_bands_are_refused(band: tuple[float, ...] | float) -> None:
    with pytest.raises(
        ad.ArmDesignError, match=r"bands\.payload: .* is not allowed; give \(lower, upper\) within"
    ):
        ad.Bands(payload=band)  # type: ignore[arg-type]


def test_springs_within_their_share() -> None:
    """Through the file: the ends of the band are machines whose spring is so much stiffer."""
    machine = rocking()
    workspace = ad.Workspace.grid(machine, points=4)
    band = ad.frequency_band(machine, workspace, ad.Bands(spring_stiffness=(0.5, 2.0)))
    for extreme, share in ((band.low, 0.5), (band.high, 2.0)):
        (spring,) = machine.springs
        path = f"spring.{spring.name}.{spring.stiffness_key}"
        other = machine.replace({path: share * spring.stiffness})
        worst = ad.frequency_band(other, workspace, ad.Bands()).nominal
        assert extreme.frequency == pytest.approx(worst, rel=1e-12)
    assert band.low.frequency < band.nominal < band.high.frequency


@pytest.mark.parametrize("name", ["excavator_20t", "spatial", "redundant"])
def test_what_corners_share_changes_nothing(name: str) -> None:
    """Each corner alone, as a machine of its own, and the search between poses from there."""
    machine = machines.named(name)
    bands = ad.Bands(structure=(0.2, 1.0), bulk_modulus=(0.8, 1.1), payload=(0.9, 1.0))
    workspace = ad.Workspace.grid(machine, 3)
    for one in ad.frequency_band(machine, workspace, bands).scenarios[::3]:  # 3 of 8
        at_end, shares = bands.at_end(machine, one.corner.soft), one.corner[1:]
        alone = worst_frequency(at_end, workspace, *shares)
        assert one.frequency == pytest.approx(alone.frequency, rel=1e-13)
        assert (one.payload, one.q.tolist()) == (alone.payload, alone.q.tolist())
        known = worst_anywhere(at_end, workspace, *shares, one.starts)
        anew = worst_anywhere(at_end, workspace, *shares)
        assert known.frequency == pytest.approx(anew.frequency, rel=1e-12)


@pytest.mark.parametrize(
    ("names", "count", "oil_together", "structure_together"),
    [
        ("structure structures bulk_modulus dead_volume payload", 16, False, False),
        ("structure structures bulk_modulus dead_volume payload link_mass", 8, True, False),
        ("structure structures bulk_modulus spring_stiffness payload link_mass", 8, False, True),
        (
            "structure structures bulk_modulus dead_volume air spring_stiffness payload",
            16,
            True,
            False,
        ),
        (
            "structure structures bulk_modulus air spring_stiffness payload link_mass",
            8,
            True,
            True,
        ),
    ],
)
def test_of_many_bands_oil_moves_together_or_structure_or_both(
    names: str, count: int, oil_together: bool, structure_together: bool
) -> None:
    """Of structures that differ from actuator to actuator some are soft while others are stiff."""
    wide = {name: (0.5, 0.9) for name in names.split()}
    if "structures" in wide:
        wide["structures"] = {"stick": (0.5, 0.9)}
    if "air" in wide:
        wide["air"] = (0.0, 0.1)
    ends = ad.Bands(**wide).ends
    assert len(ends) == count
    for group, together in ((OIL, oil_together), (STRUCTURE, structure_together)):
        soft = {end & {*group} for end in ends}
        present = {*group} & wide.keys()
        assert (soft == {frozenset(), frozenset(present)}) == (together or len(present) == 1)
