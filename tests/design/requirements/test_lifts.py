"""Lifts: capacity and place by the independent planar reference."""

from __future__ import annotations

import itertools
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armdesign import ArmDesignError, Machine, Requirements
from armdesign.arrays import Array
from armdesign.design.requirements.holding import Lift, lift_pose
from tests.commands import assert_one_line, main
from tests.design.designs import MACHINES
from tests.design.requirements.shared import DEG, FRONT, POSED, PRESSURE, RETURN, own, reference
from tests.machines import named
from tests.reference_planar import Reference


@pytest.mark.parametrize("lift", [FRONT, POSED], ids=["place", "pose"])
def test_lift_capacity_by_the_independent_reference(lift: Lift, tmp_path: Path) -> None:
    """At the mass that ``check`` says, the weakest cylinder carries just 87 % of what the supply
    gives (ISO 10567).

    The reference has the mass as a payload of its own file; static forces by complex steps of
    energy and lengths.
    """
    machine = MACHINES["excavator"]()
    lift_check = own(lifts=(lift,))[f"lift.{lift.name}"]
    at = lift_pose(machine, lift, Requirements.of(machine).holding_share)
    link = lift.link or "bucket"
    place = [1000.0 * x for x in lift.at or machine.tool.at]
    loaded = machine.replace(
        {
            "payload.full.mass_kg": lift_check.value,
            "payload.full.link": link,
            "payload.full.at_mm": place,
        }
    )
    other = Reference.load(loaded.save(tmp_path / "loaded.toml"))
    force = other.forces(at.rigid.q, "full")[0]
    push = PRESSURE * other.bore_areas - RETURN * other.annulus_areas
    pull = PRESSURE * other.annulus_areas - RETURN * other.bore_areas
    use = np.where(force > 0, force / push, -force / pull)
    assert use.max() == pytest.approx(0.87, rel=1e-9)
    assert lift_check.slack == pytest.approx(lift_check.value / lift.mass - 1, rel=1e-9)


def test_lift_at_a_place_stands_there() -> None:
    """The reference's tool: reach and height as asked; the bucket as given; of both elbows the one
    that lifts more.
    """
    machine, old = MACHINES["excavator"](), reference()
    at = lift_pose(machine, FRONT, Requirements.of(machine).holding_share)
    (q,) = at.rigid.q
    frames = old.frames(q[None])
    x, z, angle = frames["bucket"]
    tool = machine.tool.at
    assert x[0] + tool[0] * math.cos(angle[0]) - tool[2] * math.sin(angle[0]) == pytest.approx(
        6.0, abs=1e-8
    )
    assert z[0] + tool[0] * math.sin(angle[0]) + tool[2] * math.cos(angle[0]) == pytest.approx(
        1.5, abs=1e-8
    )
    assert q[2] == pytest.approx(-120 * DEG)


def _out_of_reach(machine: Machine, lift: Lift) -> tuple[float, Array]:
    """Distance of the place, and the nearest that works [m], as the refusal has them."""
    with pytest.raises(ArmDesignError, match="out of reach") as refused:
        lift_pose(machine, lift, 0.87)
    numbers = re.findall(
        r"is (\d+) mm out|reach_mm = (\S+), height_mm = (\S+)", str(refused.value)
    )
    (distance, _, _), (_, reach, height) = numbers
    return float(distance) / 1000, np.array([float(reach), float(height)]) / 1000


@pytest.mark.parametrize("place", [(12.0, 2.0), (0.5, -7.0), (-3.0, 12.0), (2.0, 0.5)])
def test_a_place_out_of_reach_by_the_independent_reference(place: tuple[float, float]) -> None:
    """Distance and nearest place of the bucket's tip by the planar reference on a grid of 801²
    poses, whose step is below 12 mm there; the nearest place named works.
    """
    machine, old = MACHINES["excavator"](), reference()
    lift = replace(FRONT, joints={"bucket": 0.3}, reach=place[0], height=place[1])
    distance, nearest = _out_of_reach(machine, lift)
    boom, stick = (np.linspace(*machine.ranges[j], 801) for j in (0, 1))
    q = np.stack([*map(np.ravel, np.meshgrid(boom, stick)), np.full(801**2, 0.3)], axis=1)
    x, z, angle = old.frames(q)["bucket"]
    at = machine.tool.at
    gaps = np.hypot(
        x + at[0] * np.cos(angle) - at[2] * np.sin(angle) - place[0],
        z + at[0] * np.sin(angle) + at[2] * np.cos(angle) - place[1],
    )
    assert gaps.min() - 0.012 < distance < gaps.min() + 0.002
    assert np.hypot(*(nearest - place)) == pytest.approx(distance, abs=0.004)
    at_nearest = replace(lift, reach=float(nearest[0]), height=float(nearest[1]))
    assert len(lift_pose(machine, at_nearest, 0.87).rigid) == 1


def test_poses_beyond_ranges_and_strokes() -> None:
    """A joint that stands beyond its range, beside free ones too; a stroke across two joints."""
    machine = MACHINES["excavator"]()
    beside = replace(FRONT, joints={"bucket": 2.0})
    with pytest.raises(ArmDesignError, match=r"bucket at 114.6°: beyond its range; give"):
        lift_pose(machine, beside, 0.87)
    branched = named("branched")
    corners = np.array(list(itertools.product(*branched.ranges)))
    margins = branched.margins(corners).min(axis=1)
    corner, share = corners[margins.argmin()], -100 * margins.min()
    assert share > 0
    ends = Lift(name="ends", mass=1, joints=dict(zip(branched.joints, corner, strict=True)))
    with pytest.raises(
        ArmDesignError, match=rf"the stroke of the \w+ cylinder by {share:.0f} % of"
    ):
        lift_pose(branched, ends, 0.87)


@pytest.mark.parametrize("command", ["check", "optimize"])
def test_the_line_of_a_lift_out_of_reach(
    command: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """``check`` finds it as the designs do, with the line of its table."""
    machine = named("paper_1dof")
    more = "[requirements.lift.far]\nmass_kg = 9\njoint_deg = { boom = 170 }\n"
    path = Machine.from_text(f"{machine.text}\n{more}", machine.urdf_text, machine.source).save(
        tmp_path / "x.toml"
    )
    line = path.read_text(encoding="utf-8").splitlines().index("[requirements.lift.far]") + 1
    assert main([command, str(path), "--out", str(tmp_path / "out")], monkeypatch) == 2
    err = capfd.readouterr().err
    assert_one_line(err.replace("\r", ""), "x.toml: requirements.lift.far: ")
    assert "beyond its range; give boom in [" in err
    assert err.strip().endswith(f"(line {line})")
