"""Pictures in few colours: areas stay what they are, edges hardly change."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from armdesign import plots
from armdesign.plots.palette import COLOURS, MOST, in_few_colours
from tests.frequency.cached import mapped
from tests.machines import named


def opaque(colours: np.ndarray) -> np.ndarray:
    """Dots of colours (rows, columns, 3)."""
    alpha = np.full((*colours.shape[:2], 1), 255)
    return np.concatenate([colours, alpha], axis=2).astype(np.uint8)


def read(picture: Image.Image) -> np.ndarray:
    """Colours (rows, columns, 3) of a picture, written and read again."""
    stream = io.BytesIO()
    picture.save(stream, format="PNG")
    return np.asarray(Image.open(stream).convert("RGB")).astype(int)


@pytest.mark.parametrize("count", [1, 2, COLOURS])
def test_few_colours_all_stay(count: int) -> None:
    chance = np.random.default_rng(count)
    some = chance.permutation(1 << 24)[:count, None] >> np.array([0, 8, 16]) & 255
    dots = some[chance.integers(count, size=(40, 60))]
    picture = in_few_colours(opaque(dots))
    assert picture.mode == "P"
    np.testing.assert_array_equal(read(picture), dots)


def test_areas_stay_and_others_take_the_nearest() -> None:
    """100 areas, and a dot each of 3 000 other colours, which take the nearest there is."""
    chance = np.random.default_rng(0)
    areas = chance.integers(256, size=(100, 1, 3))
    dots = areas.repeat(4, axis=0).repeat(60, axis=1)
    dots[:, :8] = chance.integers(256, size=(400, 8, 3))
    shown = read(in_few_colours(opaque(dots)))
    np.testing.assert_array_equal(shown[:, 8:], dots[:, 8:])
    palette = np.unique(shown.reshape(-1, 3), axis=0)
    assert len(palette) == COLOURS
    apart = ((dots[:, :8, None] - palette) ** 2).sum(axis=3).min(axis=2)
    np.testing.assert_array_equal(((dots - shown)[:, :8] ** 2).sum(axis=2), apart)


def test_a_photograph_stays_as_it_is() -> None:
    dots = np.arange(2 * MOST).reshape(256, -1)[..., None] >> np.array([0, 8, 16]) & 255
    picture = in_few_colours(opaque(dots))
    assert picture.mode == "RGB"
    np.testing.assert_array_equal(read(picture), dots)


@pytest.mark.parametrize(
    ("plane", "areas_stay", "most"), [("joints", 1.0, 12), ("reach", 0.999, 20), ("", 1.0, 12)]
)
def test_pictures_are_written_as_drawn(
    plane: str, areas_stay: float, most: int, tmp_path: Path
) -> None:
    """19 of 20 dots are as drawn and all areas, no edge is off by more than 12 of 255.

    Where a machine is drawn over a field, 999 of 1000 dots of areas, and 20.
    """
    fig = plots.moment_arm_curves({"today": named("excavator_20t")})
    if plane:
        fig = plots.map_figure(mapped("excavator_20t", 18), plane)
    with Image.open(plots.save(fig, tmp_path / "a.png")) as picture:
        assert picture.mode == "P"
        written = np.asarray(picture.convert("RGB")).astype(int)
    drawn = np.asarray(fig.canvas.buffer_rgba())[..., :3].astype(int)
    off, alike = np.abs(written - drawn).max(axis=2), drawn[:-1, :-1] == drawn[1:, :-1]
    areas = (alike & (drawn[:-1, :-1] == drawn[:-1, 1:])).all(axis=2)
    assert (off == 0).mean() > 0.95
    assert (off[:-1, :-1][areas] == 0).mean() >= areas_stay
    assert off.max() <= most
