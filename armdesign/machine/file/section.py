"""Parts of all tables of the machine file: their base, and the ranges of common values."""

from __future__ import annotations

import re
from typing import Annotated, Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field

# of Windows, whatever follows a point
DEVICE = re.compile(r"(?:con|prn|aux|nul|com[0-9]|lpt[0-9])(?:\..*)?", re.IGNORECASE)
NAME_PATTERN, NAME_LENGTH = r"^[A-Za-z_][A-Za-z0-9_-]*$", 64
NAME_RULE = "start with a letter a to z, then letters a to z, digits, _ or -"
Name = Annotated[str, Field(pattern=NAME_PATTERN, max_length=NAME_LENGTH)]
Text = Annotated[str, Field(min_length=1, max_length=200)]
Length = Annotated[float, Field(gt=0, le=100_000)]
Volume = Annotated[float, Field(ge=0, le=10_000)]
Flow = Annotated[float, Field(gt=0, le=100_000)]
Mass = Annotated[float, Field(ge=0, le=1_000_000)]
Pressure = Annotated[float, Field(gt=0, le=5_000)]
Share = Annotated[float, Field(gt=0, le=1)]
Ratio = Annotated[float, Field(gt=0, le=10)]
Coordinate = Annotated[float, Field(ge=-100_000, le=100_000)]
Point = Annotated[list[Coordinate], Field(min_length=3, max_length=3)]
Distance = Annotated[float, Field(ge=0, le=100_000)]
Rate = Annotated[float, Field(ge=-100_000, le=100_000)]
Corner = Annotated[list[Coordinate], Field(min_length=2, max_length=2)]
Polygon = Annotated[list[Corner], Field(min_length=3, max_length=200)]
Angle = Annotated[float, Field(ge=-360, le=360)]

T = TypeVar("T")
Pair = Annotated[list[T], Field(min_length=2, max_length=2)]


class Section(BaseModel):
    """A table of the file: no unknown keys, no other types, no NaN."""

    model_config = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False, frozen=True)


def plain(value: Any) -> Any:
    """A table as a dict, to any depth, as ``model_dump`` gives it.

    Pydantic's own takes Ctrl-C in the function of a discriminator for a wrong type, and goes on.
    """
    if isinstance(value, Section):
        return {name: plain(item) for name, item in value}
    if isinstance(value, dict):
        return {name: plain(item) for name, item in value.items()}
    return [plain(item) for item in value] if isinstance(value, list) else value
