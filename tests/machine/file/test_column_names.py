"""No joint has the name of another column of the CSV files: these are what they are made of."""

from __future__ import annotations

import pandas as pd
import pytest

import armdesign as ad
from armdesign.control.bandwidth_map import SCHEMES
from armdesign.machine.file.column_names import COLUMNS, is_column
from tests import machines


def frames(machine: ad.Machine) -> list[pd.DataFrame]:
    """Frames of a machine in which each joint is a column."""
    mapped = ad.frequency_map(machine, ad.Workspace.grid(machine, points=3))
    bandwidths = ad.bandwidth_map(machine, mapped.workspace, damping=0.02)
    found = [mapped.frame, mapped.stiffness, bandwidths.frame, bandwidths.gains]
    return [*found, bandwidths.schedule, ad.lift_chart(machine).frame]


@pytest.mark.parametrize("name", ["paper_1dof", "excavator_20t", "loader_crane"])
def test_every_column_is_known(name: str) -> None:
    machine = machines.named(name)
    actuators = [actuator.name for actuator in machine.actuators]
    tables = frames(machine)
    if name == "paper_1dof":
        proof = ad.validate(machine, q=[[0.0]])
        tables.append(proof.frame)
    for table in tables:
        others = [str(column) for column in table.columns if column not in machine.joints]
        unknown = [one for one in others if not is_column(one, machine.joints, actuators)]
        assert unknown == []


@pytest.mark.parametrize("scheme", SCHEMES)
def test_figures_of_every_scheme_are_columns(scheme: str) -> None:
    assert is_column(f"{scheme}_hz", ["boom"], ["lift"])


def test_a_joint_between_the_columns_is_none() -> None:
    assert not is_column("boom_ext", ["boom", "boom_ext"], ["boom"])
    assert not COLUMNS & {"boom", "stick", "bucket", "slew", "swing", "extension", "rotator"}
