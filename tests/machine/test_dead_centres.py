"""Cylinders over two joints that pass through a dead centre: named, with what can be done."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import armdesign as ad
from armdesign.errors import SimulationError
from armdesign.inspection.inspection import inspect
from armdesign.machine.dead_centres import DeadCentre, dead_centre
from armdesign.report.maps import map_head
from armdesign.report.sheet import limiting_note
from armdesign.viewing.reading import reading
from tests import machines
from tests.machines import BOOM, CylinderSpec, Joint

TILT = DeadCentre("tilt", "bucket")
VALVES = "\n".join(
    f"[cylinder.{name}.valve]\nrated_flow_l_per_min = 100\nrated_drop_bar = 10\n"
    "natural_frequency_hz = 10\ndamping_ratio = 0.7"
    for name in ("lift", "tilt")
)


@cache
def tipping() -> ad.Machine:
    """A bucket on a cylinder from the root, which passes over the bucket's pivot."""
    bucket = Joint("bucket", "boom", xyz=(1.6, 0, 0), limits=(-1.3, 0.5), com=(0.4, 0, 0.2))
    lift = CylinderSpec("lift", base=("root", (0.4, 0, 0.1)), rod_end=("boom", (0.9, 0, -0.1)))
    tilt = CylinderSpec("tilt", base=("root", (0.1, 0, 1.0)), rod_end=("bucket", (0.3, 0, 0.3)))
    return machines.build([BOOM, bucket], [lift, tilt], payload_kg=300, more=VALVES)


@cache
def mapped() -> ad.FrequencyMap:
    return ad.frequency_map(tipping(), ad.Workspace.grid(tipping(), points=7))


def dead_pose() -> np.ndarray:
    """Boom level; base, pivot and rod end in one line: of the pins' plane alone."""
    (base, pivot) = np.array([0.1, 1.0]), np.array([1.7, 0.5])
    angle = np.arctan2(*(pivot - base)[::-1]) - np.arctan2(0.3, 0.3)
    return np.array([0.0, angle])


def test_a_dead_centre_is_found_where_three_pins_are_in_line() -> None:
    machine, (boom, bucket) = tipping(), dead_pose()
    arm = machine.evaluate(machine.rigid_poses([[boom, bucket]])).moment_arms[0, 1, 1]
    assert abs(arm) < 1e-9
    for turn in (-0.03, 0.0, 0.03):
        assert dead_centre(machine, np.array([boom, bucket + turn])) == TILT
    assert dead_centre(machine, np.array([boom, bucket + 0.6])) is None


@pytest.mark.parametrize("name", ["excavator_20t", "loader_crane", "paper_1dof", "redundant"])
def test_none_in_the_middle_of_ranges(name: str) -> None:
    machine = machines.named(name)
    assert dead_centre(machine, machines.middle(machine)) is None


def test_map_and_design_name_it() -> None:
    """Gravity or springs were at fault before, and a search was to change it."""
    worst, head = mapped().worst, map_head(mapped())
    assert worst.frequency == 0
    assert (worst.cylinder, worst.dead_centre) == ("tilt", TILT)
    rows = dict(head.rows)
    assert "the tilt cylinder is at its dead centre about bucket" in rows["worst frequency"]
    assert "gravity" not in rows["worst frequency"]
    assert rows["limited by"] == "tilt cylinder, at its dead centre"
    note = limiting_note(tipping(), worst)
    assert "which no size changes: move its pins or narrow the range of joint bucket" in note
    assert note in head.note


def test_check_names_it() -> None:
    inspection = inspect(tipping(), mapped().workspace)
    (words,) = (one.words for one in inspection.findings() if "of the poses are unst" in one.words)
    assert f"(0 Hz): {TILT.fault}; {TILT.remedy}" in words


def test_linear_models_and_the_viewer_name_it() -> None:
    q = mapped().worst.q
    assert reading(tipping(), q).fault == f"{TILT.fault}: the pose is unstable"
    with pytest.raises(SimulationError, match="the tilt cylinder is at its dead centre"):
        ad.linearize(tipping(), q)


def test_gravity_is_named_where_moment_arms_are_large() -> None:
    """Oil of a hundredth of the usual stiffness under a heavy load."""
    soft = machines.named("rigid_excavator_20t").replace({"fluid.bulk_modulus_MPa": 4})
    frequencies = ad.frequency_map(soft, ad.Workspace.grid(soft, points=4))
    rows = dict(map_head(frequencies).rows)
    assert frequencies.worst.dead_centre is None
    assert "unstable, gravity overcomes the trapped oil" in rows["worst frequency"]
