"""Conflicts: which requirements no design meets together, and how much they must give.

A requirement without which the others can be met belongs to a conflict (deletion filter, Chinneck
and Dravnieks 1991). What a conflict takes part in is set aside and the rest is searched on, so
that all conflicts are known; then all of them give at once, each as little as can be, with bores
and rods on the grid. All of it is local, from several starts.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from armdesign.arrays import Array
from armdesign.design.requirements.record import Concession, Evaluation, Requirement
from armdesign.design.requirements.settings import Requirements
from armdesign.design.search.elastic import MET, STARTS, Answer, Elastic
from armdesign.units import WORKSHOP, deg, outward

PAIRS = 60  # of requirements that are tried for a smaller conflict
PARTS = 8  # conflicts that are looked for
DIGITS = 6  # of a setting that gives


@dataclass(frozen=True, eq=False)
class Relaxation:
    """By how much requirements give, in their units, and a design that then meets all, as the limits are drawn in."""

    conditions: dict[str, Evaluation]
    amounts: dict[str, float]
    x: Array

    @property
    def nothing(self) -> bool:
        """Whether nothing need give."""
        return all(
            amount <= MET * abs(self.conditions[name].limit)
            for name, amount in self.amounts.items()
        )


@dataclass(eq=False)
class Conflict(Elastic):
    """The search for conflicts from the design ``x`` that a search ended with.

    It moves on to better ones.
    """

    def smallest(self, everything: Sequence[str] | None = None) -> tuple[str, ...]:
        """Names of requirements that cannot be met together, and can without any one of them.

        Empty if all can.

        The smallest such set that was found among ``everything`` (all if None): single
        requirements are tried first, and pairs where it has more than two.
        """
        everything = self.names if everything is None else everything
        elastic = self.least((), everything)
        self.x = elastic.x
        if elastic.met:
            return ()
        violated = self.violated(elastic.x)
        missed = [n for n in everything if n in violated]
        for name in missed:
            if not self.can((name,)):
                return (name,)
        suspects = [n for n in everything if n in elastic.tight or n in missed]
        if self.can(suspects):
            suspects = list(everything)
        found = self._filtered(suspects, missed)
        pairs = [(a, b) for a in missed for b in suspects if a != b]
        if len(found) > 2 and len(pairs) <= PAIRS:
            found = next((pair for pair in pairs if not self.can(pair)), found)
        return tuple(sorted(found, key=everything.index))

    def parts(self) -> tuple[tuple[str, ...], ...]:
        """Conflicts that have no requirement in common, until what they leave can be met.

        None if all can.
        """
        found: list[tuple[str, ...]] = []
        left = self.names
        while len(found) < PARTS and (names := self.smallest(left)):
            found.append(names)
            left = [name for name in left if name not in names]
        return tuple(found)

    def _filtered(self, suspects: Sequence[str], missed: Collection[str]) -> tuple[str, ...]:
        """Deletion filter: what can go while the rest still conflicts, goes.

        What is missed goes last.
        """
        kept = list(suspects)
        for name in sorted(suspects, key=lambda n: n in missed):
            rest = [n for n in kept if n != name]
            if not self.can(rest):
                kept = rest
        return tuple(kept)

    def relaxed(
        self, parts: Sequence[Sequence[str]], near: Array | None = None
    ) -> Relaxation | None:
        """The least by which the requirements of ``parts`` give, those of a part alike.

        None if that does not help.

        What no setting states, like a dead length, gives nothing. It is sought from several
        starts, fewer if one is ``near``.
        """
        conditions = {name: condition for name, (condition, _) in self.amounts(self.x).items()}
        soft = [tuple(name for name in part if conditions[name].setting) for part in parts]
        hard = [name for name in conditions if not any(name in part for part in soft)]
        bounds = self.bounds
        self.x = self.x if near is None else near
        answer = self.least(soft, hard, starts=2 if near is not None else STARTS)
        if answer.missed > MET and near is not None:
            answer = self.least(soft, hard)
        if answer.missed > MET:
            return None
        written = self.on_grid(answer, soft, hard)
        self.bounds = bounds
        best: Answer = written if written.missed <= MET else answer
        found = self.amounts(best.x)
        gives = {name: found[name][1] for part in soft for name in part}
        if any(
            c.at_least and gives[name] >= abs(c.limit) > 0
            for name, c in conditions.items()
            if name in gives
        ):
            return None
        return Relaxation(conditions, gives, best.x)


def concessions(
    requirements: Requirements,
    parts: Sequence[Sequence[str]],
    of: Mapping[str, Requirement],
    amounts: Mapping[str, float],
    alone: Mapping[str, float | None],
) -> tuple[Concession, ...]:
    """What the requirements of conflicts give, with the settings that grant it.

    Args:
        requirements: that are in conflict.
        parts: names of the conflicts.
        of: the requirements by their names.
        amounts: that they give together, where they give something.
        alone: what each gives where no other of its part does.
    """
    values: dict[str, float] = {}
    for name, amount in amounts.items():
        c = of[name]
        if c.setting and amount > 0 and c.limit:
            own = _value(requirements, c, amount)
            values[c.setting] = (min if _falls(c) else max)(values.get(c.setting, own), own)
    found = []
    for part, names in enumerate(parts):
        for name in names:
            c, amount = of[name], amounts.get(name, 0.0)
            value = values.get(c.setting) if amount > 0 else None
            found.append(
                Concession(
                    **c.identity,
                    together=amount,
                    alone=amount if len(names) == 1 else alone.get(name),
                    part=part,
                    value=value,
                )
            )
    return tuple(found)


def _falls(c: Requirement) -> bool:
    """Whether its setting falls when it gives: a lower limit, or the speed that an upper limit of flow allows."""
    return c.at_least or c.setting.startswith("speed.")


def _stated(requirements: Requirements, c: Requirement) -> float:
    """The setting that states a limit as it is.

    An angle of today's that is lower than the setting counts instead.
    """
    return c.limit / deg if c.setting == "transmission_deg" else requirements.setting(c.setting)


def _value(requirements: Requirements, c: Requirement, amount: float) -> float:
    """The setting that grants an amount, rounded to the granting side."""
    ratio = 1 + (-1 if c.at_least else 1) * amount / c.limit
    value = _stated(requirements, c) * (
        1 / ratio if c.setting.startswith("speed.") else max(ratio, 0.0)
    )
    return outward(value, DIGITS, not _falls(c))


def sentence(
    conflict: Sequence[Concession], settles: bool = True, none_meets: str = "no design meets"
) -> str:
    """Conflicts in plain words.

    ``settles``: what they give is enough for all requirements to be met.
    """
    parts = [
        [c for c in conflict if c.part == part] for part in dict.fromkeys(c.part for c in conflict)
    ]
    more = "" if settles else "; others conflict besides"
    return "; nor ".join([f"{none_meets} {_told(parts[0])}", *map(_told, parts[1:])]) + more


def _told(conflict: Sequence[Concession]) -> str:
    """One conflict: its requirements and what they must give."""
    if len(conflict) == 1:
        only = conflict[0]
        return f"{_named(only)}: it must give {_given(only, only.together)}"
    names = " together with ".join(_named(c) for c in conflict)
    each = ", ".join(f"{c.name} {_given(c, c.together)}" for c in conflict if c.together > 0)
    single = [f"{c.name} {_given(c, c.alone)}" for c in conflict if c.alone is not None]
    alone = f", or one alone {' or '.join(single)}" if single else ", no one alone is enough"
    return f"{names}: they must give {each}{alone}"


def remedy(conflict: Sequence[Concession], otherwise: str = "") -> str:
    """What to do about a conflict: the settings that give all that it needs."""
    values = {
        c.setting: (
            f"{c.setting} {'×' if c.setting.startswith('speed.') else '='} {c.value:.{DIGITS}g}"
        )
        for c in conflict
        if c.value is not None
    }
    return f"loosen them{': ' if values else ''}{', '.join(values.values())}{otherwise}"


def nearest(missed: Sequence[Concession]) -> str:
    """What the nearest of some designs misses, in plain words; nothing if that is not known."""
    words = " and ".join(f"{_named(c)} by {_given(c, c.together)}" for c in missed)
    return f": the nearest misses {words}" if words else ""


def _named(c: Concession) -> str:
    return (
        f"{c.name} ({c.words} {'at least' if c.at_least else 'at most'}"
        f" {WORKSHOP.short(c.limit, c.unit)})"
    )


def _given(c: Concession, amount: float) -> str:
    """An amount in its unit and as a share, both rounded up, so that what is read is enough."""
    percent = 100 * amount / abs(c.limit) if c.limit else 0.0
    digits = max(2, len(str(int(percent))))
    share = f" ({outward(percent, digits, True):.{digits}g} %)" if c.limit else ""
    factor = WORKSHOP.table[c.unit][0]
    return f"{WORKSHOP.short(outward(amount / factor, 4, True) * factor, c.unit)}{share}"
