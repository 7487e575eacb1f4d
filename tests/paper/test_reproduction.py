"""Measurements of a few of the paper's 40 configurations.

Pencelli et al., "On the Estimation of Resonance Frequencies of Hydraulically Actuated Systems",
ISARC 2019, section 4.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

import armdesign as ad
from armdesign.errors import SimulationError
from armdesign.paper import reproduction as paper
from armdesign.paper.configurations import FORMULAS, grid
from tests.paper.dimensions import CORNERS


@pytest.mark.slow
def test_small_amplitude_finds_the_exact_frequency(corners: paper.Reproduction) -> None:
    """Issue: within 0.5 %; reached 0.009 %.

    No formula but the exact one and J/r² comes within 1 %.
    """
    exact = corners.computed["joint_exact"]
    assert_allclose(corners.identified, exact, rtol=5e-4)
    errors = corners.errors["identified"]
    assert errors["joint_exact"] < 0.05  # [rad/s]
    assert errors["joint_42_as_printed"] > 100 * errors["joint_exact"]
    assert errors["static_11"] > 10 * errors["joint_42_as_printed"]
    assert (corners.frame["identified_damping"].between(0, 0.02)).all()


def test_the_papers_way(corners: paper.Reproduction) -> None:
    """The highest line is within two lines (1/T) of the truth; for 400 kg at 1.5 m the oil
    cavitates: far too low.

    Two, not half of one: the sweep passes 41.7 Hz in its last tenth. Reached: 1.5 there, 0.2 at
    the others.
    """
    exact, line = corners.computed["joint_exact"], 1 / corners.sweep.duration
    off = corners.swept - exact
    assert np.abs(off[0]) < 2 * line
    assert np.abs(off[1:3]).max() < line / 2
    assert off[3] < -0.2 * exact[3]
    cavitated = corners.frame["least_pressure_pa"] < 0
    assert list(cavitated) == [False, False, False, True]
    assert corners.cavitated == 1
    errors = corners.errors["swept"]
    assert errors["static_11"] > 8 * errors["joint_42_as_printed"]  # measured: 12
    assert errors["joint_42_as_printed"] > errors["joint_exact"]


def test_drift_is_gravitys(corners: paper.Reproduction) -> None:
    """Open loop the load, which pulls the rod, draws the piston out; a heavier load more."""
    drift = corners.frame["drift_m"].to_numpy()
    assert np.all(drift > 0)
    assert drift[3] > drift[1] > drift[0]


def test_a_smaller_sweep_brings_the_line_back(corners: paper.Reproduction) -> None:
    """Amplitude, not model: a tenth of the opening moves the heaviest load's line towards the
    exact frequency.
    """
    gentle = replace(paper.SWEEP, amplitude=paper.SWEEP.amplitude / 10)
    reproduction = paper.reproduce(masses=(400.0,), lengths=(1.5,), sweep=gentle)
    exact = reproduction.computed["joint_exact"][0]
    assert abs(reproduction.swept[0] - exact) < 0.5 * abs(corners.swept[3] - exact)
    assert reproduction.identified[0] == corners.identified[3], (
        "the small sweep is another run, and the same one"
    )


def test_frame_and_results_are_whole(corners: paper.Reproduction) -> None:
    frame = corners.frame
    assert len(frame) == 4
    assert frame.notna().all().all()
    assert {f"{name}_hz" for name in FORMULAS} <= set(frame.columns)
    with pytest.raises(ValueError, match="read-only"):
        corners.computed["static_11"][0] = 0.0
    with pytest.raises(ValueError, match="read-only"):
        corners.swept[0] = 0.0


@pytest.mark.slow
def test_command_in_two_processes(
    corners: paper.Reproduction,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Four configurations in place of 40: all files are there, and two processes find what one
    finds.
    """
    from armdesign.cli import app

    reproduce = paper.reproduce
    monkeypatch.setattr(paper, "reproduce", lambda: reproduce(**CORNERS))
    app(["paper", "--out", str(tmp_path / "out")], standalone_mode=False)
    names = {path.name for path in (tmp_path / "out").iterdir()}
    tables = {
        "paper.csv",
        "paper_errors.csv",
        "paper_errata.csv",
        "paper_scan.csv",
        "paper_sweep_bias.csv",
    }
    pictures = {f"paper_figures_{n}.png" for n in ("3_4", "5_6", "5_6_exact")}
    others = {"machine.png", "paper_by_mass.png", "report.html", "report.json"}
    assert names == tables | pictures | others
    pd.testing.assert_frame_equal(
        pd.read_csv(tmp_path / "out" / "paper.csv"), corners.frame, rtol=1e-8, check_dtype=False
    )
    printed = capsys.readouterr().out
    assert "…" not in printed, "a column is cut off"
    assert "23.49 rad/s" in printed


def test_bad_input_is_one_line() -> None:
    """Also from another process: 400 kg at 1.5 m need 195 bar on the annulus (41 kN / 2.1e-3 m²),
    supply is 150 bar.
    """
    with pytest.raises(ad.ArmDesignError, match="paper: masses: none given"):
        paper.reproduce(masses=())
    with pytest.raises(ad.ArmDesignError, match="paper: lengths: -1 is not allowed"):
        grid(ad.load("paper_1dof"), (50.0,), (1.0, -1.0))
    weak = ad.load("paper_1dof").replace({"supply.pressure_bar": 150})
    with pytest.raises(
        SimulationError, match=r"needs 19\d\.\d bar to hold the load, supply is 150 bar"
    ) as caught:
        paper.reproduce(weak, (400.0,), (1.5,))
    assert "\n" not in str(caught.value)
