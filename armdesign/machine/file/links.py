"""``[links]``: the rigid links of a machine and their joints, in place of a URDF."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from armdesign.machine.file.section import (
    Angle,
    Coordinate,
    Distance,
    Length,
    Mass,
    Name,
    Pair,
    Point,
    Section,
)

Turn = Annotated[list[Angle], Field(min_length=3, max_length=3)]
Direction = Annotated[
    list[Annotated[float, Field(ge=-1_000, le=1_000)]], Field(min_length=3, max_length=3)
]
Limit = Annotated[float, Field(ge=-36_000, le=36_000)]
Inertia = Annotated[
    list[Annotated[float, Field(ge=-1e9, le=1e9)]], Field(min_length=3, max_length=6)
]
Edges = Annotated[list[Distance], Field(min_length=3, max_length=3)]


class LinkSection(Section):
    """A rigid link, and the joint between it and its parent; the root link has neither."""

    parent: Name | None = None
    type: Literal["revolute", "prismatic", "continuous", "fixed"] | None = None
    joint: Name | None = None
    at_mm: Point | None = None
    turn_deg: Turn | None = None
    axis: Direction | None = None
    limits_deg: Pair[Limit] | None = None
    limits_mm: Pair[Coordinate] | None = None
    length_mm: Length | None = None
    mass_kg: Mass = 0.0
    centre_mm: Point | None = None
    inertia_kg_m2: Inertia | None = None
    box_mm: Edges | None = None

    @property
    def kind(self) -> str:
        """Type of its joint as a URDF has it; revolute where none is given."""
        return self.type or "revolute"
