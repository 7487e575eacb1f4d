"""Jobs of the regression gate: small machines and few poses, the same code as the large ones."""

from __future__ import annotations

from collections.abc import Callable

import armdesign as ad


def _map() -> None:
    machine = ad.load("excavator_20t")
    ad.frequency_map(machine, ad.Workspace.grid(machine, points=6))


def _sizes() -> None:
    machine = ad.load("excavator_20t")
    ad.size_cylinders(machine, ad.Workspace.grid(machine, points=4), catalogue="free")


def _design() -> None:
    """Areas and pins, rounding, and the bound."""
    machine = ad.load("paper_1dof")
    design = ad.optimize(machine, ad.Workspace.grid(machine, points=9), catalogue="free")
    assert design.certificate is not None


def _conflict() -> None:
    machine = ad.load("paper_1dof")
    try:
        ad.optimize(
            machine,
            ad.Workspace.grid(machine, points=9),
            ad.Requirements.of(machine, oil_total_share=0.7),
        )
    except ad.InfeasibleError:
        return
    raise AssertionError("no conflict")


def _validate() -> None:
    machine = ad.load("paper_1dof")
    worst = ad.frequency_map(machine, ad.Workspace.grid(machine, points=9)).worst
    ad.validate(machine.with_payload(worst.payload), worst.q)


JOBS: dict[str, Callable[[], None]] = {
    "map": _map,
    "sizes": _sizes,
    "design": _design,
    "conflict": _conflict,
    "validate": _validate,
}
