"""Runs of commands: the options that commands share, in groups, and what they ask for.

A command is a function. Where one of its parameters is a group, the command has the options of
that group, and the function receives them together, with the machine, folder and progress that
they stand for. So an option is declared once, and does the same in every command.
"""

from __future__ import annotations

import dataclasses
import inspect
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_type_hints

from armdesign.errors import ArmDesignError
from armdesign.option_values import (
    bands_to_use,
    grid_points,
    naming_options,
    offered_sizes,
    option_name,
)
from armdesign.options import (
    CatalogueOption,
    DampingOption,
    DurationOption,
    FreeOption,
    Habit,
    JsonOption,
    MachineArgument,
    NominalOption,
    ObjectiveOption,
    OutOption,
    OutsideOption,
    PictureFormat,
    PicturesOption,
    PointsOption,
    QuietOption,
    SeedOption,
    SetOption,
    ShapedModesOption,
    ShaperOption,
    ShareOption,
    SpreadOption,
    StartsOption,
    UnitsOption,
    WorkersOption,
)
from armdesign.output import changed, check_out, command_line, kept, outputs, show, stops, tell
from armdesign.progress import progress

if TYPE_CHECKING:
    from armdesign.frequency.workspace import Workspace
    from armdesign.json_document import Document, Tables
    from armdesign.machine.machine import Machine
    from armdesign.report.provenance import Origin
    from armdesign.report.sheet import Sheet

Command = Callable[..., None]
SHOWING = ("quiet", "json", "pictures")  # options that decide no answer


def command(function: Command, *, without: Collection[str] = ()) -> Command:
    """A command of a function: parameters that are groups become the options in them.

    Arguments come first, then the function's own options, then options of groups, but for those
    ``without`` which the command goes: they would change nothing.
    """
    name = function.__name__.removesuffix("_command").replace("_", "-")
    groups: dict[str, type[Any]] = {}
    own: list[inspect.Parameter] = []
    shared: list[inspect.Parameter] = []
    for parameter in inspect.signature(function, eval_str=True).parameters.values():
        if dataclasses.is_dataclass(parameter.annotation):
            groups[parameter.name] = parameter.annotation  # type: ignore[assignment]
            shared += (p for p in _options(parameter.annotation) if p.name not in without)
        else:
            own.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
    required = [p for p in [*shared, *own] if p.default is inspect.Parameter.empty]
    parameters = [*required, *(p for p in [*own, *shared] if p not in required)]

    def run(**given: Any) -> None:
        typed = [p for p in parameters if given.get(p.name, p.default) != p.default]
        names = {p.name: one for p in typed if (one := option_name(p.annotation))}
        for key, group in groups.items():
            values = {p.name: given.pop(p.name) for p in _options(group) if p.name in given}
            given[key] = group(**values, **({"command": name} if issubclass(group, Shown) else {}))
        shown = next(group for group in given.values() if isinstance(group, Shown))
        with shown.answering(), naming_options(names):
            function(**given)

    run.__name__, run.__doc__, run.__module__ = name, function.__doc__, function.__module__
    run.__annotations__ = {p.name: p.annotation for p in parameters}
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return run


def _options(group: Any) -> list[inspect.Parameter]:
    """Fields of a group, or of one of its kind, as parameters."""
    kinds = get_type_hints(group if isinstance(group, type) else type(group), include_extras=True)
    return [
        inspect.Parameter(
            one.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=_default(one),
            annotation=kinds[one.name],
        )
        for one in dataclasses.fields(group)
        if one.init and one.name != "command"
    ]


def _default(one: dataclasses.Field[Any]) -> Any:
    if one.default_factory is not dataclasses.MISSING:
        return one.default_factory()
    empty = one.default is dataclasses.MISSING
    return inspect.Parameter.empty if empty else one.default


@dataclass(frozen=True, kw_only=True)
class Shown:
    """A command that shows something.

    Attributes:
        command: its name.
        quiet: whether it shows nothing.
        json: whether it shows one JSON document.
        begun: when.
        until_end: what lasts as long as the command.
    """

    command: str
    quiet: QuietOption = False
    json: JsonOption = False
    begun: datetime = field(default_factory=lambda: datetime.now(UTC), init=False)
    until_end: ExitStack = field(default_factory=ExitStack, init=False, repr=False)

    @cached_property
    def document(self) -> Document:
        """The answer for other programs, filled while the command runs."""
        from armdesign import __version__
        from armdesign.json_document import Document

        return Document(armdesign=__version__, command=self.command, command_line=command_line())

    @contextmanager
    def answering(self) -> Iterator[None]:
        """Print the document after the block, if it is asked for, whatever ended the block."""
        try:
            with self.until_end:
                yield
            if self.json:
                self.document.finished = True
        except ArmDesignError as error:
            if self.json:
                self.document.add_fault(error)
            raise
        except KeyboardInterrupt as stop:
            stops.append(stop)
            raise
        finally:
            if self.json:
                for line in self.document.text().splitlines():
                    tell(line)

    @contextmanager
    def progress(self, text: str) -> Iterator[Callable[[str], None]]:
        """Show a status line, unless asked not to; yields a function that changes its text."""
        with progress(text, silent=self.quiet) as say:
            yield say

    def show(
        self,
        items: Sequence[Sheet | str],
        numbers: Callable[[], Mapping[str, Any]] = dict,
        tables: Tables | None = None,
    ) -> None:
        """Print sheets and sentences, or add them to the document.

        Args:
            items: to be printed.
            numbers: gives what they come down to, by name; for the document alone.
            tables: frames or columns by the name of their CSV file; for the document alone.
        """
        if self.json:
            self.document.add(items)
            self.document.add_answers(numbers(), tables or {})
        elif not self.quiet:
            show(items)

    def refuse(self, faults: Sequence[ArmDesignError]) -> None:
        """List faults on stderr, if there are any, and exit with code 2."""
        for fault in faults:
            tell(f"armdesign: {fault}", sys.stderr)
            if self.json:
                self.document.add_fault(fault)
        if faults:
            sys.exit(2)

    @contextmanager
    def writing(self, folder: Path) -> Iterator[Path]:
        """A folder to write into, whose files move to ``folder`` when complete, all or none."""
        with outputs(folder, silent=self.quiet or self.json) as place:
            yield place
        if self.json:
            self.document.folder = str(folder)
            self.document.files += [
                str(path.relative_to(folder)) for path in changed if path.is_relative_to(folder)
            ]


@dataclass(frozen=True, kw_only=True)
class Run(Shown):
    """A command that writes files.

    Attributes:
        out: folder for them; None: one named after the command and what it reads.
        pictures: format of pictures, which are there as PNG, too.
    """

    out: OutOption = None
    pictures: PicturesOption = PictureFormat.png

    def origin(self, *groups: Any, **more: Any) -> Origin:
        """Date and words of the command, with all options that decide its answer."""
        from armdesign.report.provenance import Origin

        options = {p.name: getattr(one, p.name) for one in (self, *groups) for p in _options(one)}
        deciding = {name: value for name, value in options.items() if name not in SHOWING}
        return Origin(command=command_line(), options=deciding | more, begun=self.begun)

    def go_on(self, out: Path) -> None:
        """Keep finished pieces until the command has ended well, and go on with another's pieces.

        Their journal is a file in the folder for files, named after the command.
        """
        self.until_end.enter_context(self._keeping(out / f"{self.command}.sqlite"))

    @contextmanager
    def _keeping(self, path: Path) -> Iterator[None]:
        from armdesign.journal.finished import keeping

        with keeping(path) as pieces:
            try:
                yield
            except KeyboardInterrupt as stop:
                if pieces.entries:
                    kept.append(path)
                    stop.args = (f"go on with: {command_line()}",)
                raise
            except (OSError, SystemExit):  # the files are in place, and nobody reads the rest
                if changed:
                    pieces.end()
                raise
        for sentence in () if self.quiet else pieces.of_other_runs():
            tell(f"armdesign: {sentence}", sys.stderr)

    @contextmanager
    def writing(self, folder: Path) -> Iterator[Path]:
        """As of a command that shows something, with pictures in the format that is asked for."""
        from armdesign.plots.canvas import saving_as

        with saving_as(self.pictures.value), super().writing(folder) as place:
            yield place

    def folder(self, *sources: str | Path) -> Path:
        """Folder for the files, which can be written: ``out/<command>_<machine>`` by default."""
        names = [self.command, *(Path(source).stem for source in sources)]
        folder = self.out or Path("out", "_".join(names))
        check_out(folder)
        return folder


@dataclass(frozen=True, kw_only=True)
class OfMachines(Run):
    """A command that reads machines.

    Attributes:
        set: changes of numbers of their files.
        units: units of printed tables.
        allow_outside: whether a URDF may lie outside the machine file's folder.
    """

    set: SetOption = field(default_factory=list)
    units: UnitsOption = Habit.workshop
    allow_outside: OutsideOption = False

    def load(self, name: str | Path, *, check: bool = True) -> Machine:
        """A machine, with the numbers that ``--set`` gives, of one key the last.

        ``check``: that it fits together.
        """
        from armdesign.machine.changes import changed_machine, read_changes
        from armdesign.machine.loading import load, load_unchecked

        changes = dict[str, Any]()
        for word in self.set:
            changes |= read_changes([word], "--set")
        model = (load if check else load_unchecked)(name, allow_outside=self.allow_outside)
        return changed_machine(model, changes, "--set", check=check) if changes else model

    def faults(self, name: str) -> list[ArmDesignError]:
        """All that makes a machine unusable; with ``--set`` the first fault."""
        from armdesign.inspection.file_faults import faults

        wrong = faults(name, allow_outside=self.allow_outside)
        if not wrong and self.set:
            try:
                self.load(name)
            except ArmDesignError as error:
                return [error]
        return wrong


@dataclass(frozen=True, kw_only=True)
class OfMachine(OfMachines):
    """A command that reads one machine.

    Attributes:
        machine: its file, folder or name.
    """

    machine: MachineArgument

    def open(self) -> tuple[Machine, Path]:
        """The machine, and the folder for files; numbers that look wrong are told at the end."""
        from armdesign.inspection.implausible_values import suspicions

        model = self.load(self.machine)
        for one in [] if self.quiet else suspicions(model, {})[::-1]:
            part = f"armdesign: {model.source.name}: {one.part} is taken as it stands"
            self.until_end.callback(tell, f"{part}, but {one.words}", sys.stderr)
        return model, self.folder(model.source)


@dataclass(frozen=True, kw_only=True)
class OverWorkspace(OfMachine):
    """A command that looks at a machine over its workspace.

    Attributes:
        points: grid points per joint.
    """

    points: PointsOption = ""

    def open_workspace(self) -> tuple[Machine, Workspace, Path]:
        """Machine, workspace and folder; options are judged before anything is computed."""
        from armdesign.frequency.workspace import Workspace

        counts = grid_points(self.points)
        model, folder = self.open()
        return model, Workspace.grid(model, counts), folder


@dataclass(frozen=True, kw_only=True)
class SearchOptions:
    """Options of a search for designs.

    Attributes:
        catalogue: sizes to choose from.
        free: whether any size is allowed.
        nominal: whether the file's values alone count.
        workers: processes; None: as many as the search usually takes.
    """

    catalogue: CatalogueOption = ""
    free: FreeOption = False
    nominal: NominalOption = False
    workers: WorkersOption = None

    @property
    def settings(self) -> dict[str, Any]:
        """Arguments of the functions that search."""
        return {
            "bands": bands_to_use(self.nominal),
            "catalogue": offered_sizes(self.catalogue, self.free),
            **({} if self.workers is None else {"workers": self.workers}),
        }


@dataclass(frozen=True, kw_only=True)
class DrawnSearch(SearchOptions):
    """Options of a search for designs from several starts.

    Attributes:
        starts: their number; None: as many as usually pay.
        seed: of those that are drawn.
    """

    starts: StartsOption = None
    seed: SeedOption = 0

    @property
    def settings(self) -> dict[str, Any]:
        """Arguments of the functions that search."""
        return {**super().settings, "starts": self.starts, "seed": self.seed}


@dataclass(frozen=True, kw_only=True)
class AimedSearch(DrawnSearch):
    """Options of a search for the best design by one of several objectives.

    Attributes:
        objective: what rises.
        damping: ratio on which bandwidths rest; None: the file's.
    """

    objective: ObjectiveOption = "gain"
    damping: DampingOption = None

    @property
    def settings(self) -> dict[str, Any]:
        """Arguments of the functions that search."""
        return {**super().settings, "objective": self.objective, "damping": self.damping}


@dataclass(frozen=True, kw_only=True)
class MoveOptions:
    """Options of a plan of a move.

    Attributes:
        shaper: its name.
        modes: how many it is made for; None: the lowest ones.
        damping: ratio that it is made for; None: the file's.
        duration: [s]; None: the shortest.
        share: of flow and force that is used; None: as much as does not jolt.
        spread: share by which the payloads that are tried are lighter and heavier.
    """

    shaper: ShaperOption = "zvd"
    modes: ShapedModesOption = None
    damping: DampingOption = None
    duration: DurationOption = None
    share: ShareOption = None
    spread: SpreadOption = 0.2

    @property
    def settings(self) -> dict[str, Any]:
        """Arguments of ``plan_move``."""
        return dataclasses.asdict(self)
