"""Pictures in at most 256 colours, a part of the file: those that fill areas stay what they are.

Colours are many only where edges are smoothed. Those of dots that have one colour with the next
ones stay, the most frequent first; to them comes the colour that is farthest from all, again and
again; what is left takes the nearest.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.arrays import Array

if TYPE_CHECKING:
    from PIL.Image import Image

COLOURS = 256
AREAS = 208  # of them that stay, at most, because they fill areas
ROWS = 3  # of which one is looked at for areas
MOST = 1 << 16  # colours of a drawing; a photograph has more
BYTES = np.array([1, 1 << 8, 1 << 16])


def in_few_colours(dots: Array) -> Image:
    """A picture of opaque dots (rows, columns, red green blue alpha), with a palette.

    As it is where it has more colours than drawings have.
    """
    from PIL.Image import fromarray

    picture = fromarray(dots)
    counted = picture.getcolors(MOST)
    if counted is None:
        return picture.convert("RGB")
    codes = np.ascontiguousarray(dots).view("<u4")[..., 0]
    first = _of_areas(codes)
    colours = np.array(list(dict.fromkeys([*first, *(colour for _, colour in counted)])))[:, :3]
    palette, nearest = _palette(colours, max(len(first), 1))
    of_dot = np.empty(1 << 24, dtype=np.uint8)  # of which but a few pages are touched
    of_dot[colours @ BYTES] = nearest
    few = fromarray(of_dot[codes & 0xFFFFFF])
    few.putpalette(palette.astype(np.uint8).tobytes())
    return few


def _of_areas(codes: Array) -> list[Any]:
    """Colours of dots that have one colour with the next to the right and below, by frequency.

    Of ``codes`` (rows, columns), four bytes each, looked at in every third row.
    """
    from PIL.Image import fromarray

    some, below = codes[:-1:ROWS, :-1], codes[1::ROWS, :-1]
    alike = (some == below) & (some == codes[:-1:ROWS, 1:])
    if not alike.any():
        return []
    counted: Any = fromarray(some[alike].view(np.uint8).reshape(1, -1, 4)).getcolors(MOST)
    return [colour for _, colour in sorted(counted, reverse=True)][:AREAS]


def _palette(colours: Array, count: int) -> tuple[Array, Array]:
    """Of colours (n, 3) at most ``COLOURS``, the first ``count`` first, and each one's nearest."""
    chosen = list(range(count))
    apart = _squares_apart(colours, colours[chosen])
    nearest, least = apart.argmin(axis=1), apart.min(axis=1)
    while len(chosen) < min(COLOURS, len(colours)):
        chosen.append(int(least.argmax()))
        apart = _squares_apart(colours, colours[chosen[-1:]])[:, 0]
        nearest[apart < least] = len(chosen) - 1
        least = np.minimum(least, apart)
    return colours[chosen], nearest


def _squares_apart(some: Array, others: Array) -> Array:
    """Squared distances (m, n) between colours (m, 3) and (n, 3)."""
    some, others = some.astype(float), others.astype(float)
    return np.asarray(
        (some**2).sum(axis=1)[:, None] + (others**2).sum(axis=1) - 2 * some @ others.T
    )
