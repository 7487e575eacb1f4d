"""Poses given to a sweep: every machine takes them with its own links."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import armdesign as ad
from armdesign.machine import template


def test_other_links_on_given_poses_answer_as_on_their_own() -> None:
    """A link's mass does not change the joint's range: the grid of every machine is the same."""
    machine = ad.Machine.from_text(template.new("lifter", links=1), "", Path("lifter.toml"))
    changes = {"links.boom.mass_kg": [300.0, 900.0]}
    for task, options in (("map", {}), ("control", {"damping": 0.05})):
        sweeps = (
            ad.sweep(machine, changes, task, options=options, **poses)
            for poses in ({"workspace": ad.Workspace.grid(machine, 3)}, {"points": 3})
        )
        given, own = (sweep.frame.drop(columns="seconds") for sweep in sweeps)
        pd.testing.assert_frame_equal(given, own)
        assert given["error"].eq("").all()


def stroke_of_poses(_: ad.Machine, workspace: ad.Workspace) -> Mapping[str, Any]:
    """A quick task about the machine and the cells of given poses."""
    count = 0 if workspace.cells is None else len(workspace.cells[0])
    return {"stroke": workspace.machine.strokes[0], "cells": count}


def test_a_journal_knows_whose_poses_were_given(tmp_path: Path) -> None:
    """Equal joint positions of another machine of the same links, and with cells."""
    known = ad.Workspace.grid(ad.load("paper_1dof"), 2)
    longer = known.machine.replace({"cylinder.lift.stroke_mm": 210.0})
    cells = (np.zeros(3), np.zeros(3))
    for poses in (known, replace(known, machine=longer), replace(known, cells=cells)):
        answers = ad.sweep(
            "paper_1dof", task=stroke_of_poses, workspace=poses, journal=tmp_path / "j.sqlite"
        )
        assert answers.kept == 0
        assert answers.frame["stroke"][0] == poses.machine.strokes[0]
        assert answers.frame["cells"][0] == (3 if poses.cells else 0)
