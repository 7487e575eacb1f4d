"""``optimize`` for bandwidth: against bandwidth maps, differences, and designs for frequency."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import armdesign as ad
from armdesign.design.program.corners import Emphasis
from armdesign.design.search.multistart import formulate
from armdesign.sweeps.numbers import of_design
from tests.commands import Refused, main

DAMPING = 0.02  # a measured crane
AREAS = ("areas",)


def narrowest(machine: ad.Machine, workspace: ad.Workspace) -> float:
    """As a bandwidth map has it, of gains common to all joints."""
    return float(
        ad.bandwidth_map(machine, workspace, damping=DAMPING).worst("damped")["damped_hz"]
    )


def test_bandwidths_are_those_of_maps() -> None:
    machine = ad.load("paper_1dof")
    workspace = ad.Workspace.grid(machine, points=5)
    more_oil = ad.Requirements.of(machine, oil_total_share=1.05)
    design = ad.optimize(
        machine, workspace, more_oil, vary=AREAS, objective="bandwidth", damping=DAMPING
    )
    assert design.bandwidths is not None
    today, of_frequency, new = design.bandwidths
    assert today == pytest.approx(narrowest(machine, workspace), rel=1e-9)
    assert new == pytest.approx(narrowest(design.machine, workspace), rel=1e-9)
    assert new >= of_frequency > today
    assert all(check.slack >= 0 for check in design.checks)
    assert of_design(design)["bandwidth_after_hz"] == new
    command = "objective='bandwidth', damping=0.02"
    assert command in design.machine.text.replace("\n#  ", "")


@pytest.mark.slow
def test_it_is_no_slower_than_the_design_for_frequency() -> None:
    """With sizes as they come, the bucket's cylinder counts for more than in the frequency."""
    machine = ad.load("excavator_20t")
    workspace = ad.Workspace.grid(machine, points=5)
    searched = {"vary": AREAS, "catalogue": "free"}
    limits = ad.Requirements.of(machine)
    of_frequency = ad.optimize(
        machine, workspace, limits, bands=ad.Bands(), objective="worst", **searched
    )
    design = ad.optimize(
        machine, workspace, limits, objective="bandwidth", damping=DAMPING, **searched
    )
    least = [narrowest(each.machine, workspace) for each in (of_frequency, design)]
    assert design.bandwidths is not None
    assert design.bandwidths[1:] == pytest.approx(least, rel=1e-9)
    assert least[1] > 1.002 * least[0]
    assert design.after.worst.frequency < of_frequency.after.worst.frequency
    bucket = [each.machine.cylinders[2].bore for each in (of_frequency, design)]
    assert bucket[1] > bucket[0]


@pytest.mark.slow
def test_pins_alone_have_more_bandwidth_than_those_of_the_highest_frequency() -> None:
    """Far from a machine its emphasis is wrong: it climbs in steps (0.231, 0.239, 0.245 Hz)."""
    machine = ad.load("excavator_12t")
    workspace = ad.Workspace.grid(machine, points=3)
    design = ad.optimize(machine, workspace, vary=("pins",), objective="bandwidth")
    assert design.bandwidths is not None
    today, of_frequency, new = design.bandwidths
    assert new > 1.02 * max(today, of_frequency)
    widths = ad.bandwidth_map(design.machine, workspace)
    assert new == pytest.approx(widths.worst("damped")["damped_hz"], rel=1e-9)
    assert all(check.slack >= 0 for check in design.checks)


def emphasised(vary: tuple[str, ...], emphasis: Callable[..., Emphasis]) -> tuple[float, ...]:
    """Lowest ω² of two problems, alike but for an emphasis."""
    machine = ad.load("paper_1dof")
    workspace = ad.Workspace.grid(machine, points=4)
    plain = formulate(machine, workspace, None, vary, bands=ad.Bands())
    other = formulate(
        machine, workspace, None, vary, bands=ad.Bands(),
        objective=emphasis(len(workspace.q), plain.vector.start),
    )  # fmt: skip
    x = plain.vector.start + 0.03
    return plain, other, x


@pytest.mark.parametrize("vary", [AREAS, ("areas", "pins")])
def test_emphasis_multiplies_frequencies_and_derivatives_follow(vary: tuple[str, ...]) -> None:
    random = np.random.default_rng(5)
    ratio = random.uniform(0.05, 0.3, 4)

    def emphasis(count: int, about: np.ndarray) -> Emphasis:
        growth = random.normal(size=(count, len(about)))
        by_case = ({"load": ratio}, {"load": growth})
        ends = about - 0.02, about + 0.01
        return Emphasis(
            ratio=by_case[0], growth=by_case[1], about=about, ends=ends, judge=lambda _: 0.0
        )

    plain, other, x = emphasised(vary, emphasis)
    at = other.dynamics.corners.emphasis
    low, high = other.bounds
    free = plain.bounds[1] > plain.bounds[0]
    np.testing.assert_allclose([at.about - low, high - at.about], [0.02 * free, 0.01 * free])
    expected = ratio * np.exp(at.growth["load"] @ (x - at.about))
    squared = other.dynamics.omega_squared(x) / plain.dynamics.omega_squared(x)
    np.testing.assert_allclose(np.sqrt(squared), expected, rtol=1e-12)

    rows, step = np.arange(4), 1e-6
    value, slopes = other.dynamics.scaled_stiffness_and_gradient(x, rows)
    np.testing.assert_allclose(value[:, 0, 0], other.dynamics.omega_squared(x), rtol=1e-12)
    for k, slope in enumerate(slopes):
        ends = [x + sign * step * (np.arange(len(x)) == k) for sign in (1, -1)]
        up, down = (other.dynamics.omega_squared(end) for end in ends)
        np.testing.assert_allclose(
            slope[:, 0, 0], (up - down) / (2 * step), rtol=1e-6, atol=1e-6 * value.max()
        )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"objective": "speed"}, "'speed' is not allowed; choose from: gain, worst, bandwidth"),
        ({"objective": "worst", "damping": 0.02}, 'means nothing where "worst" is to rise'),
        ({"objective": "bandwidth", "bands": ad.Bands(payload=(0.8, 1.2))}, "leave bands out"),
        ({"objective": "bandwidth"}, "no bandwidth can rest on that"),
    ],
)
def test_what_does_not_go_together_is_refused(options: dict[str, object], message: str) -> None:
    machine = ad.load("paper_1dof")
    workspace = ad.Workspace.grid(machine, points=3)
    with pytest.raises(ad.ArmDesignError) as error:
        ad.optimize(machine, workspace, vary=AREAS, **options)  # type: ignore[arg-type]
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--damping", "0.02"], 'means nothing where "gain" is to rise'),
        (["--objective", "speed"], "choose from: gain, worst, bandwidth"),
    ],
)
def test_the_command_refuses_what_means_nothing(
    words: list[str], message: str, refused: Refused
) -> None:
    refused(["optimize", "paper_1dof", "--points", "3", "--vary", "areas", *words], message)


@pytest.mark.slow
def test_the_command_says_what_the_bandwidth_was_and_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["optimize", "paper_1dof", "--points", "3", "--vary", "areas", "--out", str(tmp_path)]
    aim = ["--objective", "bandwidth", "--damping", "0.02"]
    assert main([*words, *aim], monkeypatch) == 0
    printed = capsys.readouterr().out
    assert "Least bandwidth of the position loops" in printed
    assert "highest worst frequency" in printed
