"""A machine with a four-bar that opens within the joint ranges; no stroke keeps it from that."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from armdesign import Machine
from tests.machines import BOOM, CylinderSpec, Joint, build


@cache
def opening() -> Machine:
    """Oil with air; a four-bar under a cylinder across two joints is open at a tenth of poses."""
    joints = [
        replace(BOOM, xyz=(0.25, 0, 1.6), limits=(-0.35, 1.0472)),
        Joint("stick", "boom", xyz=(2.6, 0, 0), limits=(-2.27, -0.5236), mass=300),
        Joint("bucket", "stick", xyz=(2.1, 0, 0), limits=(-2.0944, 1.0472), mass=130),
    ]
    four_bar = {
        **{"pivot": ("stick", (1.85, 0, 0.03)), "lug": ("bucket", (-0.06, 0, 0.1622))},
        **{"rocker": 0.412157, "coupler": 0.298869, "knee": "right"},
    }
    cylinders = [
        CylinderSpec("lift", ("root", (0.45, 0, 1.05)), ("boom", (1.1, 0, -0.12))),
        CylinderSpec("fold", ("boom", (1.3, 0, 0.42)), ("stick", (-0.33, 0, 0.19))),
        CylinderSpec("tilt", ("boom", (1.4652, 0, 0.6489)), **four_bar),  # type: ignore[arg-type]
    ]
    strokes = {"lift": (700, 850), "fold": (760, 800), "tilt": (1067.756, 2071.622)}
    keys = "stroke_mm", "closed_length_mm"
    return build(joints, cylinders, payload=("bucket", (0.9, 0, 0)), air_percent=1.0).replace(
        {
            f"cylinder.{name}.{key}": value
            for name, sizes in strokes.items()
            for key, value in zip(keys, sizes, strict=True)
        }
    )
