"""Designs and refusals in a journal: what is kept of them, and the designs and refusals of that.

Kept are the texts and numbers that took long to find. Maps are made anew of them, and requirements
judged anew.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from armdesign.design.catalogue.branch_and_bound import SizeSelection
from armdesign.design.program.problem import Problem
from armdesign.design.requirements.record import Concession
from armdesign.design.search.rounding import CheckedMachine
from armdesign.errors import InfeasibleError, UntriedError
from armdesign.frequency.bands import Corner
from armdesign.journal.finished import Form, finished
from armdesign.machine.machine import Machine

if TYPE_CHECKING:
    from armdesign.design.design import Design

NUMBERS = ("prices", "at_margin", "unrounded", "starts", "failed_starts")
SAID = ("part", "fault", "remedy", "table", "line", "key", "drawn")  # by a refusal
REFUSALS = {kind.__name__: kind for kind in (InfeasibleError, UntriedError)}


def finished_design(
    make: type[Design], problem: Problem, identity: Any, compute: Callable[[], Design]
) -> Design:
    """The design of a problem from the journal, or computed and kept there.

    ``identity`` is everything beside the problem that decides it.

    Raises:
        InfeasibleError: there is none, as was found now or before.
    """

    def found() -> Design | InfeasibleError:
        try:
            return compute()
        except InfeasibleError as error:
            return error

    either: Form[Design | InfeasibleError] = Form(
        write=lambda _, one: answer_of(one, problem),
        read=lambda _, answer: found_in(make, answer, problem),
    )
    one = finished("design", lambda: [problem.identity, identity], found, either)
    if isinstance(one, InfeasibleError):
        raise one
    return one


def answer_of(found: Design | InfeasibleError, problem: Problem) -> dict[str, Any] | None:
    """Entry of a design of a problem or of why there is none; None where it would not be all."""
    return _refusal(found) if isinstance(found, InfeasibleError) else kept(found, problem)


def found_in(
    make: type[Design], answer: Mapping[str, Any], problem: Problem
) -> Design | InfeasibleError:
    """The design of a problem that an entry has, or why there is none."""
    if "conflict" not in answer:
        return make(**fields_of(answer, problem))
    said = {name: answer[name] for name in SAID}
    conflict = tuple(Concession(**fields) for fields in answer["conflict"])
    error = REFUSALS[answer["kind"]](said["part"], said["fault"], said["remedy"], conflict)
    vars(error).update(said)
    error.tell_line(said["line"])
    return error


def _refusal(error: InfeasibleError) -> dict[str, Any]:
    return {
        "kind": type(error).__name__,
        "conflict": [asdict(concession) for concession in error.conflict],
        **{name: getattr(error, name) for name in SAID},
    }


def form(make: type[Design], problems: Sequence[Problem]) -> Form[Design]:
    """Form in which designs of problems are kept."""
    return Form(
        write=lambda k, design: kept(design, problems[k]),
        read=lambda k, answer: make(**fields_of(answer, problems[k])),
    )


def kept(design: Design, problem: Problem) -> dict[str, Any] | None:
    """Entry of a design of a problem in a journal; None where that would not be all."""
    own, today = design.problem, problem.machine
    limits = {
        name: value
        for name, value in vars(own.requirements).items()
        if value != getattr(problem.requirements, name)
    }
    numbers = all(isinstance(value, float) for value in limits.values())
    between = own.dynamics.corners.between
    same = replace(problem, requirements=own.requirements, sizes=own.sizes).counting(between)
    if not numbers or same.identity != own.identity or design.machine.urdf_text != today.urdf_text:
        return None
    return {
        "text": design.machine.text,
        "source": design.machine.source.name,
        "limits": limits,
        "sizes": own.sizes,
        "between": [one.plain for one in between],
        "x": design.x.tolist(),
        "watched": design.watched.tolist(),
        "best_sizes": design.best_sizes and asdict(design.best_sizes),
        **{name: getattr(design, name) for name in NUMBERS},
    }


def fields_of(answer: Mapping[str, Any], problem: Problem) -> dict[str, Any]:
    """Fields of the design of a problem that a journal has kept."""
    sizes = tuple(size and (size[0], size[1]) for size in answer["sizes"])
    requirements = replace(problem.requirements, **answer["limits"])
    between = tuple(Corner(frozenset(soft), *masses) for soft, *masses in answer["between"])
    if between:
        problem = problem.counting(between)
    problem, today = replace(problem, requirements=requirements, sizes=sizes), problem.machine
    source = today.source.with_name(answer["source"])
    machine = Machine.from_text(answer["text"], today.urdf_text, source).loaded_like(today)
    return {
        "machine": machine,
        "today": today,
        "requirements": requirements,
        "checks": CheckedMachine.of(machine, problem).checks,
        "workspace": problem.workspace,
        "problem": problem,
        "x": np.array(answer["x"]),
        "watched": np.array(answer["watched"], dtype=int),
        "best_sizes": _best_sizes(answer["best_sizes"]),
        **{name: answer[name] for name in NUMBERS},
        **{name: tuple(answer[name]) for name in ("starts", "failed_starts")},
    }


def _best_sizes(fields: Mapping[str, Any] | None) -> SizeSelection | None:
    if fields is None:
        return None
    sizes = tuple((bore, rod) for bore, rod in fields["sizes"])
    return SizeSelection(**{**fields, "sizes": sizes})
