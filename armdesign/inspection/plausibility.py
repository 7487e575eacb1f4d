"""Numbers that can be used but are most likely in another unit, or about a reversed axis.

Lengths are judged by other lengths of the same machine: a pin in metres lies a thousandth of its
link away from the joint. Pressures, oil and flow are judged by what machines have
(``likely_values.USUAL``), masses by other masses. A finding says the line of the file.
"""

from __future__ import annotations

from collections.abc import Mapping

from armdesign.inspection import implausible_urdf, implausible_values
from armdesign.inspection.finding import Finding
from armdesign.inspection.reference import Reference
from armdesign.machine.machine import Machine


def suspicions(machine: Machine, shares: Mapping[str, float]) -> list[Finding]:
    """Numbers most likely in another unit, and reversed axes, the URDF first; one of each part.

    Args:
        machine: that can be used.
        shares: by actuator, its largest static force over what the supply holds.
    """
    reference = Reference(machine, shares)
    lengths = [
        *implausible_urdf.of_urdf(reference),
        *implausible_urdf.of_joints(reference),
        *implausible_values.of_places(reference),
        *implausible_values.of_cylinders(reference),
    ]
    findings = [
        *lengths,
        *implausible_values.of_usual(reference),
        # with other lengths the loads are others
        *([] if lengths else implausible_values.of_masses(reference)),
        *implausible_values.of_motors(reference),
        *implausible_values.of_angles(reference),
        *implausible_values.of_flow(reference),
    ]
    return list({finding.part: finding for finding in reversed(findings)}.values())[::-1]
