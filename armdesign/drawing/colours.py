"""Colours of parts: the same for the same actuator in every picture, page and scene.

Okabe and Ito's set (Color Universal Design, 2008), which people with any common colour blindness
tell apart, with a brown in place of its yellow, too light for lines on white; its vermilion comes
last, because red marks what is wrong or worst. A test measures how far apart they are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from armdesign.machine.machine import Machine

ACTUATORS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#7F5539", "#D55E00")
SPRING = "#6B7280"


def actuator_colours(machine: Machine) -> dict[str, str]:
    """Colour of every actuator and spring by its name, in the order of the machine file.

    Idle cylinders and motors have theirs too, so that freezing a joint changes no colour.
    """
    names = [*machine.section.cylinder, *machine.section.motor]
    colours = {name: ACTUATORS[i % len(ACTUATORS)] for i, name in enumerate(names)}
    return colours | {spring.name: SPRING for spring in machine.springs}
