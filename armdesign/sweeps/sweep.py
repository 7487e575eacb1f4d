"""``sweep``: one question asked of many machines, its answers as one frame."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from numbers import Integral
from operator import index
from pathlib import Path
from typing import Any, TypedDict, Unpack
from uuid import uuid4

from armdesign.arguments import checked, refuse_unless, with_options
from armdesign.errors import ArmDesignError, Stopped, choose
from armdesign.frequency.workspace import Workspace
from armdesign.journal.finished import Form, all_finished, is_keeping
from armdesign.journal.journal import Entry, Journal
from armdesign.journal.keys import canonical, digest, exact, version_of_sources
from armdesign.machine.changed_parts import refuse_changed_parts
from armdesign.machine.loading import load
from armdesign.machine.machine import Machine
from armdesign.processes import may_begin
from armdesign.progress import rounds
from armdesign.sweeps.answers import (
    COLUMNS,
    Sweep,
    names_of,
    refuse_names,
    within_columns,
    writable,
)
from armdesign.sweeps.cases import Case, Changes, changes_of, plain, refuse_many
from armdesign.sweeps.numbers import Numbers, names_of_changes
from armdesign.sweeps.tasks import Task, identity_of, refuse_options
from armdesign.sweeps.worker import Outcome, Study, answer, forget, prepare


class Variants(TypedDict, total=False):
    """What differs between cases, beside machines, changes and options of the task."""

    sobol: int
    seed: int
    payloads: Sequence[str] | None
    requirements: Sequence[Mapping[str, Any]] | None


class Means(TypedDict, total=False):
    """How cases get their answers, which depend on none of it."""

    workers: int
    scheduler: str | None
    journal: str | Path | None
    new: bool
    say: Callable[[str], None] | None


class SweepOptions(Variants, Means, total=False):
    """What differs between the cases of a sweep, how they get answers, and which are shown."""

    outputs: Sequence[str] | None


USUAL_SWEEP: SweepOptions = {
    "sobol": 0,
    "seed": 0,
    "payloads": None,
    "requirements": None,
    "outputs": None,
    "workers": 1,
    "scheduler": None,
    "journal": None,
    "new": False,
    "say": None,
}


@checked
@with_options(SweepOptions, USUAL_SWEEP)
def sweep(
    machine: Machine | str | Path | Sequence[Machine | str | Path],
    changes: Mapping[str, Sequence[Any]] | Sequence[Changes] | str | Path | None = None,
    task: str | Callable[..., Numbers] = "map",
    *,
    options: Mapping[str, Any] | Sequence[Mapping[str, Any]] | None = None,
    workspace: Workspace | None = None,
    points: int | Sequence[int] | None = None,
    **more: Unpack[SweepOptions],
) -> Sweep:
    """Answers of one task for every machine, load case, change and set of requirements.

    The numbers are the same for any number of workers, here or on a cluster.

    Args:
        machine: a machine or several, also by name or path.
        changes: of the machine file, by key path: a mapping of lists is a grid, all combinations;
            a sequence of mappings is a list of cases, a path a CSV file with a column per key
            path. None: the machine as it is.
        task: "map", "design", "validate", "control" or "simulate"; or a function of machine,
            workspace and options that returns numbers and words by name.
        sobol: number of points of a Sobol sequence between the two ends that ``changes`` then has
            for each key path.
        seed: of that sequence.
        payloads: names of load cases, each alone; None: all together.
        requirements: keys of ``[requirements]``, whether the file has them or not, and their
            values, or tables that add to the file's, one mapping per set.
        outputs: names of the answers that the frame has, in this order; None: all. A journal has
            all of them.
        options: of the task, numbers, words, lists, requirements and bands, of which every case
            has a copy; several sets of them are a case each.
        workspace: the poses of all cases; None: a joint grid of every changed machine.
        points: of that grid.
        workers: processes; 1: this one, which does all in a worker that may begin none.
        scheduler: address of a dask scheduler, as ``tcp://host:8786``, in place of ``workers``.
        journal: file in which every finished case stays; what is in it is not computed again.
            Without one a command or study that keeps what is finished keeps the cases, too.
        new: set a journal that exists aside.
        say: told after every case how many have an answer.

    Raises:
        ArmDesignError: anything that keeps all cases from an answer. What is wrong with one case
            is in the frame. Where a function gives none of some ``outputs``, which is known at
            the end, ``finished`` of the error has all answers.
        Stopped: Ctrl-C, with the cases that were finished before it.

    Example:
        >>> import armdesign as ad
        >>> machine = ad.load("paper_1dof")
        >>> answers = ad.sweep(machine, {"payload.load.mass_kg": [100, 200]}, points=3)
        >>> columns = ["payload.load.mass_kg", "worst_hz"]
        >>> print(answers.frame[columns].round(2).to_string(index=False))
         payload.load.mass_kg  worst_hz
                          100     10.54
                          200      7.45
    """
    for name in ("outputs", "payloads"):
        refuse_unless(name, more[name], "Sequence[str] | None")
    _refuse_together(workspace, points, more)
    chosen = changes_of(changes, more["requirements"], more["sobol"], more["seed"])
    shared, sets = (options, [{}]) if isinstance(options, Mapping) else ({}, options or [{}])
    for one in (shared, *sets):
        refuse_options(task, one)
    ours = isinstance(task, str)
    shared, *sets = (plain(one, "options", arrays=ours) for one in (shared, *sets))
    paths, names = ({name for one in each for name in one} for each in (chosen, sets))
    refuse_names(paths, names, {*(more["outputs"] or ())})
    kept = more["journal"] is not None or is_keeping()
    identity = identity_of(task) if kept or ours else uuid4().hex
    machines = _machines(machine)
    for model in machines.values():
        if workspace is not None:
            workspace.refuse_other_joints(model)
        if any(chosen):
            refuse_changed_parts(model)
    study = _study(machines, (task, identity), shared, workspace, points)
    refuse_many(len(study.machines) * len(more["payloads"] or [0]) * len(chosen) * len(sets))
    cases = list(_cases(study, chosen, more["payloads"], sets))
    run = _CaseRunner(
        study=study,
        columns=frozenset({*COLUMNS, *map(writable, paths | names)}),
        workers=more["workers"],
        scheduler=more["scheduler"],
        say=more["say"] or (lambda _: None),
        outputs=None if more["outputs"] is None else tuple(more["outputs"]),
    )
    if more["journal"] is None:
        return run.answers(cases, None)
    if more["new"]:
        run.refuse_unreachable()
    files = files_of(study.machines.values())
    with Journal(Path(more["journal"]), files, study.version, more["new"]) as journal:
        return run.answers(cases, journal)


def _refuse_together(workspace: Workspace | None, points: Any, more: SweepOptions) -> None:
    """Raise for arguments of which one has no meaning beside the other, or without it."""
    if workspace is not None and points is not None:
        fault = "goes not with workspace, which has poses of its own"
        raise ArmDesignError("points", fault, "leave one out")
    if more["new"] and more["journal"] is None:
        raise ArmDesignError("new", "is of no journal", "give journal too, or leave it out")


@dataclass(kw_only=True)
class _CaseRunner:
    """Means by which cases get their answers."""

    study: Study
    columns: frozenset[str]  # of the frame, beside answers
    workers: int
    scheduler: str | None
    say: Callable[[str], None]
    outputs: tuple[str, ...] | None
    retried: list[str] = field(default_factory=list)
    computed: set[str] = field(default_factory=set)
    answered: set[str] = field(default_factory=set)  # machines that have an answer

    def refuse_unreachable(self) -> None:
        """Raise for a scheduler that is not there, before a journal is set aside."""
        if self.scheduler is not None:
            from armdesign.sweeps.cluster import refuse_unreachable

            refuse_unreachable(self.scheduler)

    def answers(self, cases: Sequence[Case], journal: Journal | None) -> Sweep:
        """The cases with the answers that a journal has, and those that are computed.

        Raises:
            Stopped: Ctrl-C, with the cases that were finished before it.
        """
        different = list({case.key: case for case in cases}.values())
        known: dict[str, Entry] = {}
        try:
            if journal:
                self._beside(journal, different, known)
            else:
                self._within_a_command(different, known)
        except KeyboardInterrupt as stop:
            raise Stopped(self._sweep(cases, known)) from stop
        try:
            self._refuse_unknown_outputs(known.values())
        except ArmDesignError as error:
            error.finished = replace(self._sweep(cases, known), outputs=None)
            raise
        return self._sweep(cases, known)

    def _sweep(self, cases: Sequence[Case], known: Mapping[str, Entry]) -> Sweep:
        """The cases that have an answer."""
        finished = tuple(case for case in cases if case.key in known)
        return Sweep(
            cases=finished,
            outcomes=tuple(known[case.key] for case in finished),
            kept=sum(case.key not in self.computed for case in finished),
            retried=tuple(self.retried),
            outputs=self.outputs,
        )

    def _refuse_misspelt_outputs(self, outcomes: Iterable[Entry]) -> None:
        """Raise for chosen answers that no case will have, once every machine has answers.

        Our own tasks have the same ones for all cases of a machine, but for what a design changes.
        """
        if isinstance(self.study.task, str) and self.answered == set(self.study.machines):
            self._refuse_unknown_outputs(outcomes)

    def _refuse_unknown_outputs(self, outcomes: Iterable[Entry]) -> None:
        """Raise for chosen answers that no case has or could have, if any case has answers."""
        known = names_of(outcomes)
        if not known or set(known).issuperset(self.outputs or ()):
            return
        if self.study.task == "design":
            known += names_of_changes(self.study.machines.values())
        for name in self.outputs or ():
            if name not in known:
                raise ArmDesignError("outputs", f"no case has {name!r}", choose(name, known))

    def _beside(self, journal: Journal, cases: Sequence[Case], known: dict[str, Entry]) -> None:
        """Fill in the answers that the sweep's own journal has, and those that are computed."""
        entries = journal.entries()
        known |= {c.key: self._in_frame(entries[c.key]) for c in cases if c.key in entries}
        for case, outcome in self._told([c for c in cases if c.key not in known], known):
            if outcome.final:
                journal.keep(case.key, case.name, outcome)

    def _within_a_command(self, cases: Sequence[Case], known: dict[str, Entry]) -> None:
        """Fill in all answers; those that the journal of a command has are not computed again."""
        numbers = {case.key: k for k, case in enumerate(cases)}

        def compute(missing: list[int]) -> Iterator[tuple[int, Entry]]:
            for case, outcome in self._told([cases[k] for k in missing], known):
                yield numbers[case.key], outcome

        def read(k: int, answer: Mapping[str, Any]) -> Entry:
            return known.setdefault(cases[k].key, self._in_frame(Entry(**answer)))

        form = Form(write=_written, read=read)
        all_finished("case", len(cases), lambda k: cases[k].key, compute, form)

    def _told(
        self, cases: Sequence[Case], known: dict[str, Entry]
    ) -> Iterator[tuple[Case, Outcome]]:
        """Cases with their outcomes as they come, counted once they were taken."""
        count = len(cases) + len(known)
        with rounds("case", count, before=len(known)) as finished:
            for case, outcome in self._outcomes(cases):
                yield case, outcome
                known[case.key] = self._in_frame(outcome)
                self.computed.add(case.key)
                if known[case.key].answer and case.machine not in self.answered:
                    self.answered.add(case.machine)
                    self._refuse_misspelt_outputs(known.values())
                self.say(f"{len(known)} of {count} cases")
                finished(len(known))

    def _outcomes(self, cases: Sequence[Case]) -> Iterator[tuple[Case, Outcome]]:
        """Cases and outcomes as they come, by the means that were chosen."""
        if not cases:
            return
        if self.scheduler is not None:
            from armdesign.sweeps.cluster import on_cluster

            yield from on_cluster(self.study, cases, self.scheduler, self._died, self.say)
        elif self.workers > 1 and may_begin():
            from armdesign.sweeps.processes import on_processes

            yield from on_processes(self.study, cases, self.workers, self._died)
        else:
            prepare(self.study)
            try:
                yield from ((case, answer(self.study.name, case)) for case in cases)
            finally:
                forget(self.study.name)

    def _in_frame(self, entry: Entry) -> Entry:
        return within_columns(entry, self.columns)

    def _died(self, case: Case) -> None:
        self.retried.append(case.name)
        self.say(f"a worker died; again: {case.name}")


def _written(_: int, entry: Entry) -> dict[str, Any] | None:
    """What a command's journal has of an outcome; None where another may come out."""
    if isinstance(entry, Outcome) and not entry.final:
        return None
    return {"answer": dict(entry.answer), "seconds": entry.seconds, "error": entry.error}


def _machines(
    machine: Machine | str | Path | Sequence[Machine | str | Path],
) -> dict[str, Machine]:
    """Machines by their names.

    Raises:
        ArmDesignError: none, or two of one name.
    """
    several = [machine] if isinstance(machine, Machine | str | Path) else list(machine)
    loaded = [one if isinstance(one, Machine) else load(one) for one in several]
    named = {one.name: one for one in loaded}
    if not named or len(named) < len(loaded):
        fault = "two have one name" if named else "there is none"
        raise ArmDesignError("machines", fault, "give machines of different names")
    return named


def _study(
    machines: Mapping[str, Machine],
    task: tuple[str | Task, str],
    options: Mapping[str, Any],
    workspace: Workspace | None,
    points: Any,
) -> Study:
    """Data that all cases share; ``task`` has its identity beside it."""
    if points is not None:
        one = isinstance(points, Integral)
        points = index(points) if one else [index(count) for count in points]
    poses = workspace and workspace.identity
    try:
        shared = canonical([version_of_sources(), task[1], exact(dict(options)), poses, points])
    except (TypeError, ValueError):
        raise _unwritten(options=options) from None
    return Study(
        identity=digest(shared),
        version=version_of_sources(),
        machines=machines,
        task=task[0],
        options=options,
        workspace=workspace,
        points=points,
    )


def files_of(machines: Iterable[Machine]) -> dict[str, str]:
    """Digests of all files of machines, by names that tell them apart."""
    files = {}
    for machine in machines:
        files[f"{machine.name}: {machine.source.name}"] = digest(machine.text)
        if machine.section.urdf:
            files[f"{machine.name}: {machine.section.urdf}"] = digest(machine.urdf_text)
    return files


def _unwritten(**given: Mapping[str, Any]) -> ArmDesignError:
    """Error of the first of changes or options that no journal can hold."""
    for kind, values in given.items():
        for name, value in values.items():
            try:
                canonical(exact(value))
            except TypeError as error:
                why = str(error)
            except ValueError:
                why = "a number of thousands of digits, or a list within itself"
            else:
                continue
            fault = f"cannot be written down: {why}"
            return ArmDesignError(f"{kind}.{name}", fault, "give numbers, texts and lists of them")
    return ArmDesignError(" or ".join(given), "cannot be written down", "give texts as names")


def _cases(
    study: Study,
    chosen: Sequence[Changes],
    payloads: Sequence[str] | None,
    sets: Sequence[Mapping[str, Any]],
) -> Iterator[Case]:
    """The cases with their keys.

    Raises:
        ArmDesignError: load cases that do not exist.
    """
    for name, machine in study.machines.items():
        identity = digest([study.identity, machine.identity])
        for payload in payloads or (None,):
            if payload is not None:
                machine.with_payload(payload)  # refused before anything is computed
            for changes, options in product(chosen, sets):
                try:
                    key = digest([identity, payload, exact(dict(changes)), exact(dict(options))])
                except (TypeError, ValueError):
                    raise _unwritten(changes=changes, options=options) from None
                yield Case(
                    key=key, machine=name, payload=payload, changes=changes, options=options
                )
