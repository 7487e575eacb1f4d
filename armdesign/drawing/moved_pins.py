"""Pins that two machines have at different places: what moved, how far, in which link."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armdesign.arrays import Array
from armdesign.drawing.side_view import Bar, SideView

MOVED = 5e-6  # [m]: less is rounding


@dataclass(frozen=True, eq=False, kw_only=True)
class PinMove:
    """A pin at two places.

    Attributes:
        name: of cylinder and pin.
        link: that carries it.
        by: from the old place to the new one, in the link's frame (3,) [m].
        before: old places in the picture (n, 2) [m].
        after: new places in the picture (n, 2) [m].
    """

    name: str
    link: str
    by: Array
    before: Array
    after: Array

    @property
    def distance(self) -> float:
        """Distance between both places [m]."""
        return float(np.linalg.norm(self.by))


def moved_pins(old: SideView, new: SideView) -> tuple[PinMove, ...]:
    """Pins of both machines, on the same link, at different places of it."""
    known = {pin.name: index for index, pin in enumerate(old.pins)}
    moves = []
    for index, pin in enumerate(new.pins):
        before = old.pins[known[pin.name]] if pin.name in known else None
        if before is None or before.link != pin.link or pin.at is None or before.at is None:
            continue
        by = np.subtract(pin.at, before.at)
        if np.linalg.norm(by) > MOVED:
            moves.append(
                PinMove(
                    name=pin.name,
                    link=str(pin.link),
                    by=by,
                    before=old.points[:, known[pin.name]],
                    after=new.points[:, index],
                )
            )
    return tuple(moves)


def changed_bars(old: SideView, new: SideView) -> tuple[tuple[Bar, Bar], ...]:
    """Rockers and couplers of both machines whose lengths differ."""
    known = {bar.name: bar for bar in old.bars}
    pairs = ((known[bar.name], bar) for bar in new.bars if bar.name in known)
    return tuple(pair for pair in pairs if abs(pair[1].length - pair[0].length) > MOVED)
