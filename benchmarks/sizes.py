"""Figures of sizing on excavator_20t: many poses, catalogues, the reverse question.

Run on an otherwise idle machine: ``python -m benchmarks.sizes``. Times are the best of three in
this process; beside the wall time stands the processor time, which a busy machine spoils less.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import armdesign as ad
from armdesign.design.catalogue.branch_and_bound import select
from armdesign.design.catalogue.separable import allowed_sizes
from armdesign.design.catalogue.sizes import sizes_of
from armdesign.units import mm
from benchmarks.timing import Best, best_of
from tests.design.catalogue.enumeration import enumerated

MACHINE = "excavator_20t"
POINTS = (40, 40, 60)  # about 10⁵ poses
BORES, RODS = (115, 120, 125, 130, 135, 140), (85, 90, 100)  # mm, of the small catalogue


def words(best: Best[Any]) -> str:
    """Wall time, and processor time in parentheses."""
    return f"{best.wall:.2f} s ({best.processor:.2f} s)"


def main() -> None:
    """Measure and print everything."""
    machine = ad.load(MACHINE)
    workspace = ad.Workspace.grid(machine)
    _ = workspace.rigid
    # imports and first compilations are not part of the figures
    ad.size_cylinders(machine, workspace)

    many = ad.Workspace.grid(machine, points=POINTS)
    _ = many.rigid
    took = words(best_of(lambda: ad.size_cylinders(machine, many)))
    print(f"sizing over {len(many.q)} given poses: {took}; target < 2 s")

    enumeration(machine)
    catalogues(machine, workspace)
    least_amounts(machine, workspace)


def wider(machine: ad.Machine) -> ad.Requirements:
    """Its requirements with room for the steps of a catalogue, which its own have not."""
    own = ad.Requirements.of(machine)
    return replace(own, oil_total_share=1.1, oil_each_share=1.3, thrust_share=1.3)


def enumeration(machine: ad.Machine) -> None:
    """Sizes of a catalogue beside all combinations of them."""
    small, limits = ad.Workspace.grid(machine, points=(5, 5, 9)), wider(machine)
    sizes = sizes_of([(bore * mm, rod * mm) for bore in BORES for rod in RODS])
    best = best_of(lambda: select(allowed_sizes(machine, machine, small, limits, sizes)))
    slow = best_of(lambda: enumerated(machine, small, limits, sizes), 1)
    print(
        f"{len(sizes)}³ combinations, {len(small.q)} poses: {best.result.frequency:.9f} Hz, bound"
        f" {best.result.bound:.9f}, {words(best)}"
    )
    print(f"  enumeration: {slow.result:.9f} Hz, {words(slow)}")


def catalogues(machine: ad.Machine, workspace: ad.Workspace) -> None:
    """Sizes, and sizes and pins, of the catalogues."""
    for catalogue in ("iso", "5mm"):
        for label, action in (("sizes", ad.size_cylinders), ("sizes and pins", ad.optimize)):
            best = best_of(
                partial(action, machine, workspace, wider(machine), catalogue=catalogue), 1
            )
            design = best.result
            gain = design.after.frame["f1_hz"].min() / design.before.frame["f1_hz"].min() - 1
            print(f"{catalogue}, {label}: {gain:+.1%}, {words(best)}")


def least_amounts(machine: ad.Machine, workspace: ad.Workspace) -> None:
    """Least oil, flow and mass for today's frequency, both of the values of the file."""
    least = partial(ad.least, machine, workspace, wider(machine), bands=ad.Bands())
    today = ad.frequency_map(machine, workspace).frame["f1_hz"].min()
    for amount, name in (
        ("oil", "oil_total_share"),
        ("flow", "oil_each_share"),
        ("mass", "cylinder_mass"),
    ):
        best = best_of(partial(least, frequency=today, of=amount), 1)
        print(
            f"today's frequency with least {amount}: {name}"
            f" {getattr(best.result.requirements, name):.4g}, {words(best)}"
        )


if __name__ == "__main__":
    main()
