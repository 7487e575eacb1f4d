"""A mass of one's own counts like a load case of the file: in maps, in variants, in designs."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from tests import machines


@pytest.fixture(scope="module")
def loaded() -> ad.Machine:
    return machines.named("excavator_20t").with_payload("full").with_payload(2500)


def test_it_sits_where_the_case_at_work_sits(loaded: ad.Machine) -> None:
    """By definition: the file's full bucket with another mass in its text."""
    other = (
        machines.named("excavator_20t")
        .replace({"payload.full.mass_kg": 2500})
        .with_payload("full")
    )
    q = machines.inner_poses(other, 3)
    assert_allclose(loaded.at(q).mass_matrix, other.at(q).mass_matrix, rtol=1e-14)
    assert_allclose(loaded.at(q).gravity_torque, other.at(q).gravity_torque, rtol=1e-14)


def test_no_mass_falls_out(loaded: ad.Machine) -> None:
    """A mass is held in the pitch range of the file's load, none is held at any pitch."""
    tipped = [[0.5, -1.8, -0.6]]  # bucket at 251°; the load is held at 120° to 240°
    assert loaded.with_payload(0.0).holds(tipped).all()
    assert not loaded.with_payload(1.0).holds(tipped).any()


def test_maps_count_it_beside_the_cases_of_the_file(loaded: ad.Machine) -> None:
    frequencies = ad.frequency_map(loaded, ad.Workspace.grid(loaded, points=5))
    assert list(frequencies.frame["payload"].unique()) == ["empty", "full", "2500 kg"]
    assert frequencies.worst.payload == "2500 kg"  # the heaviest


def test_variants_keep_it_and_another_mass_takes_its_place(loaded: ad.Machine) -> None:
    wider = loaded.replace({"cylinder.boom.bore_mm": 130})
    assert wider.payload.mass == 2500
    assert [case.name for case in wider.with_payload(900.0).payloads] == [
        "empty",
        "full",
        "900 kg",
    ]
    assert loaded.with_payload("full").payload.mass == 1600  # the file's


PLACES = {
    "at": {"payload.full.at_mm": [300, 0, 200]},
    "link": {"payload.full.link": "stick"},
    "pitch": {"payload.full.pitch_deg": [90, 200]},
}


@pytest.mark.parametrize("change", PLACES.values(), ids=PLACES)
def test_its_place_follows_the_files(loaded: ad.Machine, change: dict[str, object]) -> None:
    """The load first and then the place is the place first and then the load."""
    other = machines.named("excavator_20t").replace(change).with_payload("full")
    assert loaded.replace(change).payload == other.with_payload(2500).payload
    assert loaded.replace(change).with_payload(0.0).payload == other.with_payload(0.0).payload
    look = ad.what_if(loaded, change, points=3, bandwidth=False)
    assert look.after.machine.payload == other.with_payload(2500).payload


def test_a_mass_after_none_is_held_in_its_range_again(loaded: ad.Machine) -> None:
    assert loaded.with_payload(0.0).with_payload(2500).payload == loaded.payload


def test_slopes_by_its_place_are_those_of_the_case_of_the_file(loaded: ad.Machine) -> None:
    """The file's full bucket with this mass in its text; frequencies at the same pose."""
    of_file = machines.named("excavator_20t").replace({"payload.full.mass_kg": 2500})
    keys = [f"payload.full.{key}" for key in ("at_mm.0", "at_mm.2", "pitch_deg.1")]
    found = []
    for machine in (loaded, of_file.with_payload("full")):
        frame = ad.sensitivity(machine, ad.Workspace.grid(machine, points=4)).frame
        found.append(frame.set_index("key").loc[keys, "hz_per_unit"].to_numpy(float))
    assert np.abs(found[0]).min() > 1e-6
    assert_allclose(*found, rtol=1e-6)


@pytest.mark.slow
def test_a_design_is_made_for_it(loaded: ad.Machine) -> None:
    design = ad.size_cylinders(loaded, ad.Workspace.grid(loaded, points=7))
    assert design.after.worst.payload == "2500 kg"
    assert design.after.worst.frequency >= design.before.worst.frequency


@pytest.mark.slow
def test_a_design_takes_the_cylinders_own_masses_along() -> None:
    """What the search foresaw with bars moved along is what the saved machine has, but for
    rounding (below 0.5 %).
    """
    heavy = machines.named("heavy_bars")
    workspace = ad.Workspace.grid(heavy, points=7)
    design = ad.optimize(heavy, workspace, starts=1)
    lowest = float(np.min(design.after.frame["f1_hz"]))
    assert lowest == pytest.approx(design.unrounded, rel=5e-3)
    assert lowest > 1.3 * float(np.min(design.before.frame["f1_hz"]))


def test_what_limits_its_poses_is_one_angle(loaded: ad.Machine) -> None:
    """The nearer limit's room is what the case may still tip; without limits there is no end."""
    empty, full = (case for case in loaded.payloads if case.name in ("empty", "full"))
    heading, rigid = loaded.heading, loaded.arm.kinematics(ad.Workspace.grid(loaded, points=5).q)
    rooms = [full.room(heading, rigid, upper=upper) for upper in (False, True)]
    assert_allclose(np.minimum(*rooms), -full.pitch_excess(heading, rigid), atol=1e-12)
    assert_allclose(np.sum(rooms, axis=0), np.deg2rad(120), rtol=1e-12)  # 120…240 deg
    assert np.array_equal(full.exists(heading, rigid), np.minimum(*rooms) >= -1e-8)
    assert 0 < full.exists(heading, rigid).sum() < len(rigid)
    assert empty.limits == ()
    assert empty.exists(heading, rigid).all()
