"""Load cases over a workspace: each at the poses where it exists, all loops agree."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign.arrays import Array
from armdesign.frequency.cases import groups_by_case, in_chunks, load_cases
from armdesign.frequency.modes import lowest_frequency
from armdesign.frequency.worst_frequency import worst_frequency
from tests import machines
from tests.frequency.cached import mapped, workspace


def test_a_load_case_exists_only_where_it_is_held() -> None:
    frame, machine = mapped("excavator_20t").frame, machines.named("excavator_20t")
    full = frame[frame["payload"] == "full"]
    assert 0 < len(full) < (frame["payload"] == "empty").sum()
    assert machine.with_payload("full").holds(full[list(machine.joints)].to_numpy()).all()


@pytest.mark.parametrize("name", ["excavator_20t", "crossing"])
def test_the_loop_is_with_payload_and_holds(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """By definition, load case by load case; also in chunks of a workspace that is not kept."""
    machine, space = machines.named(name), workspace(name)
    cases = list(load_cases(machine, space))
    assert [case.name for case in cases] == [payload.name for payload in machine.payloads]
    lowest = {}
    for case in cases:
        defined = machine.with_payload(case.name)
        assert np.array_equal(case.indices, np.flatnonzero(defined.holds(space.q)))
        poses = defined.at(space.q[case.indices])
        assert_allclose(case.evaluate().mass_matrix, poses.mass_matrix, rtol=1e-12)
        lowest[case.name] = lowest_frequency(poses)
    monkeypatch.setattr("armdesign.arrays.CHUNK", 17)
    monkeypatch.setattr("armdesign.frequency.workspace.KEPT", 0)
    again = list(load_cases(machine, ad.Workspace.grid(machine, 5)))
    found: dict[str, list[Array]] = {name: [] for name in lowest}
    for case, part in in_chunks(again, lambda case, rigid: case.machine.at(rigid), "test"):
        found[case.name].append(lowest_frequency(part))
    for name, parts in found.items():
        assert_allclose(np.concatenate(parts), lowest[name], rtol=1e-12)
    worst = worst_frequency(machine, space)
    assert worst.frequency == pytest.approx(min(of.min() for of in lowest.values()), rel=1e-12)
    at_worst = machine.with_payload(worst.payload).at(worst.q)
    assert lowest_frequency(at_worst)[0] == pytest.approx(worst.frequency, rel=1e-12)


def test_shares_scale_payloads_and_links(rigid_excavator: ad.Machine) -> None:
    """Twice all masses is the machine with half of ω² (STYLE, known answer 6), gravity with it."""
    excavator, space = rigid_excavator, workspace("rigid_excavator_20t")
    heavy, nominal = (
        worst_frequency(excavator, space, *shares) for shares in ((2.0, 2.0), (1.0, 1.0))
    )
    oil = excavator.replace(
        {"fluid.bulk_modulus_MPa": 2 * excavator.section.fluid.bulk_modulus_MPa}
    )
    assert worst_frequency(oil, space, 2.0, 2.0).frequency == pytest.approx(
        nominal.frequency, rel=1e-9
    )
    assert heavy.frequency < nominal.frequency


def test_poses_are_grouped_by_the_load_case_of_each() -> None:
    machine = machines.named("excavator_20t")
    payloads = ("full", None, 250.0, "full", "empty")
    groups = [
        (loaded.payload, rows.tolist()) for loaded, rows in groups_by_case(machine, payloads)
    ]
    assert [(case.name, case.mass) for case, _ in groups] == [
        *(("full", 1600.0), (machine.payload.name, machine.payload.mass)),
        *(("250 kg", 250.0), ("empty", 0.0)),
    ]
    assert [np.flatnonzero(rows).tolist() for _, rows in groups] == [[0, 3], [1], [2], [4]]
