"""Optimisation: the public door ``optimize``, whatever is to be made large."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Unpack

from armdesign.arguments import checked, with_options
from armdesign.design.design import Design
from armdesign.design.optimize import USUAL_SEARCH, AimedSearch, SearchOptions, best_frequency
from armdesign.design.requirements.settings import Requirements
from armdesign.design.search.multistart import OBJECTIVES
from armdesign.errors import ArmDesignError, choose
from armdesign.frequency.bands import Bands
from armdesign.frequency.workspace import Workspace
from armdesign.machine.machine import Machine


@checked
@with_options(SearchOptions, USUAL_SEARCH)
def optimize(
    machine: Machine,
    workspace: Workspace | None = None,
    requirements: Requirements | None = None,
    vary: Sequence[str] = ("areas", "pins"),
    *,
    start: Design | None = None,
    objective: str = "gain",
    damping: float | None = None,
    **options: Unpack[SearchOptions],
) -> Design:
    """Cylinder areas and pins that raise the worst frequency over workspace and load cases.

    Within bands of what is not known exactly the least gain over today's machine counts, so that
    no corner of them pays for another.

    Args:
        machine: today's machine.
        workspace: poses that count; default grid if None.
        requirements: limits; None: the machine's file states them.
        vary: words ("areas"; "pins"; "linkages": pins and all of the four-bars) and key paths of
            the machine file ("cylinder.boom.bore_mm", "cylinder.bucket.four_bar",
            "cylinder.stick.base.at_mm.0").
        starts: how many starts the search makes; the first is today's machine, the others are
            drawn in the pin box, four-bars of many that are drawn those whose moment arms differ
            most in shape. None: 3, or 4 where four-bars move.
        seed: of the drawn starts. The same seed gives the same answer.
        workers: processes that share the starts. The answer does not depend on it; a process takes
            some seconds to set up, so that it pays from about ten starts, or three with four-bars.
        start: a design of the same machine under other limits, where the first start is then made.
        bands: what is not known exactly; the machine file's bands if None, ``Bands()`` for the
            file's values alone. Requirements are judged at the values of the file. Structure in
            series with a cylinder stays as it is [m/N], whatever the new cylinder.
        objective: what rises: within bands "gain", the least of f_new/f_today over their corners,
            or "worst", the worst frequency within them; or "bandwidth", the least bandwidth of the
            position loops with pressure feedback, by a local search without a ``bound`` that
            starts from the design of the highest worst frequency.
        catalogue: "iso", "5mm" or pairs of bore and rod [m] of which every cylinder has one; pins
            then lie on whole millimetres and strokes on 5 mm. None: as ``requirements.catalogue``
            of the machine's file says. "free", or where the file says nothing: any size, pin and
            stroke on the 0.1 mm grid. From the best free sizes one cylinder after the other
            takes a size of the catalogue while the rest follows; then the best sizes for the pins
            and the best pins for the sizes are found in turn, and one size after the other is
            chosen again, until nothing is better. ``bound`` is for sizes of the catalogue, with
            pins and strokes on no grid. A bore or rod that does not vary stays: then only pairs
            that have it are offered.
        damping: ratio of all modes in place of the file's damping, on which bandwidths rest.

    Raises:
        ArmDesignError: an objective that there is not; a seed below 0; a word or path of ``vary``
            that names nothing that can vary; a start from another machine; no catalogue, or one of
            no use.
        InfeasibleError: no design meets the requirements. Granted what it asks for, the same call
            gives one: that was tried.

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> workspace = ad.Workspace.grid(machine, points=3)
        >>> limits = ad.Requirements.of(machine, oil_total_share=1.05)
        >>> design = ad.optimize(machine, workspace, limits, vary=["areas"], starts=1)
        >>> print(f"{design.before.worst.frequency:.2f} to {design.after.worst.frequency:.2f} Hz")
        7.45 to 7.77 Hz
    """
    aimed = AimedSearch(vary=vary, objective=objective, start=start, options=options)
    if objective not in (names := [*OBJECTIVES, "bandwidth"]):
        fault = f"{objective!r} is not allowed"
        raise ArmDesignError("objective", fault, choose(str(objective), names))
    if objective != "bandwidth":
        if damping is not None:
            fault = f'means nothing where "{objective}" is to rise'
            raise ArmDesignError("damping", fault, 'leave it out, or give objective="bandwidth"')
        return best_frequency(machine, workspace, requirements, aimed)
    if options["bands"] not in (None, Bands()):
        fault = '"bandwidth" counts with the values of the file alone'
        raise ArmDesignError("objective", fault, "leave bands out, or give another objective")
    from armdesign.bandwidth_search import best_bandwidth  # needs the simulation

    return best_bandwidth(machine, workspace, requirements, aimed, damping)


def only_sizes(vary: Sequence[str], objective: str, damping: float | None = None) -> bool:
    """Whether ``size_cylinders`` answers: sizes alone vary, for a frequency."""
    return tuple(vary) == ("areas",) and objective in OBJECTIVES and damping is None
