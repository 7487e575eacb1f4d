"""Concessions: by how much to relax requirements in conflict, and the settings that do."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from armdesign.design.requirements.record import BESIDES, Concession, Requirement
from armdesign.design.requirements.settings import Requirements
from armdesign.errors import InfeasibleError
from armdesign.machine.file.key_paths import bounds
from armdesign.units import WORKSHOP, outward

DIGITS = 6  # of a setting that gives
IN_LINE = 3  # settings that a line says; more stand below the table
BELOW = " by the {} settings below the table"
WITHIN = 0.999  # of what a file allows it to give
ENOUGH = ", which is enough but not proved least"
UNSTATED = ", which no setting of a file allows"
OTHER_SIZES = ", or offer other sizes"
HEADS = ("requirement", "", "today's limit", "relax by", "to", "or it alone by")


def concessions(
    requirements: Requirements,
    subsets: Sequence[Sequence[str]],
    of: Mapping[str, Requirement],
    amounts: Mapping[str, float],
    alone: Mapping[str, float | None],
) -> tuple[Concession, ...]:
    """Amounts by which requirements in conflict are relaxed, with the settings that do it.

    Args:
        requirements: that are in conflict.
        subsets: names of the requirements of every irreducible infeasible subset.
        of: the requirements by their names.
        amounts: by which they are relaxed together, of those that are.
        alone: amount of each where no other of its subset is relaxed.
    """
    values: dict[str, float] = {}
    for name, amount in amounts.items():
        c = of[name]
        if c.setting and 0 < amount <= largest_share(requirements, c) * abs(c.limit):
            value = _granting(requirements, c, amount)
            values[c.setting] = (min if _falls(c) else max)(values.get(c.setting, value), value)
    return tuple(
        Concession(
            **of[name].identity,
            together=amounts.get(name, 0.0),
            alone=amounts.get(name, 0.0) if len(names) == 1 else alone.get(name),
            part=part,
            value=values.get(of[name].setting) if amounts.get(name, 0.0) > 0 else None,
        )
        for part, names in enumerate(subsets)
        for name in names
    )


def largest_share(requirements: Requirements, c: Requirement) -> float:
    """Share of its limit by which a requirement can be relaxed, to its end or a file's.

    Infinite where a file allows any number, zero where no number states the limit.
    """
    stated = _stated(requirements, c) if c.setting else 0.0
    if stated <= 0 or c.limit == 0:
        return 0.0
    if c.inverse or c.setting.startswith("outline."):  # names of links may have dots
        return math.inf
    low, high = bounds(("requirements", *c.setting.split(".")))
    return WITHIN * (1 - max(low / stated, c.end / c.limit) if c.at_least else high / stated - 1)


def _stated(requirements: Requirements, c: Requirement) -> float:
    """The number that states its limit, in the key's unit."""
    return requirements.setting(c.setting) if c.stated is None else c.stated


def _falls(c: Requirement) -> bool:
    """Whether its setting falls when it is relaxed: a lower limit, or a factor."""
    return c.at_least or c.inverse


def _granting(requirements: Requirements, c: Requirement, amount: float) -> float:
    """The setting that grants an amount, rounded to the granting side."""
    stated = _stated(requirements, c)
    ratio = 1 + (-1 if c.at_least else 1) * amount / c.limit
    value = stated * (1 / ratio if c.inverse else max(ratio, 0.0))
    return outward(value, DIGITS, not _falls(c))


# ------------------------------------------------------------------------------------------- words


def conflict_error(
    machine: str,
    conflict: Sequence[Concession],
    none_meets: str = "no design meets",
    settled: bool = True,
    otherwise: str = "",
    left: Sequence[str] = (),
    least: bool = True,
) -> InfeasibleError:
    """The error that says a conflict in one line, and several requirements in a table.

    Settings that would make the line long stand below the table, as options of a command.

    Args:
        machine: its name.
        conflict: what the requirements give.
        none_meets: what was looked for in vain.
        settled: whether what they give is enough for all requirements to be met.
        otherwise: what else helps.
        left: names of those that conflict still when all before are granted.
        least: whether no smaller amounts are enough.
    """
    parts = [
        [c for c in conflict if c.part == part]
        for part in dict.fromkeys(c.part for c in conflict if c.part != BESIDES)
    ]
    if len(conflict) == 1:
        by = "by at least" if least else "by"
        names, amount = _with_limit(conflict[0]), f" {by} {_amount(conflict[0])}"
    else:
        names = ", nor ".join(_together([c.name for c in one]) for one in parts)
        amount = ""
    more = "" if settled else "; others conflict besides"
    if left:
        more = f"; when all before was granted, {', '.join(left)} conflicted still"
    if besides := [c.name for c in conflict if c.part == BESIDES]:
        give = "gives" if len(besides) == 1 else "give"
        more = f"; as these alone gave no design, {_listed(besides)} {give} besides{more}"
    settings, options = _settings(conflict), _options(conflict)
    below = len(options) > IN_LINE and not amount
    if below:
        settings = BELOW.format(len(options))
    enough = ENOUGH if settings and settled and not least else ""
    if not (settings or settled):
        enough = UNSTATED
    return InfeasibleError(
        machine,
        f"{none_meets} {names}{more}",
        f"relax {'it' if amount else 'them'}{amount}{settings}{enough}{otherwise}",
        tuple(conflict),
        "" if amount else conflict_table(conflict, options if below else ()),
    )


def in_a_line(error: InfeasibleError) -> str:
    """What an error says, with all settings, where its table is not shown."""
    settings = _settings(error.conflict)
    return str(error).replace(BELOW.format(len(_options(error.conflict))), settings)


def nearest_error(
    machine: str,
    none_meets: str,
    missed: Sequence[Concession],
    otherwise: str = "",
    kind: type[InfeasibleError] = InfeasibleError,
) -> InfeasibleError:
    """The error with the amounts by which the nearest of some designs misses requirements.

    One is said in the line, several stand in a table below it.
    """
    words, several = "", len(missed) > 1
    if missed:
        one = f"{_with_limit(missed[0])} by {_amount(missed[0])}"
        words = f": the nearest misses {f'{len(missed)} of them' if several else one}"
    remedy = f"relax {'them' if several else 'it'}{_settings(missed)}{otherwise}"
    table = conflict_table(missed) if several else ""
    return kind(machine, f"{none_meets}{words}", remedy, tuple(missed), table)


def relaxations(conflict: Sequence[Concession]) -> str:
    """The concessions of a conflict as one line: by name and amount."""
    return ", ".join(f"{c.name} by {_amount(c)}" for c in conflict if c.together > 0)


def conflict_rows(conflict: Sequence[Concession]) -> list[tuple[str, ...]]:
    """A row for each requirement of a conflict, in the order of ``HEADS``.

    The last column is there only if relaxing one requirement alone helps.
    """
    rows: list[tuple[str, ...]] = []
    for c in conflict:
        sign = -1 if c.at_least else 1
        row = (
            c.name,
            c.words,
            f"{'at least' if c.at_least else 'at most'} {WORKSHOP.short(c.limit, c.unit)}",
            _amount(c) if c.together > 0 else "–",
            WORKSHOP.short(c.limit + sign * c.together, c.unit) if c.together > 0 else "–",
            "–" if c.alone is None or _single(c, conflict) else _given(c, c.alone),
        )
        rows.append(row)
    known = any(row[-1] != "–" for row in rows)
    return rows if known else [row[:-1] for row in rows]


def conflict_table(conflict: Sequence[Concession], options: Sequence[str] = ()) -> str:
    """The rows of a conflict as plain text, with a blank line between subsets.

    What stays as it is, is named below them, and the options of a command that relax the rest.
    """
    gives = [c for c in conflict if c.together > 0 or c.alone is not None] or conflict
    rows = conflict_rows(gives)
    heads = HEADS[: len(rows[0])]
    widths = [max(map(len, column)) for column in zip(heads, *rows, strict=True)]
    lines = ["  ".join(map(str.ljust, heads, widths)).rstrip()]
    for k, (c, row) in enumerate(zip(gives, rows, strict=True)):
        if k > 0 and c.part != gives[k - 1].part:
            lines.append("")
        lines.append("  ".join(map(str.ljust, row, widths)).rstrip())
    if stays := [c.name for c in conflict if c not in gives]:
        lines += ["", f"not relaxed: {', '.join(stays)}"]
    if options:
        words = [option for option in options if option.startswith("--")]
        lines += ["", *filter(None, [" ".join(words)]), *(o for o in options if o not in words)]
    return "\n".join(lines)


def _single(c: Concession, conflict: Sequence[Concession]) -> bool:
    """Whether a requirement cannot be met by itself."""
    return sum(other.part == c.part for other in conflict) == 1


def _together(names: Sequence[str]) -> str:
    """Names of requirements that conflict, in words."""
    first, *others = names
    return f"{first} together with {_listed(others)}" if others else first


def _listed(names: Sequence[str]) -> str:
    *several, last = names
    return f"{', '.join(several)} and {last}" if several else last


def _values(conflict: Sequence[Concession]) -> dict[str, str]:
    """The settings that grant all that a conflict needs, as they are written."""
    return {c.setting: f"{c.value:.{DIGITS}g}" for c in conflict if c.value is not None}


def _is_factor(setting: str) -> bool:
    """Whether a setting is given as a factor on today's numbers."""
    return setting.startswith("speed.")


def _settings(conflict: Sequence[Concession]) -> str:
    """The settings that grant all that a conflict needs."""
    values = [
        f"{setting} × {value}" if _is_factor(setting) else f"requirements.{setting} = {value}"
        for setting, value in _values(conflict).items()
    ]
    return f"{': ' if values else ''}{', '.join(values)}"


def _options(conflict: Sequence[Concession]) -> list[str]:
    """The same as options of a command; factors, which no option takes, in words."""
    return [
        f"and in the file every speed of [requirements.{setting}] × {value}"
        if _is_factor(setting)
        else f"--set requirements.{setting}={value}"
        for setting, value in _values(conflict).items()
    ]


def _with_limit(c: Concession) -> str:
    return (
        f"{c.name} ({c.words} {'at least' if c.at_least else 'at most'}"
        f" {WORKSHOP.short(c.limit, c.unit)})"
    )


def _amount(c: Concession) -> str:
    return _given(c, c.together)


def _given(c: Concession, amount: float) -> str:
    """An amount in its unit and as a share, both rounded up, so that what is read is enough."""
    percent = 100 * amount / abs(c.limit) if c.limit else 0.0
    digits = max(2, len(str(int(percent))))
    share = f" ({outward(percent, digits, True):g} %)" if c.limit else ""
    factor = WORKSHOP.table[c.unit][0]
    return f"{WORKSHOP.short(outward(amount / factor, 4, True) * factor, c.unit)}{share}"
