"""Breakpoints of a case, where its rates jump, and the stretches of time between them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

INSTANT = 1e-14  # [s, relative beyond 1 s] of time, so short that rates may jump within


class Breaks(NamedTuple):
    """When the rates of a case jump, or one of their derivatives does.

    Attributes:
        instants: ascending [s]; those outside of the run do not matter.
        complete: whether there are no others. Else no step is longer than half the interval
            between records, so that nothing longer than half of that passes unseen, though the
            case be at rest.
    """

    instants: Sequence[float] = ()
    complete: bool = False


class Stretch(NamedTuple):
    """Time without a breakpoint.

    Attributes:
        low: when rates are evaluated first [s], just inside.
        high: when they are evaluated last [s].
        stop: its end [s].
    """

    low: float
    high: float
    stop: float


def stretches(instants: Sequence[float], end: float) -> list[Stretch]:
    """All stretches of a case, the first one last.

    Instants closer to each other than the resolution of time count as one.

    Args:
        instants: breakpoints, ascending [s].
        end: of the run [s].
    """
    parts, low = list[Stretch](), 0.0
    for instant in (float(t) for t in instants if 0 <= t <= end):
        room = INSTANT * max(instant, 1.0)
        if instant - low > 4 * room:
            parts.append(Stretch(low, instant - room, instant))
        low = instant + room
    if not parts or end - low > 4 * INSTANT * max(end, 1.0):
        parts.append(Stretch(low, math.inf, end))
    else:
        parts[-1] = parts[-1]._replace(stop=end)
    return parts[::-1]
