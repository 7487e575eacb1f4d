"""Pictures in at most 256 colours, a part of the file: those that fill areas stay what they are.

A drawing has few colours but where edges are smoothed. The most frequent stay; to them comes the
one that is farthest from all, again and again; what is left takes the nearest.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from armdesign.arrays import Array

if TYPE_CHECKING:
    from PIL.Image import Image

COLOURS = 256
FREQUENT = 192  # of them that stay because they are
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
    counted.sort(reverse=True)
    colours = np.array([colour for _, colour in counted])[:, :3]
    palette, nearest = _palette(colours)
    of_dot = np.empty(1 << 24, dtype=np.uint8)  # of which but a few pages are touched
    of_dot[colours @ BYTES] = nearest
    codes = np.ascontiguousarray(dots).view("<u4")[..., 0] & 0xFFFFFF
    few = fromarray(of_dot[codes])
    few.putpalette(palette.astype(np.uint8).tobytes())
    return few


def _palette(colours: Array) -> tuple[Array, Array]:
    """At most ``COLOURS`` of the colours (n, 3), most frequent first, and the nearest of each."""
    chosen = list(range(min(FREQUENT, len(colours))))
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
