"""The record of a requirement in words."""

from __future__ import annotations

from dataclasses import replace

from armdesign.design.requirements.record import Check
from armdesign.units import WORKSHOP


def test_sentence() -> None:
    held = Check(
        name="speed.up", value=0.00715, limit=0.00715, unit="m³/s", slack=0.0, words="flow of up"
    )
    words = (
        "flow of up (speed.up) binds: it is 429 l/min, at most 429 l/min is allowed; "
        "relaxed by 1 % the frequency rises by 0.8 %"
    )
    assert held.sentence(0.00801, 0.00802, WORKSHOP) == words
    assert (
        held.sentence(0.00801, 0.021, WORKSHOP)
        == words + " (2.1 % at the margin: then another limit binds)"
    )
    least = replace(held, at_least=True, unit="kg", value=500.0, limit=500.0)
    assert "at least 500 kg is allowed; relaxed by 1 %" in least.sentence(0.01, 0.01, WORKSHOP)
