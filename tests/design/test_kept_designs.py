"""Refusals in a journal: found once, they come back whole without a search."""

from __future__ import annotations

from pathlib import Path

import pytest

import armdesign as ad
from armdesign.design import optimize
from armdesign.journal.finished import keeping
from tests.design.designs import MACHINES, any_lift_and_torque, workspace_of


def refusal() -> ad.InfeasibleError:
    requirements = any_lift_and_torque("single").with_setting("oil_total_share", 0.05)
    with pytest.raises(ad.InfeasibleError) as error:
        ad.size_cylinders(MACHINES["single"](), workspace_of("single"), requirements)
    return error.value


def test_a_refusal_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With all that is said of it, and its amounts as numbers."""
    found: list[ad.InfeasibleError] = []

    def interrupted() -> None:
        with keeping(tmp_path / "j.sqlite"):
            found.append(refusal())
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    (first,) = found

    def no_search(*_: object) -> None:
        raise AssertionError("searched again")

    monkeypatch.setattr(optimize, "design_or_proof", no_search)
    with keeping(tmp_path / "j.sqlite") as pieces:
        again = refusal()
        assert pieces.answered == 1
    assert type(again) is type(first)
    assert str(again) == str(first)
    assert vars(again) == vars(first)
    assert again.conflict
    assert all(concession.together > 0 for concession in again.conflict)
