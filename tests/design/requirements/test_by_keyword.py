"""Requirements by keyword equal what a file reads that says the same."""

from __future__ import annotations

from typing import Any

import pytest

import armdesign as ad


@pytest.mark.parametrize("value", ["x", True, None, [0.9], {"boom": "x"}, object()])
def test_a_share_is_a_number(value: Any) -> None:
    with pytest.raises(ad.ArmDesignError, match=r"requirements.lift_share: .* give a number"):
        ad.Requirements(lift_share=value)


def test_a_keyword_is_the_key_of_the_file() -> None:
    machine = ad.load("paper_1dof")
    today = ad.Requirements.of(machine)
    changed = ad.Requirements.of(machine, lift_share=0.95, holding_share={"lift": 0.7})
    assert today.lift_share != 0.95
    assert changed.lift_share == 0.95
    assert changed.holding_share["lift"] == 0.7
    assert changed.end_margin == today.end_margin


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ({"lft_share": 0.9}, 'requirements.lft_share: unknown key; did you mean "lift_share"?'),
        ({"end_margin": 0.7}, r"requirements.end_margin: 0.7 is not allowed; .* \[0, 0.5\)"),
        ({"holding_share": {"lft": 0.7}}, 'no actuator "lft"; did you mean "lift"?'),
    ],
)
def test_what_the_file_cannot_have_is_one_line(given: dict[str, object], line: str) -> None:
    with pytest.raises(ad.ArmDesignError, match=line.replace("?", r"\?")) as error:
        ad.Requirements.of(ad.load("paper_1dof"), **given)
    assert "\n" not in str(error.value)
