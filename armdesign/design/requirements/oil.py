"""Oil, which is pump and cycle time: swept volumes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from armdesign.design.requirements.candidate import Candidate, Reference
from armdesign.design.requirements.record import Evaluation, names_begin_with
from armdesign.design.requirements.stated import number, shares
from armdesign.hydraulics.actuator import SIDES
from armdesign.machine.file.schema import share_of


@dataclass(frozen=True, kw_only=True)
class Oil:
    """Settings: swept volumes.

    Attributes:
        oil_total_share: swept volume of all cylinders, bore sides and annulus sides, over
            today's, at most.
        oil_each_share: swept volume of each cylinder and side over today's, at most.
    """

    oil_total_share: float = number("oil_total_share")
    oil_each_share: float | Mapping[str, float] = shares("oil_each_share")


@names_begin_with("oil")
def oil(new: Candidate, reference: Reference) -> Iterator[Evaluation]:
    """Swept volumes of both sides, summed and of each cylinder.

    The bound states them again: the sum in ``bound/lagrangian.py`` (``budget``), each in
    ``bound/cylinder_constraints.py``; ``test_no_random_design_exceeds_the_bound`` ties them.
    """
    requirements, old = reference.requirements, reference.old
    count = len(reference.today.cylinders)
    for side, label in enumerate(SIDES):
        volume, today = (c.areas[:, :count, side] * c.stroke[:, :count] for c in (new, old))
        total = float(today.sum())
        yield Evaluation(
            name=f"oil.{label}.total",
            words=f"oil of all {label} sides",
            unit="m³",
            value=volume.sum(axis=1),
            limit=requirements.oil_total_share * total,
            scale=total,
            setting="oil_total_share",
        )
        for i, cylinder in enumerate(reference.today.cylinders):
            own = float(today[0, i])
            yield Evaluation(
                name=f"oil.{label}.{cylinder.name}",
                words=f"oil of the {cylinder.name} cylinder's {label} side",
                unit="m³",
                value=volume[:, i],
                limit=share_of(requirements.oil_each_share, cylinder.name) * own,
                scale=own,
                setting=f"oil_each_share.{cylinder.name}",
            )
