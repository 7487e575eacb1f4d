"""Requirements judged on machines of one drawing: against the check of machines built one by one,
a share known by hand, and links made heavier in the URDF.
"""

from __future__ import annotations

import re

import numpy as np
import pytest

import armdesign as ad
from armdesign.design.requirements.check import check
from armdesign.influence.acceptance import JUDGED, acceptance_sheet
from armdesign.influence.family import rebuilt
from armdesign.units import WORKSHOP
from tests import machines


def toleranced(machine: ad.Machine, widths: str, requirements: str = "") -> ad.Machine:
    text = machine.text.split("\n[tolerances]")[0]  # it stands last in shipped files
    text = f"{text}\n{requirements}\n[tolerances]\n{widths}"
    return ad.Machine.from_text(text, machine.urdf_text, machine.source)


def test_each_machine_is_judged_as_the_check_judges_its_file() -> None:
    """All requirements, on the files of three machines; loads over their whole workspace."""
    widths = (
        'pin_mm = 1\nbar_mm = 0.5\npayload_percent = 10\nkeys = { "cylinder.boom.bore_mm" = 2 }'
    )
    machine = toleranced(machines.named("excavator_20t"), widths)
    workspace = ad.Workspace.grid(machine, points=5)
    answer = ad.tolerances(machine, workspace, count=16)
    judged = answer.acceptance
    assert len(judged.slacks) == 16
    requirements = ad.Requirements.of(machine)
    for row in (0, 7, 15):
        pairs = zip(answer.widths, answer.values[row], strict=True)
        other = rebuilt(machine, {width.number.location: float(v) for width, v in pairs})
        every = {c.name: c.slack for c in check(other, machine, workspace, requirements)}
        for drawn, slack in zip(judged.drawn[1:], judged.slacks[row, 1:], strict=True):
            loads = drawn.name.startswith("holding")  # their largest may be at another pose
            within = {"abs": 1e-3} if loads else {"rel": 1e-9, "abs": 1e-12}
            assert slack == pytest.approx(every[drawn.name], **within), drawn.name


def test_a_share_known_by_hand() -> None:
    """Bores even within ± 1 mm of 50 mm, thrust as of at most 50.5 mm: a quarter is too strong.

    The whole oil may be no more than the drawing's, which half of the machines miss: not counted.
    """
    machine = machines.named("paper_1dof")
    bore = 1e3 * machine.cylinders[0].bore
    machine = toleranced(machine, 'keys = { "cylinder.lift.bore_mm" = 1 }')
    machine = machine.replace({"requirements.thrust_share": ((bore + 0.5) / bore) ** 2})
    answer = ad.tolerances(machine, ad.Workspace.grid(machine, points=5), count=1024)
    judged = answer.acceptance
    assert len(judged.slacks) == JUDGED
    assert judged.share == pytest.approx(0.75, abs=1 / JUDGED)
    by_name = judged.frame.set_index("name")
    assert by_name["missed"]["thrust.lift"] == pytest.approx(0.25, abs=1 / JUDGED)
    assert judged.frame["name"][0] == "thrust.lift"  # missed most often
    assert by_name["missed"]["oil.cap.total"] == pytest.approx(0.5, abs=1 / JUDGED)
    assert not by_name["counted"][["oil.cap.total", "frequency"]].any()
    sheet = acceptance_sheet(judged, WORKSHOP)
    assert sheet.title.startswith("Every requirement that counts is met by 75.0 % ± 2.7 % of")
    assert "least margin: over the limit, of pins within an outline over its longer" in sheet.note
    left_out = sheet.note.split("exactly at the limit: ")[1].split(";")[0].split(", ")
    assert {"worst frequency", "oil of all cap sides"} <= set(left_out)
    assert len(left_out) == np.count_nonzero(~judged.counted)


def test_the_frequency_counts_where_it_is_stated() -> None:
    machine = toleranced(machines.named("paper_1dof"), "pin_mm = 1\npayload_percent = 10")
    workspace = ad.Workspace.grid(machine, points=5)
    drawn = ad.tolerances(machine, workspace, count=64)
    least = float(np.percentile(drawn.frequencies, 25))
    stated = ad.tolerances(machine, workspace, count=64, least=least)
    assert stated.acceptance.drawn[0].name == "frequency"
    assert stated.acceptance.missed[0] == pytest.approx(0.25, abs=1 / 64)
    assert stated.acceptance.share == pytest.approx(0.75, abs=1 / 64)
    assert drawn.acceptance.share == 1.0


def test_heavier_links_load_more_and_lift_less() -> None:
    """Against a URDF whose links all weigh as the machine's: its loads, and what it could lift."""
    machine = machines.named("excavator_20t")
    lift = (
        "[requirements.lift.far]\nmass_kg = 1\njoint_deg = { boom = 10, stick = -40, bucket = 0 }"
    )
    machine = toleranced(machine, "link_mass_percent = 5", lift)
    answer = ad.tolerances(machine, ad.Workspace.grid(machine, points=5), count=16)
    shares = dict(zip(machine.joints, answer.values[3].tolist(), strict=True))
    number = r'(mass value|i[xyz]{2})="([^"]*)"'

    def heavier(link: re.Match[str]) -> str:
        share = shares.get(link[1], 1.0)
        return re.sub(number, lambda m: f'{m[1]}="{share * float(m[2])!r}"', link[0])

    urdf = re.sub(r'(?s)<link name="(\w+)">.*?</link>', heavier, machine.urdf_text)
    other = ad.Machine.from_text(machine.text, urdf, machine.source)
    workspace = ad.Workspace.grid(other, points=5)
    checks = check(other, other, workspace, ad.Requirements.of(other))
    judged = answer.acceptance
    slacks = dict(zip((c.name for c in judged.drawn), judged.slacks[3].tolist(), strict=True))
    drawn = {c.name: c.slack for c in judged.drawn}
    for expected in checks:
        if expected.name.startswith(("lift.", "holding")):
            assert slacks[expected.name] == pytest.approx(expected.slack, rel=1e-9)
            assert slacks[expected.name] != drawn[expected.name]
    assert slacks["lift_share.boom"] != drawn["lift_share.boom"]
