"""The excavator's file, and what changes in one."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import armdesign as ad
from armdesign.machine.loading import shipped
from armdesign.machine.machine import Machine
from tests import machines

EXCAVATOR = machines.named("excavator_20t")


FILE = shipped()["excavator_20t"]


TEXT = FILE.read_text(encoding="utf-8")


UNUSUAL = """# comments everywhere, tables out of order, dotted keys
name = "odd"    # a name
urdf = 'excavator_20t.urdf'
joints = [      # q
    "boom",     # first
    "stick",
    "bucket",   # last
]
tool = {link = "bucket", at_mm = [ 1502 , 0 , 0 ]}   # tip
supply.pressure_bar = 350
supply.flow_l_per_min = 4.29e2    # both pumps

[cylinder.boom]  # two of them
count = 2
bore_mm = 120    # [mm]
rod_mm = 85.0
stroke_mm = 1_260
closed_length_mm = 1825
dead_volume_l.cap = 5.6
dead_volume_l.annulus = 5.6   # hoses included
[cylinder.boom.base]
link = "chassis"
at_mm = [461.5,   # x
         0,       # y
         -602.5]  # z
[cylinder.boom.rod_end]
link = "boom"
at_mm = [2233.7, 0, 950.5]

[fluid]          # between the cylinders
bulk_modulus_MPa = 1200

"""
LATE = """
[payload.full]
mass_kg = 1600
link = "bucket"
at_mm = [645, 0, 435]

[cylinder.boom.valve]  # far from its cylinder
rated_flow_l_per_min = 429
rated_drop_bar = 14
natural_frequency_hz = 10
damping_ratio = 0.8
"""


def unusual() -> Machine:
    """A file as a person might write it, with the stick and bucket cylinders of the shipped
    one.
    """
    further_tables = TEXT[TEXT.index("[cylinder.stick]") : TEXT.index("[requirements]")]
    return Machine.from_text(
        UNUSUAL + further_tables + LATE, EXCAVATOR.urdf_text, Path("odd.toml")
    )


def changed_lines(before: str, after: str) -> list[tuple[str, str]]:
    """Pairs of lines that differ; both texts must have as many."""
    old, new = before.splitlines(), after.splitlines()
    assert len(old) == len(new)
    return [pair for pair in zip(old, new, strict=True) if pair[0] != pair[1]]


def frequencies(machine: Machine) -> np.ndarray:
    q = machines.inner_poses(EXCAVATOR, 4, seed=2)
    return ad.natural_modes(machine.with_payload("full").at(q)).frequencies
