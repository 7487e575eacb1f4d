"""Sheets and sentences of designs: what buildability costs, the least amount, bandwidths."""

from __future__ import annotations

import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import armdesign as ad
from armdesign.report.design_report import bandwidth_rows, bandwidth_section
from armdesign.report.designs import design_sheets, summary
from armdesign.report.least import least_sentence
from armdesign.report.maps import too_few_poses
from armdesign.units import WORKSHOP, percent
from tests import machines
from tests.design.designs import MACHINES, workspace_of

BANDS = ad.Bands(structure=(0.0, 1.0))


def test_there_is_no_gain_over_an_unstable_machine() -> None:
    """A digger on oil so soft that gravity overcomes it, and its stable design."""
    machine = machines.rigid("mini_excavator_2t").replace({"fluid.bulk_modulus_MPa": 9.0})
    design = ad.size_cylinders(machine, ad.Workspace.grid(machine, points=3))
    today, new, gain = design_sheets(design)[0].rows
    assert (today[1], gain[1]) == ("0.000 Hz (unstable)", "–")
    assert new[1] == f"{design.after.worst.frequency:.3f} Hz"
    assert f"from 0.000 Hz (unstable) to {new[1]} with the same" in summary(design)
    texts = [summary(design), *(sheet.note for sheet in design_sheets(design)), repr(design)]
    assert not any("inf" in text for text in texts)


@pytest.mark.slow
@pytest.mark.parametrize("catalogue", ["5mm", "free"])
def test_what_buildability_costs(catalogue: str) -> None:
    """The gain of the machine as written beside the best start's, before any steps."""
    machine, space = MACHINES["double"](), workspace_of("double")
    design = ad.optimize(machine, space, catalogue=catalogue, starts=1, bands=BANDS)
    gains = re.findall(
        r"buildable ([+-][\d.]+) %, in real numbers ([+-][\d.]+) %", design_sheets(design)[0].note
    )
    if catalogue == "free":
        assert not gains
        return
    ((built, real),) = gains
    today = design.problem.dynamics.corners.nominal
    assert float(built) == pytest.approx(100 * (design.judged / today - 1), abs=0.05)
    assert float(real) == pytest.approx(100 * (design.starts[0] / today - 1), abs=0.05)
    assert float(built) < float(real)


@pytest.mark.parametrize(
    ("name", "bands", "where"),
    [
        ("double", BANDS, ""),
        ("yielding", ad.Bands(structure=(0.0, 0.0), link_mass=(3.0, 3.0)), "at the file's values"),
        (
            "odd",
            ad.Bands(
                bulk_modulus=(0.5, 1.2),
                dead_volume=(0.2, 3.0),
                air=(0.0, 0.05),
                structure=(0.0, 1.0),
                payload=(0.8, 1.2),
                link_mass=(0.9, 1.1),
            ),
            "elsewhere than at the corners that it was designed for",
        ),
    ],
)
def test_a_least_gain_that_the_search_did_not_see_stands_beside_that_at_the_corners(
    name: str, bands: ad.Bands, where: str
) -> None:
    """The search, its starts and its bound know the gains at the corners of the bands alone."""
    machine, space = MACHINES[name](), workspace_of(name)
    design = ad.size_cylinders(machine, space, bands=bands)
    first, banded = design_sheets(design)[:2]
    today = {one.corner: one.frequency for one in design.band_before.scenarios}
    new = {one.corner: one.frequency for one in design.band_after.scenarios}
    known = percent(min(new[corner] / today[corner] for corner in new) - 1)
    assert (known != percent(design.least_gain)) == bool(where)
    words = f", {where}; at the corners {known}" if where else ""
    assert banded.note.endswith(
        f"; least gain within the bands {percent(design.least_gain)}{words}"
    )
    assert "made for the least gain at the corners of the bands, of the poses: " in first.note


@pytest.mark.slow
@pytest.mark.parametrize(("points", "poses"), [(5, 5), (60, 24)])
def test_bandwidths_are_the_worst_and_median_of_some_poses(points: int, poses: int) -> None:
    """All poses where they are few, as a bandwidth map has them; else also the lowest of both."""
    machine = ad.load("paper_1dof")
    leaking = machine.replace({"cylinder.lift.valve.leakage_l_per_min_per_bar": 0.01})
    workspace = ad.Workspace.grid(leaking, points)
    design = ad.size_cylinders(leaking, workspace, ad.Requirements(oil_total_share=1.05))
    maps = [design.before, design.after]
    rows = bandwidth_rows(maps)
    assert poses <= len(rows) <= poses + 2
    for one in maps:
        lowest = one.frame["boom"][one.frame["f1_hz"].argmin()]
        assert lowest in workspace.q[rows, 0]
    section = bandwidth_section(design, WORKSHOP)
    assert f"of {len(rows)} of the workspace's {points} poses" in section.words[0]
    table = {row[0]: row[1:3] for row in section.sheets[0].rows}
    for label, one in zip(("today", "new"), maps, strict=True):
        frame = ad.bandwidth_map(one.machine, workspace.subset(rows)).frame
        words = table[f"{label}: + pressure feedback, own gains"]
        assert words == (f"{frame['own_hz'].min():.3g}", f"{frame['own_hz'].median():.3g}")


def test_lift_that_no_place_of_the_chart_holds_is_said() -> None:
    """A tool at its pivot reaches no place: `lift_share` asked for nothing, without a word."""
    machine = ad.load("paper_1dof").replace({"tool.at_mm": [0, 0, 0]})
    design = ad.size_cylinders(machine, ad.Workspace.grid(machine, points=3))
    assert not any(check.name.startswith("lift_share") for check in design.checks)
    assert ", its lift is held nowhere, as the lift chart has no place; " in summary(design)


OTHERS_NEED_IT = ": other requirements, or rounding to steps of sizes, ask for that much"


def test_the_least_oil_of_a_small_machine_has_three_digits() -> None:
    machine = ad.load("paper_1dof")
    space = ad.Workspace.grid(machine, points=3)
    design = ad.least(machine, space, frequency=7.2, vary=["areas"], starts=1)
    (today, new) = (
        1000 * sum(c.bore_area * c.stroke for c in one.cylinders)
        for one in (design.today, design.machine)
    )
    assert least_sentence(design, "oil", 7.2).startswith(
        f"Oil of all cap sides: {today:.3f} → {new:.3f} l ("
    )


@pytest.mark.parametrize(
    ("rows", "bands", "asked", "needs"),
    [
        ([1], "", 9.0, OTHERS_NEED_IT),  # 10.1 Hz for all that is less
        ([0, 2], "", 7.4, ""),
        ([1], " within the bands", 9.0, OTHERS_NEED_IT),
        ([1], " within the bands", 9.3, ""),
    ],
)
def test_the_frequency_asked_for_is_that_of_the_poses(
    rows: list[int], bands: str, asked: float, needs: str
) -> None:
    """The worst, at the end of the range, is said too: it may be less than what was asked for.

    More than was asked for was told as what was.
    """
    machine = ad.load("paper_1dof")
    space = ad.Workspace.grid(machine, points=3).subset(np.array(rows))
    payload = ad.Bands(payload=(0.8, 1.2)) if bands else ad.Bands()
    design = ad.least(machine, space, frequency=asked, vary=["areas"], starts=1, bands=payload)
    worst, judged = design.after.worst.frequency, design.judged
    assert judged >= asked
    lowest = design.band_after.low.frequency if bands else design.after.lowest.min()
    assert judged == pytest.approx(lowest)
    assert (worst < asked) == (rows == [1])
    said = f"; lowest of the poses{bands}: {judged:.3f} Hz" if rows == [1] else ""
    ending = f"→ {worst:.3f} Hz{said}, {asked:g} Hz asked for{needs}."
    assert least_sentence(design, "oil", asked).endswith(ending)


@pytest.mark.parametrize(
    ("new", "words"),
    [(1.00, "where it gained +20.0 %: with more --points"), (0.9, "+20.0 %"), (1.11, "")],
)
def test_what_is_lost_between_few_poses_is_said(new: float, words: str) -> None:
    def found(worst: float, lowest: float) -> Any:
        return SimpleNamespace(
            worst=SimpleNamespace(frequency=worst), lowest=np.array([lowest, 2])
        )

    note = too_few_poses(found(1.0, 1.1), found(new, 1.32))
    assert words in note
    assert bool(words) == bool(note)
    assert too_few_poses(found(0.0, 0.0), found(new, 1.32)) == ""
