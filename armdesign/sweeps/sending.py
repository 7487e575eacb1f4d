"""A study on its way to other processes.

A function typed into a program travels as it is. What modules have travels by name: a process
that has loaded another state of their files, or whose values were changed since, would answer
otherwise than the program that asks. So digests travel beside the study, and are compared.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from armdesign.errors import ArmDesignError, InfeasibleError
from armdesign.journal.keys import canonical, version_of_sources
from armdesign.sweeps.reach import digests_of, names_reached

if TYPE_CHECKING:
    from armdesign.sweeps.worker import Study


class Sent(NamedTuple):
    """A study as it travels.

    Attributes:
        name: of the study.
        version: of the package that made it.
        names: of what its task reaches in modules of the user's.
        code: digests of all that makes that up, in words.
        study: pickle of the study.
    """

    name: str
    version: str
    names: Sequence[str]
    code: Mapping[str, str]
    study: bytes


_same: set[str] = set()  # code that was the same here; what tasks then change in it is their own


def sent(study: Study, others: Any, dumps: Callable[[Any], Any]) -> Sent:
    """A study as bytes.

    Args:
        study: any.
        others: what will travel later.
        dumps: pickles as those do that send it.

    Raises:
        ArmDesignError: it cannot be written for other processes.
    """
    try:
        written = bytes(dumps(study))
        dumps(others)
    except Exception as error:  # of any kind, as a task or option has its own way
        remedy = "take workers=1, or a function of a module and plain options"
        fault = f"cannot be sent to other processes ({words_of(error)})"
        raise ArmDesignError("task or options", fault, remedy) from None
    names = [] if isinstance(study.task, str) else names_reached(study.task)
    return Sent(study.name, study.version, names, digests_of(names), written)


def received(sent: Sent) -> Study:
    """The study that was sent.

    Raises:
        ArmDesignError: it was made by another version of the package, or from other files than
            this process has; or these are not here.
    """
    own = version_of_sources()
    if sent.version != own:
        fault = f"has armdesign {own}, the study comes from {sent.version}"
        remedy = "install the same version on all machines, and begin Python anew after an edit"
        raise ArmDesignError("worker", fault, remedy)
    try:
        _refuse_other_code(sent.names, sent.code)
        study: Study = pickle.loads(sent.study)
    except ArmDesignError:
        raise
    except Exception as error:  # whatever a module raises that is loaded
        fault = f"cannot load the study ({words_of(error)})"
        raise ArmDesignError("worker", fault, "install your modules there, too") from None
    return study


def _refuse_other_code(names: Sequence[str], code: Mapping[str, str]) -> None:
    if (whole := canonical(code)) in _same:
        return
    own = digests_of(names)
    for words, there in code.items():
        if own.get(words) != there:
            fault = f"has another {words} than your program"
            remedy = "it was changed since one of both loaded it, or each makes its own: start "
            remedy += "Python anew, and workers of a cluster, or take workers=1"
            raise ArmDesignError("worker", fault, remedy)
    _same.add(whole)


def words_of(error: BaseException) -> str:
    """What an error says, behind its kind where it is none of ours."""
    try:
        if isinstance(error, InfeasibleError):
            from armdesign.design.search.infeasibility.concessions import in_a_line

            return in_a_line(error)
        own = isinstance(error, ArmDesignError)
        return str(error) if own else f"{type(error).__name__}: {error}"
    except Exception:  # of a kind that cannot say it
        return type(error).__name__
