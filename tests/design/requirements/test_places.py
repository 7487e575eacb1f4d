"""Outlines and clearances: by hand, and against the independent planar reference."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import armdesign as ad
from armdesign import ArmDesignError, Machine, Requirements, Workspace
from armdesign.design.requirements.check import check
from armdesign.design.requirements.places import Outline
from armdesign.hydraulics.cylinder_build import barrel_ratio
from armdesign.inspection.inspection import inspect
from armdesign.report.inspections import check_sheets
from tests.design.designs import MACHINES, workspace_of
from tests.design.requirements.shared import EVERYTHING, PRESSURE, STICK_PLATE, own, reference
from tests.machines import named


def test_pins_within_the_outline() -> None:
    """Stick base pin at (3416.5, 1147.5) on the boom: 152.5 mm below a lid at 1300, in a box; the
    other pin by hand.
    """
    box = ((0.0, 0.0), (5.0, 0.0), (5.0, 1.3), (0.0, 1.3))
    checks = own(outlines=(Outline(link="boom", points=box, pin_radius=0.16),))
    assert {n for n in checks if n.startswith("outline")} == {
        "outline.boom.rod_end",
        "outline.stick.base",
    }
    assert checks["outline.stick.base"].value == pytest.approx(0.1525, rel=1e-12)
    assert checks["outline.stick.base"].slack == pytest.approx((0.1525 - 0.16) / 5.0, rel=1e-9)
    assert checks["outline.boom.rod_end"].value == pytest.approx(1.3 - 0.9505, rel=1e-12)


@pytest.mark.parametrize(
    ("lid", "radius", "words"),
    [
        (1.1, 0.0, "is 47.5 mm outside it, pin_radius_mm is 0; .* out by 47.5 mm$"),
        (1.2, 0.11, "is 52.5 mm within it, pin_radius_mm is 110; .* out by 57.5 mm or lower"),
    ],
)
def test_an_outline_must_hold_todays_pins(lid: float, radius: float, words: str) -> None:
    """Stick base pin at z = 1147.5 in the boom, under lids at 1100 and 1200."""
    machine = MACHINES["excavator"]()
    box = ((-1.0, -1.0), (6.0, -1.0), (6.0, lid), (-1.0, lid))
    requirements = Requirements(outlines=(Outline(link="boom", points=box, pin_radius=radius),))
    message = (
        r"requirements.outline.boom: does not hold today's base pin of the stick cylinder at x"
        rf" 3416.5, z 1147.5 mm: it {words}"
    )
    with pytest.raises(ArmDesignError, match=message):
        ad.optimize(machine, workspace_of("excavator"), requirements, starts=1)


def test_every_pin_outside_an_outline_is_told() -> None:
    box = ((-1.0, -1.0), (6.0, -1.0), (6.0, 0.9), (-1.0, 0.9))  # lids at 900 mm, pins at 950.5
    requirements = Requirements(outlines=(Outline(link="boom", points=box),))
    with pytest.raises(
        ArmDesignError, match=r"rod_end pin of the boom .*; also: .* base pin of t"
    ):
        ad.optimize(MACHINES["excavator"](), None, requirements, starts=1)


def test_clearance_against_the_reference() -> None:
    """Stick barrel from a plate on the stick: points along it against points along the plate's
    edges, at 241 poses by
    the reference; 6 mm for all three samplings."""
    old, checks = reference(), own(clearances=EVERYTHING["clearances"])
    stick = old.cylinders[1]
    q = old.along(1, np.linspace(*old.ranges[1], 241))
    frames = old.frames(q)
    base = np.stack([frames["boom"][0], frames["boom"][1]]) + _turn(
        frames["boom"][2], stick.base.x, stick.base.z
    )
    end = np.stack([frames["stick"][0], frames["stick"][1]]) + _turn(
        frames["stick"][2], stick.rod_end.x, stick.rod_end.z
    )
    origin, angle = np.stack([frames["stick"][0], frames["stick"][1]]), frames["stick"][2]
    seen = [np.stack(_turn_back(angle, *(point - origin))) for point in (base, end)]
    along = (seen[1] - seen[0]) / np.linalg.norm(seen[1] - seen[0], axis=0)
    bars = seen[0][..., None] + along[..., None] * np.linspace(0, (1.8 + 1.504) / 2, 400)
    corners = np.array([*STICK_PLATE, STICK_PLATE[0]])
    edge = np.concatenate(
        [a + np.linspace(0, 1, 1200)[:, None] * (b - a) for a, b in pairwise(corners)]
    )
    least = min(
        np.linalg.norm(bar.T[:, None] - edge[None, ::8], axis=2).min()
        for bar in bars.transpose(1, 0, 2)
    )
    radius = 0.14 * barrel_ratio(PRESSURE) / 2
    assert checks["clearance.plate.stick"].value == pytest.approx(least - radius, abs=6e-3)
    assert checks["clearance.plate.stick"].limit == 0.15


def _turn(angle: np.ndarray, x: float, z: float) -> np.ndarray:
    return np.stack([x * np.cos(angle) - z * np.sin(angle), x * np.sin(angle) + z * np.cos(angle)])


def _turn_back(angle: np.ndarray, x: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return x * np.cos(angle) + z * np.sin(angle), -x * np.sin(angle) + z * np.cos(angle)


def test_an_outline_whose_edges_cross_is_refused() -> None:
    bow = ((-0.5, -0.5), (0.5, 0.5), (0.5, -0.5), (-0.5, 0.5))
    with pytest.raises(ad.ArmDesignError, match=r"outline\.boom: its edges cross; give its corn"):
        ad.Requirements(outlines=(Outline(link="boom", points=bow, pin_radius=0.0),))
    with pytest.raises(ad.ArmDesignError, match=r"^requirements\.clearance\.plate: its edges cro"):
        ad.Requirements(clearances=(replace(EVERYTHING["clearances"][0], points=bow),))
    machine, bow = ad.load("excavator_20t"), [[-500, -500], [500, 500], [500, -500], [-500, 500]]
    with pytest.raises(ad.ArmDesignError, match=r"outline\.stick\.points_mm: its edges cross"):
        machine.replace({"requirements.outline.stick.points_mm": bow})


def test_check_says_a_barrel_that_is_too_near_today() -> None:
    """1 m more than today's least distance is asked of the boom's barrel: the remark gives both;
    of what is kept today none. An outline of the file is refused with its line.
    """
    today = named("excavator_20t")
    space = Workspace.grid(today, points=3)
    checks = {one.name: one for one in check(today, today, space, Requirements.of(today))}
    least = checks["clearance.frame.boom"].value

    def remarks(machine: Machine) -> dict[str, str]:
        sheets = check_sheets(inspect(machine, Workspace.grid(machine, points=3)))
        return {row[0]: row[1] for row in sheets[-1].rows if row[0].startswith("requirements.")}

    assert remarks(today) == {}
    wanted = 1000 * (least + 1)
    asked = today.replace({"requirements.clearance.frame.distance_mm": wanted})
    words = remarks(asked)["requirements.clearance.frame.distance_mm"]
    assert f"{1000 * least:.1f} mm today, at least {wanted:.1f} mm asked" in words
    small = today.replace({"requirements.outline.boom.pin_radius_mm": 900.0})
    with pytest.raises(ArmDesignError, match=r"toml: requirements.outline.boom: .*\(line \d+\)"):
        ad.optimize(small, Workspace.grid(small, points=2))
    assert "until then designs are refused" in remarks(small)["requirements.outline.boom"]
