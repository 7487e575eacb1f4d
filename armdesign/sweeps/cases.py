"""Cases of a sweep: changes by key path, from a grid, a Sobol sequence, a list or a CSV file."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from numbers import Integral, Real
from pathlib import Path
from typing import Any

from armdesign.arguments import refuse_unless_seed
from armdesign.arrays import sobol
from armdesign.csv_rows import NUMBER, read_rows
from armdesign.errors import ArmDesignError
from armdesign.machine.changes import toml_value

Changes = Mapping[str, Any]
MOST = 1_000_000  # cases of one sweep
OF_SWEEP = "of a sweep, [case.changes for case in sweep.cases]"  # the changes that it had
LARGEST = 1e300  # of a range, so that its width is a number


@dataclass(frozen=True, kw_only=True)
class Case:
    """One case of a sweep.

    Attributes:
        key: digest of everything that decides its answer.
        machine: name of the machine that is changed.
        payload: the one load case that counts; None: all.
        changes: values by key path of the machine file.
        options: of the task, beside those that all cases share.
    """

    key: str
    machine: str
    payload: str | None
    changes: Changes
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def settings(self) -> Mapping[str, Any]:
        """Changes, and options of its own."""
        return {**self.changes, **self.options}

    @property
    def name(self) -> str:
        """The case in words, as ``boom, full, fluid.bulk_modulus_MPa=900``."""
        changed = [
            f"{path}={value}"
            for path, value in self.settings.items()
            if value is not None and not hasattr(value, "identity")
        ]
        return ", ".join([self.machine, *([self.payload] if self.payload else []), *changed])


def grid_changes(values: Mapping[str, Sequence[Any]]) -> list[Changes]:
    """All combinations of values by key path, the last path's changing fastest.

    Raises:
        ArmDesignError: no values, or more combinations than anybody waits for.
    """
    rows: list[list[Any]] = []
    for path, row in values.items():
        if isinstance(row, str) or not _is_listed(row):
            remedy = "give a list, such as [110, 120]"
            raise ArmDesignError(str(path), f"{row!r} is no list of values", remedy)
        rows.append(_first(MOST, row))
        if not rows[-1]:
            raise ArmDesignError(str(path), "has no values", "give some, or leave the path out")
    refuse_many(math.prod(map(len, rows)))
    paths = list(values)
    return [dict(zip(paths, row, strict=True)) for row in itertools.product(*rows)]


def sobol_changes(
    ranges: Mapping[str, Sequence[float]], count: int, seed: int = 0
) -> list[Changes]:
    """Points of a scrambled Sobol sequence between two ends by key path.

    Raises:
        ArmDesignError: a count, a seed or ends that cannot be.
    """
    import numpy as np
    from scipy.stats import qmc

    if isinstance(count, bool) or not isinstance(count, Integral) or count < 1:
        raise ArmDesignError("sobol count", f"{count!r} is not allowed", "give a whole number ≥ 1")
    refuse_unless_seed(seed)
    refuse_many(count)
    rows = {path: _first(2, ends) for path, ends in ranges.items()}
    for path, row in rows.items():
        if not _is_range(row):
            fault = f"{ranges[path]!r} is no range"
            raise ArmDesignError(str(path), fault, "give two numbers, the lower one first")
    low, high = np.array(list(rows.values()), float).reshape(-1, 2).T
    if not 0 < low.size <= qmc.Sobol.MAXDIM:
        fault = f"has {low.size} ranges" if low.size else "has no ranges"
        remedy = f"give two ends by key path, of 1 to {qmc.Sobol.MAXDIM} numbers"
        raise ArmDesignError("sobol", fault, remedy)
    points = sobol(low.size, count, seed)
    return [dict(zip(ranges, row, strict=True)) for row in (low + points * (high - low)).tolist()]


def _first(count: int, values: Any) -> list[Any]:
    """The first values, which may be made one by one, and one more if there are more."""
    return list(itertools.islice(values, count + 1)) if _is_listed(values) else []


def _is_listed(values: Any) -> bool:
    """Whether values come one by one, as of an array that is no number alone."""
    return isinstance(values, Iterable) and getattr(values, "ndim", 1) > 0


def _is_range(row: list[Any]) -> bool:
    if len(row) != 2 or any(isinstance(x, bool) or not isinstance(x, Real) for x in row):
        return False
    return bool(-LARGEST < row[0] < row[1] < LARGEST)


def csv_changes(path: str | Path) -> list[Changes]:
    """A case for each row of a CSV file, whose columns are key paths; empty fields change nothing.

    Raises:
        ArmDesignError: a file that cannot be read, or has no rows or too many.
    """
    names, rows = read_rows(path, most=MOST)
    if not rows:
        raise ArmDesignError(str(path), "has no rows", "give a case per line below the key paths")
    return [
        {name: _value(text) for name, text in zip(names, texts, strict=True) if text}
        for _, texts in rows
    ]


def changes_of(
    changes: Mapping[str, Sequence[Any]] | Sequence[Changes] | str | Path | None,
    requirements: Sequence[Changes] | None,
    sobol: int | None,
    seed: int,
) -> list[Changes]:
    """Changes of all cases, each with every set of requirements; see ``sweep``.

    Raises:
        ArmDesignError: no changes that can be made, or no ranges for a Sobol sequence.
    """
    if not sobol:
        refuse_unless_seed(seed)
        if seed:
            raise ArmDesignError("seed", "is of no sequence", "give sobol too, or no seed")
        chosen = all_changes(changes)
    elif isinstance(changes, Mapping):
        chosen = sobol_changes(changes, sobol, seed)
    else:
        raise ArmDesignError("sobol", "has no ranges", "give changes as two ends by key path")
    sets = [
        by_key_path({f"requirements.{name}": value for name, value in rules.items()}, "sweep")
        for rules in requirements or [{}]
    ]
    refuse_many(len(chosen) * len(sets))
    for path in {p for one in chosen for p in one} & {p for rules in sets for p in rules}:
        raise ArmDesignError(path, "is given in changes and in requirements", "give it once")
    return [plain({**one, **rules}, "changes") for one in chosen for rules in sets]


def all_changes(
    changes: Mapping[str, Sequence[Any]] | Sequence[Changes] | str | Path | None,
) -> list[Changes]:
    """Changes of every case: a mapping is a grid, a path a CSV file, a sequence a list.

    Raises:
        ArmDesignError: changes that are none of these.
    """
    if changes is None:
        return [{}]
    if isinstance(changes, str | Path):
        return csv_changes(changes)
    if isinstance(changes, Mapping):
        return grid_changes(changes)
    listed = list(changes)
    refuse_many(len(listed))
    for one in listed:
        if not isinstance(one, Mapping):
            fault, remedy = f"{one!r} is no case", "give values by key path"
            if hasattr(changes, "to_dict"):
                remedy = f'of a frame, frame.to_dict("records"), {OF_SWEEP}'
            raise ArmDesignError("changes", fault, remedy)
    return listed


def by_key_path(table: Mapping[str, Any], part: str) -> Changes:
    """Values of nested tables by key path.

    Args:
        table: of key paths, and of tables of them.
        part: that has it, for messages.

    Raises:
        ArmDesignError: a path is there in two ways, as ``a.b`` and in a table ``a``.
    """
    flat: dict[str, Any] = {}
    for path, value in _leaves(table):
        if path in flat:
            raise ArmDesignError(f"{part}.{path}", "is there twice", "leave one out")
        flat[path] = value
    return flat


def _leaves(table: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from _leaves(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value


def plain(values: Mapping[str, Any], part: str, *, arrays: bool = True) -> dict[str, Any]:
    """Values by name, in new lists and dicts; NumPy's numbers and arrays as Python's.

    The keys of a dict within them are in order.

    Args:
        values: any.
        part: that has them, for messages.
        arrays: whether arrays may become lists, which to a function is not the same.

    Raises:
        ArmDesignError: a dict whose keys are no texts, a list in itself, or an array.
    """
    try:
        return {name: _plain(value, f"{part}.{name}", arrays) for name, value in values.items()}
    except RecursionError:
        fault = "has values within values without end"
        raise ArmDesignError(part, fault, "give numbers and texts") from None


def _plain(value: Any, part: str, arrays: bool) -> Any:
    if hasattr(value, "tolist"):
        value = value.tolist()
        if not arrays and isinstance(value, list):
            remedy = "give a list, and make an array of it in the function"
            raise ArmDesignError(part, "is an array, of which no journal knows the kind", remedy)
    if isinstance(value, dict):
        for key in value:
            if not isinstance(key, str):
                raise ArmDesignError(part, f"the key {key!r} is no text", "give texts as keys")
        return {key: _plain(value[key], f"{part}.{key}", arrays) for key in sorted(value)}
    if type(value) in (list, tuple):
        return type(value)(_plain(one, part, arrays) for one in value)
    return value


def refuse_many(count: int) -> None:
    """Raise for no cases, or more than anybody waits for."""
    if not 0 < count <= MOST:
        fault = f"{count} cases are not allowed"
        raise ArmDesignError("changes", fault, f"give 1 to {MOST}")


def _value(text: str) -> Any:
    """What a field of a CSV file says: a number, a list, true or false, or a text.

    A list is as in TOML, and so is a text in quotes of its own: "1" is no number.
    """
    if text.startswith(("[", '"')):
        return toml_value(text)
    for kind in (int, float) if NUMBER.fullmatch(text) else ():
        try:
            return kind(text)
        except ValueError:
            continue
    return {"true": True, "false": False}.get(text.lower(), text)  # spreadsheets write TRUE
