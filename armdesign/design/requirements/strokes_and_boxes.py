"""Strokes and pin boxes: kept by how the optimiser makes designs, but a machine may miss them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from armdesign.design.requirements.candidate import Candidate, MachineCandidate, Reference
from armdesign.design.requirements.record import Evaluation
from armdesign.design.requirements.stated import Names, Stated, at_work, cylinders, number, stated
from armdesign.frequency.workspace import Workspace
from armdesign.machine.machine import Machine
from armdesign.units import mm


def _read(machine: Machine) -> dict[str, dict[str, float]]:
    return {
        name: {pin: box * mm for pin, box in boxes.model_dump().items() if box is not None}
        for name, boxes in machine.section.requirements.pin_boxes_mm.items()
        if at_work(machine, name)
    }


def _names(boxes: Mapping[str, Mapping[str, float]], machine: Machine) -> Names:
    yield "pin_boxes", "cylinder", boxes, cylinders(machine)
    for name, box in boxes.items():
        yield f"pin_boxes.{name}", "pin", box, ("base", "rod_end")


ROUNDING_RANGE = 2e-4  # [m] that rounding to 0.1 mm may move an end of the range
SHORT = 1e-6  # [m] of an end of a slide that a stroke may be: nobody can make or measure it


@dataclass(frozen=True, kw_only=True)
class PinBoxes:
    """Settings: how far pins may move.

    Attributes:
        pin_box: how far each pin coordinate may move in its link [m]; None: 2.5 % of the largest
            distance from the first joint, the one next to the root, to the tool.
        pin_boxes: other boxes [m] for pins, by cylinder and pin (``base``, ``rod_end``).
    """

    pin_box: float | None = number("pin_box_mm", mm)
    pin_boxes: Mapping[str, Mapping[str, float]] = stated(
        Stated(key="pin_boxes_mm", read=_read, names=_names)
    )

    def box(self, machine: Machine, workspace: Workspace) -> float:
        """Half side of a pin's box where no box of its own is given [m]."""
        if self.pin_box is not None:
            return self.pin_box
        arm, rigid = machine.arm, workspace.on(machine).rigid
        tool = arm.point(rigid, machine.tool.link, np.array(machine.tool.at))
        outwards = [*arm.chain(machine.tool.link), *arm.outwards]
        first = next(j for j in outwards if j < len(machine.joints))
        return float(0.025 * np.linalg.norm(tool - rigid.translation[:, first], axis=1).max())

    def with_box(self, machine: Machine, workspace: Workspace) -> Self:
        """The requirements with this workspace's pin box stated, whichever workspace is judged."""
        return replace(self, pin_box=self.box(machine, workspace))

    def box_of(self, cylinder: str, pin: str, common: float) -> float:
        """Half side of one pin's box [m]; ``common`` where it has no own."""
        return self.pin_boxes.get(cylinder, {}).get(pin, common)


def strokes_and_boxes(
    new: MachineCandidate, reference: Reference, box: float
) -> Iterator[Evaluation]:
    """Strokes that cover their joint's range, places within their boxes; ``box`` is common [m].

    The optimiser states them as ``DesignVector.strokes`` and ``Problem.bounds``, but for lengths
    that are chosen; ``test_constraints_of_the_optimiser_are_the_requirements`` ties them.
    """
    for i, cylinder in enumerate(reference.today.cylinders):
        name, swept, linkage = cylinder.name, new.sweeps[i], new.machine.linkages[i]
        if swept is not None:
            yield from range_covered(new, reference, i)
        for place in linkage.places:
            now, before = new.place(i, place), reference.old.place(i, place)
            if now is None or before is None:
                continue
            words = f"change of the {name} {place}'s length"
            if place in linkage.pin_names:
                words = f"move of the {name} cylinder's {place.replace('_', '-')} pin"
            own = reference.requirements.box_of(name, place, box)
            yield Evaluation(
                name=f"pin_box.{name}.{place}",
                words=words,
                unit="m",
                value=np.abs(now - before).max(axis=1),
                limit=own,
                slack_scale=own or 1.0,
            )


def range_covered(new: Candidate, reference: Reference, i: int) -> Iterator[Evaluation]:
    """Closed and open length of a cylinder that moves one joint reach both ends of its range.

    With the share of the stroke beyond them that today's cylinder has there, up to ``end_margin``:
    where a joint's limit ends the range, the new stroke does not end with it. Within ``SHORT``
    along a slide, where strokes in whole steps of a coarse grid would otherwise depend on the
    last micrometre.
    """
    swept, today = new.sweeps[i], reference.today
    assert swept is not None
    name, stroke = today.cylinders[i].name, today.cylinders[i].stroke
    joint = today.linkages[i].joints[0]
    short = 0.0 if today.arm.joints[joint].revolute else SHORT
    order = swept[0][0].real.argsort()
    closed, opened = new.closed[:, i], new.closed[:, i] + new.stroke[:, i]
    for end, value, k, spare in zip(
        ("closed", "open"), (closed, opened), order[[0, -1]], reference.spare[i], strict=True
    ):
        beyond = spare * new.stroke[:, i] - short
        limit = swept[0][:, k] + (-beyond if end == "closed" else beyond)
        words = f"stroke covers {today.joints[joint]}"
        if spare > 0:
            words += f" with {100 * spare:.2g} % of it free"
        room = limit - value if end == "closed" else value - limit
        yield Evaluation(
            name=f"range.{end}.{name}",
            words=words,
            unit="m",
            value=value,
            limit=float(limit[0].real),
            at_least=end == "open",
            slack_scale=stroke,
            reformulated=((room / stroke)[:, None], np.zeros((len(limit), 1))),
            rounding_loss=ROUNDING_RANGE / stroke,
        )
