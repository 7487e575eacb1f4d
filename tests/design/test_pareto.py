"""Trade-offs: looser limits are never worse, every point is the best of its own problem, what
cannot be is said.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import armdesign as ad
from armdesign import plots
from armdesign.design.catalogue.sizes import sizes_of
from armdesign.design.pareto import SHARES, limited
from armdesign.errors import Stopped
from armdesign.report.trade_offs import pareto_sheet
from armdesign.sweeps import trade_offs
from armdesign.units import mm
from tests import machines
from tests.design.catalogue.enumeration import enumerated
from tests.design.designs import MACHINES, any_lift_and_torque, workspace_of


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "against", "vary"),
    [
        ("double", "oil", ("areas",)),
        ("double", "thrust", ("areas", "pins")),
        ("double", "pin_box", ("areas", "pins")),
        ("excavator", "oil", ("areas", "pins")),
        ("excavator", "digging", ("areas", "pins")),
        ("excavator", "pin_box", ("areas", "pins")),
    ],
)
def test_a_looser_limit_is_never_worse(name: str, against: str, vary: tuple[str, ...]) -> None:
    """Before rounding, to the tolerance of the searches; after it every machine keeps its
    limit.
    """
    machine, kept = MACHINES[name](), any_lift_and_torque(name)
    front = ad.pareto(machine, workspace_of(name), kept, against=against, vary=vary, starts=1)
    assert len(front.designs) >= 3
    unrounded = [design.unrounded for design in front.designs]
    assert np.all(np.diff(unrounded) >= -1e-5 * unrounded[-1])
    assert unrounded[-1] > 1.02 * unrounded[0]
    assert all(slack >= -1e-9 for design in front.designs for slack in design.slacks.values())
    frame = front.frame
    kept = {
        "oil": frame["oil_share"] <= frame["limit"],
        "thrust": frame["thrust_share"] <= frame["limit"],
        "digging": (
            frame["digging_share"] >= frame["limit"] - 1e-9 if against == "digging" else None
        ),
        "pin_box": frame["pin_move_m"] <= frame["limit"] + 1e-9,
    }[against]
    assert kept is not None
    assert kept.all()


def test_each_point_is_the_optimum_of_its_own_problem() -> None:
    """Areas alone of one cylinder have one optimum: found from the neighbour as from today's
    machine.
    """
    machine, workspace = MACHINES["single"](), workspace_of("single")
    kept, values = any_lift_and_torque("single"), (1.05, 0.7, 0.85)
    front = ad.pareto(machine, workspace, kept, against="oil", values=values, vary=("areas",))
    assert front.limits == (0.7, 0.85, 1.05)
    for limit, design in zip(front.limits, front.designs, strict=True):
        requirements = replace(kept, oil_total_share=limit, oil_each_share=1.1 * limit)
        assert design.requirements == requirements
        alone = ad.optimize(machine, workspace, requirements, vary=("areas",))
        assert design.unrounded == pytest.approx(alone.unrounded, rel=1e-4)


def test_points_of_a_catalogue() -> None:
    """With given pins the best of all combinations under each limit, as enumerated; one limit
    alone has none.
    """
    machine, workspace = MACHINES["double"](), workspace_of("double")
    sizes = [(bore * mm, rod * mm) for bore in (90, 95, 100, 105) for rod in (63, 66)]
    kept, values = any_lift_and_torque("double"), (0.5, 0.9, 1.0, 1.1)
    front = ad.pareto(machine, workspace, kept, values=values, vary=("areas",), catalogue=sizes)
    assert front.limits == (0.9, 1.0, 1.1)
    assert "no sizes of the catalogue meet" in front.left_out[0.5]
    for design in front.designs:
        assert design.unrounded == pytest.approx(
            enumerated(machine, workspace, design.requirements, sizes), rel=1e-9
        )


@pytest.mark.slow
def test_points_of_a_catalogue_with_pins() -> None:
    """Each starts with its tighter neighbour's sizes and pins too, so it cannot be worse."""
    machine, workspace = MACHINES["double"](), workspace_of("double")
    kept, values = any_lift_and_torque("double"), (1.0, 1.15, 1.3)
    front = ad.pareto(
        machine, workspace, kept, against="thrust", values=values, starts=1, catalogue="5mm"
    )
    unrounded = [design.unrounded for design in front.designs]
    assert np.all(np.diff(unrounded) >= -1e-5 * unrounded[-1])
    assert unrounded[-1] > 1.01 * unrounded[0]
    offered = set(sizes_of("5mm"))
    for design in front.designs:
        assert {(round(c.bore, 6), round(c.rod, 6)) for c in design.machine.cylinders} <= offered
        assert min(design.slacks.values()) >= -1e-9


def test_shares_and_boxes_of_their_own_stay() -> None:
    """A file that holds one cylinder's thrust holds it in every row."""
    own = {"default": 1.5, "b": 1.0}
    kept = ad.Requirements(thrust_share=own, oil_each_share=own, lift_share=own)
    for against, name, common in (
        ("thrust", "thrust_share", 1.2),
        ("oil", "oil_each_share", pytest.approx(1.32)),
        ("lift", "lift_share", 1.2),
    ):
        assert getattr(limited(kept, against, 1.2), name) == {"default": common, "b": 1.0}
    assert limited(ad.Requirements(), "thrust", 1.2).thrust_share == 1.2


def test_limits_that_no_design_meets_are_left_out_and_said() -> None:
    """On a twentieth of its oil the lift cylinder, at 1.1 × its thrust at most, cannot hold the
    arm.
    """
    machine, kept = MACHINES["single"](), any_lift_and_torque("single")
    front = ad.pareto(machine, workspace_of("single"), kept, values=(0.05, 1.0), vary=("areas",))
    assert front.limits == (1.0,)
    assert set(front.left_out) == {0.05}
    assert front.sentences[0].startswith("oil 0.05 is left out: no design meets ")
    assert "oil.cap" in front.sentences[0]
    # on how much, as well as on what
    assert re.search(r": relax .*oil\.cap\S* by [\d.]+ l \(\d+ %\)", front.sentences[0])


def test_no_value_that_can_be_met() -> None:
    """It says what to relax, as the search for one value does."""
    words = r"no value of oil can be met; no design meets .*; relax .* = "
    with pytest.raises(ad.ArmDesignError, match=words):
        ad.pareto(MACHINES["single"](), workspace_of("single"), values=(0.05,), vary=("areas",))


def test_the_plot_shows_today_and_every_design(tmp_path: Path) -> None:
    front = ad.pareto(
        MACHINES["single"](), workspace_of("single"), values=(1.0, 1.2), vary=("areas",)
    )
    ax = front.plot()
    lines = {line.get_label(): line.get_xydata() for line in ax.lines}
    assert (
        lines["best design"].tolist() == front.frame[["limit", "frequency_hz"]].to_numpy().tolist()
    )
    before = front.designs[0].before.worst.frequency
    assert lines["today's machine"].tolist() == [[1.0, before]]
    as_today = lines["frequency² × joint speed as today"][-1]
    assert as_today == pytest.approx([1.2, 1.2**0.5 * before])
    gains = [f"{100 * gain:+.1f} %" for gain in front.frame["gain"]]
    assert [text.get_text() for text in ax.texts] == gains
    assert ax.get_ylim()[0] > 0.5 * before, "an axis from zero hides what a limit costs"
    assert plots.save(ax.figure, tmp_path / "pareto.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"against": "oill"}, r"against: 'oill' is not allowed; did you mean \"oil\"\?"),
        (
            {"against": "digging"},
            r"against: no cylinder's digging force counts; name some in requirements\.digging",
        ),
        ({"values": ()}, r"values: \[\] is not allowed; give finite numbers ≥ 0"),
        (
            {"values": (1.0, float("nan"))},
            r"values: \[1\.0, nan\] is not allowed; give finite numbers ≥ 0",
        ),
        ({"values": (-1.0,)}, r"values: \[-1\.0\] is not allowed; give finite numbers ≥ 0"),
        ({"values": ("a",)}, r"values: \['a'\] is not allowed; give finite numbers ≥ 0"),
        ({"values": iter("a")}, r"values: \['a'\] is not allowed; give finite numbers ≥ 0"),
        ({"values": [10**400]}, r"values: \[10{40,}…\] is not allowed; give finite numbers ≥ 0"),
    ],
)
def test_bad_questions(settings: dict[str, object], message: str) -> None:
    with pytest.raises(ad.ArmDesignError, match=message):
        ad.pareto(MACHINES["single"](), workspace_of("single"), **settings)  # type: ignore[arg-type]


def test_a_start_is_a_design_of_the_same_machine() -> None:
    design = ad.size_cylinders(MACHINES["single"](), workspace_of("single"))
    with pytest.raises(
        ad.ArmDesignError, match=r"start: is a design of odd, not of excavator_20t"
    ):
        ad.optimize(machines.named("excavator_20t"), start=design)


@pytest.mark.slow
def test_against_lift() -> None:
    """Every design keeps the lift that its limit asks for; less lift buys no less frequency."""
    front = ad.pareto(
        MACHINES["double"](), workspace_of("double"), against="lift", values=(1.0, 0.8), starts=1
    )
    assert front.limits == (1.0, 0.8)
    assert (front.frame["lift_share"] >= np.array(front.limits) - 1e-9).all()
    assert [design.requirements.lift_share for design in front.designs] == [1.0, 0.8]
    assert front.designs[1].unrounded >= front.designs[0].unrounded * (1 - 1e-6)
    sheet = pareto_sheet(front)
    column = sheet.columns.index("lift")
    assert [row[column] for row in sheet.rows] == [
        "",
        *(f"{x:.3f}" for x in front.frame["lift_share"]),
    ]
    assert "least lift of all points of the lift chart" in (sheet.note or "")


def test_pin_moves_are_of_the_machine_as_built() -> None:
    """The largest change of a pin's coordinate between the two files: whole millimetres where
    sizes come from a catalogue.
    """
    machine = MACHINES["single"]()
    front = ad.pareto(
        machine, workspace_of("single"), against="thrust", values=(1.1,), starts=1, catalogue="5mm"
    )
    pins = [
        np.array([pin.at for pin in one.linkages[0].pins])
        for one in (front.designs[0].machine, machine)
    ]
    (move,) = front.frame["pin_move_m"]
    assert move == pytest.approx(np.abs(pins[0] - pins[1]).max(), abs=1e-12)
    assert move > 0.01
    assert front.frame["pin_move_m"][0] * 1000 == pytest.approx(round(1000 * move), abs=1e-6)


def test_against_digging_its_cylinders_may_lose_torque() -> None:
    """Of the cylinder that digs as much torque as the limit says, of the other what is stated."""
    machine = MACHINES["double"]()
    requirements = replace(ad.Requirements.of(machine), digging=("fold",), lift_share=0.0)
    front = ad.pareto(
        machine, workspace_of("double"), requirements,
        against="digging", values=(1.0, 0.8), vary=("areas",),
    )  # fmt: skip
    torque_shares = [design.requirements.torque_share for design in front.designs]
    assert torque_shares == [{"default": 0.95, "fold": 0.95}, {"default": 0.95, "fold": 0.8}]
    for design, limit, printed in zip(
        front.designs, front.limits, front.frame["digging_share"], strict=True
    ):
        lift, fold = (
            new.bore_area / old.bore_area
            for new, old in zip(design.machine.cylinders, machine.cylinders, strict=True)
        )
        assert printed == pytest.approx(fold, rel=1e-9)
        assert fold >= limit - 1e-9
        assert lift >= 0.95 - 1e-9
    assert front.frame["digging_share"].iloc[-1] < 0.95
    assert front.designs[1].unrounded > front.designs[0].unrounded


def test_default_values_run_from_tight_to_loose() -> None:
    for against, shares in SHARES.items():
        assert list(shares) == sorted(shares, reverse=against in ("digging", "lift"))


def areas_front(**how: Any) -> ad.Pareto:
    machine, kept = MACHINES["single"](), any_lift_and_torque("single")
    values = (0.7, 0.85, 1.05)
    return ad.pareto(machine, workspace_of("single"), kept, values=values, vary=("areas",), **how)


@pytest.mark.slow
def test_processes_share_the_points_of_equal_designs() -> None:
    one, two = areas_front(), areas_front(workers=2)
    pd.testing.assert_frame_equal(one.frame, two.frame, check_exact=True)


def test_a_point_that_is_worse_than_its_neighbour_starts_from_its_design(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Starts of their own that lead nowhere: today's machine itself counts for them."""
    real, starts = trade_offs.best_frequency, []

    def worse(*words: Any) -> ad.Design:
        *same, requirements, options = words
        starts.append(options.start and options.start.unrounded)
        if options.start is None and requirements.oil_total_share > 0.7:
            return replace(real(*same, requirements, options), unrounded=0.1)
        return real(*same, requirements, options)

    undisturbed = areas_front().frame["unrounded_hz"]
    monkeypatch.setattr(trade_offs, "best_frequency", worse)
    front = areas_front()
    assert front.frame["unrounded_hz"].to_list() == pytest.approx(undisturbed.to_list(), rel=1e-5)
    assert starts == [None, None, None, *(d.unrounded for d in front.designs[:2])]


def test_ctrl_c_before_the_first_point(monkeypatch: pytest.MonkeyPatch) -> None:
    """No front is made of nothing."""

    def interrupted(*_: Any) -> ad.Design:
        raise KeyboardInterrupt

    monkeypatch.setattr(trade_offs, "best_frequency", interrupted)
    with pytest.raises(KeyboardInterrupt) as stop:
        areas_front()
    assert not isinstance(stop.value, Stopped)
