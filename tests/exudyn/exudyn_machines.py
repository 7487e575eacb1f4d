"""Machines as Exudyn can have them."""

from __future__ import annotations

import tomlkit

import armdesign as ad
from armdesign import Machine
from tests import machines
from tests.exudyn.exudyn_twin import common

FOUR_BARS = ("excavator_20t", "excavator_12t", "mini_excavator_2t", "loader_crane")


# [kg] in place of the shipped machines' massless rocker, which Exudyn's solver finds singular
ROCKER = 95.0


def named(name: str) -> Machine:
    """The machine under its last load case, as Exudyn can have it."""
    machine = direct_bucket() if name == "direct_bucket" else machines.named(name)
    if name in FOUR_BARS:
        pairs = zip(machine.cylinders, machine.linkages, strict=True)
        machine = machine.replace(
            {f"cylinder.{c.name}.four_bar.rocker_kg": ROCKER for c, arm in pairs if arm.bar_names}
        )
    return common(machine.with_payload(machine.payloads[-1].name))


def direct_bucket() -> Machine:
    """The 20 t machine whose bucket cylinder pushes the bucket's lug itself: three joints, no
    loop.
    """
    machine = ad.load("excavator_20t")
    text = tomlkit.parse(machine.text)
    bucket = text["cylinder"]["bucket"]
    bucket["rod_end"] = bucket.pop("four_bar")["lug"]
    bucket |= {"closed_length_mm": 1700, "stroke_mm": 1000}
    return Machine.from_text(tomlkit.dumps(text), machine.urdf_text, machine.source)
