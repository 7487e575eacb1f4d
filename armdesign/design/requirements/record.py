"""A requirement: one record, evaluated on designs, judged on a machine, or conceded.

To add one, say a largest rod speed (about fifteen lines of code in three files; its example for
the documentation goes into ``docs/every_key.toml``):

1. ``machine/file/schema.py``: its key and default, ``rod_speed_mm_per_s = None``; its text for
   editors in ``machine/file/json_schema.py``, which writes ``machine.schema.json``.
2. The file of its family here (``oil.py``): a field with its meaning,
   ``rod_speed: float | None = number("rod_speed_mm_per_s", mm)``,
3. and in the family's function ``yield Evaluation(...)``: name, words, SI unit, value on a
   ``Candidate``, limit, setting (the key); ``reformulated`` where the distance to the limit
   bends. The name begins with a word of ``names_begin_with`` above the function.

Check, constraints with gradients, slacks, rounding, prices, conflicts and reports follow. A new
family is one more base class of ``Requirements`` and one more line of ``FAMILIES``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias, TypeVar

import numpy as np

from armdesign.arrays import Array


@dataclass(frozen=True, kw_only=True)
class Requirement:
    """A requirement: what is limited, and by what.

    Attributes:
        name: of the requirement.
        words: what it is about.
        unit: SI, of value and limit.
        limit: what a design may have.
        at_least: whether the limit is a lower one.
        setting: key under ``[requirements]`` that states the limit; empty where none does.
            ``speed.NAME`` stands for all speeds of a motion.
        stated: number in the key's unit that would state this limit; None: the setting does.
        inverse: whether the setting is a factor on the value, such as a speed, not on the limit.
        end: lower limit below which it is not relaxed, whatever a file may state.
    """

    name: str
    words: str
    unit: str
    limit: float
    at_least: bool = False
    setting: str = ""
    stated: float | None = None
    inverse: bool = False
    end: float = 0.0

    @property
    def identity(self) -> dict[str, Any]:
        """The fields that every record of this requirement has."""
        return {name: getattr(self, name) for name in Requirement.__dataclass_fields__}


@dataclass(frozen=True, eq=False, kw_only=True)
class Evaluation(Requirement):
    """A requirement on b variants of a design at k places.

    Attributes:
        value: what the design has (b,) or (b, k), kept as (b, k).
        scale: what the constraint is measured by; None: ``slack_scale``, or the limit's size.
        slack_scale: what a slack is a share of; None: the limit.
        reformulated: for the optimiser a smoother form of the constraint (b, k), and what it gains
            per 100 % of the limit; None: the distance to the limit over ``scale``.
        power: of the limit, by which the reformulated constraint goes; 1 where it is linear in it.
        tightening_factor: how many times a share of tightening this constraint is drawn in.
        rounding_loss: of the constraint, by pins on the 0.1 mm grid, besides.
        curved: whether the constraint bends in the areas so that no tangent bounds it.
    """

    value: Array
    scale: float | None = None
    slack_scale: float | None = None
    reformulated: tuple[Array, Array] | None = None
    power: float = 1.0
    tightening_factor: float = 1.0
    rounding_loss: float = 0.0
    curved: bool = False

    def __post_init__(self) -> None:
        if self.value.ndim == 1:
            object.__setattr__(self, "value", self.value[:, None])

    @cached_property
    def constraint(self) -> Array:
        """As the optimiser sees it (b, k), dimensionless, ≥ 0 where met."""
        if self.reformulated is not None:
            return self.reformulated[0]
        distance = self.value - self.limit if self.at_least else self.limit - self.value
        return np.asarray(distance / self._scale)

    @cached_property
    def limit_sensitivity(self) -> Array:
        """Gain of the constraint per 100 % of the limit (b, k)."""
        own = abs(self.limit) / self._scale if self.reformulated is None else self.reformulated[1]
        return np.broadcast_to(own, self.constraint.shape)

    def room(self, share: float) -> float:
        """Room that the constraint gains where its limit is relaxed by a share.

        A share of what ``limit_sensitivity`` says, which is the slope at the limit.
        """
        return share if self.power == 1 else (1 - (1 - share) ** self.power) / self.power

    @property
    def _scale(self) -> float:
        return self.scale or self.slack_scale or abs(self.limit) or 1.0

    @property
    def slack(self) -> Array:
        """Distance to the limit (b, k) over it, or over ``slack_scale``; ≥ 0 where met."""
        distance = self.value.real - self.limit if self.at_least else self.limit - self.value.real
        slack = distance / (self.slack_scale or abs(self.limit) or 1.0)
        slack[np.abs(slack) < 1e-12] = 0.0  # nothing but the rounding of the arithmetic is left
        return np.asarray(slack)


Family: TypeAlias = Callable[..., Iterator[Evaluation]]  # of a candidate and the reference
F = TypeVar("F", bound=Family)
FIRST_WORDS: dict[Family, tuple[str, ...]] = {}  # of the names of each family's requirements


def names_begin_with(*words: str) -> Callable[[F], F]:
    """A family whose requirements have names that begin so: it is left out where none counts."""

    def family(function: F) -> F:
        FIRST_WORDS[function] = words
        return function

    return family


@dataclass(frozen=True, kw_only=True)
class Check(Requirement):
    """A requirement, judged on a machine: ``value`` against ``limit``.

    ``slack`` ≥ 0 where it is met: the distance to the limit over the limit (over the pin box, the
    stroke, the outline's size or today's value where the limit is a length that may be zero).
    """

    value: float
    slack: float

    @classmethod
    def of(cls, evaluation: Evaluation) -> Check:
        """The requirement of one machine where it has least slack."""
        slack = evaluation.slack[0]
        worst = int(slack.argmin())
        value = float(evaluation.value[0, worst].real)
        return cls(**evaluation.identity, value=value, slack=float(slack[worst]))


BESIDES = -1  # part of what is in no conflict and gives none the less


@dataclass(frozen=True, kw_only=True)
class Concession(Requirement):
    """Amount by which one requirement of a conflict must be relaxed, in its unit.

    Attributes:
        together: amount that is enough if all requirements of the conflict are relaxed, rounding
            to a drawing's grid or a catalogue's sizes included; 0 where it is in conflict but need
            not, or cannot, be relaxed. The largest share is least among all combinations of a
            catalogue with given pins; else it is what a local search finds.
        alone: amount that is enough if no other of its part is relaxed; None where that does not
            help.
        part: number of the conflict that it belongs to, of several without a common requirement;
            each of them must be relaxed. ``BESIDES`` where it belongs to none, and gives because
            no design was found with what these give.
        value: of the setting that relaxes it by ``together``, in the key's unit, as a factor for
            speeds; None where it is not relaxed. ``Requirements.granting`` makes requirements of
            the values of a conflict.
    """

    together: float
    alone: float | None
    part: int = 0
    value: float | None = None
