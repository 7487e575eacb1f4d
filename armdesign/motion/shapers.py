"""Input shapers: a few impulses with which a command is convolved, so that it leaves no vibration.

A step of a command makes a mode ring; a second one half a period later makes it ring against the
first (Smith 1957, Singer and Seering 1990). A shaper is impulses A_i ≥ 0 with Σ A_i = 1 at times
t_i. What it leaves of the vibration that a step alone would make is, for ω and ζ,

    V(ω, ζ) = exp(−ζ ω t_n) √(C² + S²),   C = Σ A_i e^{ζωt_i} cos ω_d t_i,   S likewise with sin,

and what it costs is its delay t_n. ZV, ZVD and EI take ½, 1 and 1 period of one mode. Shapers of
two modes are convolved: V is their product, the delay their sum.

Equal distances τ make V a polynomial in cos(ω_d τ/2). The one that stays below a limit over the
widest band is Chebyshev's, as for windows and arrays of antennas (Dolph 1946): EI is the one with
three impulses, "humps" those with more. Its limit, as the impulses multiply, is a delay of
arcosh(1/V)/π periods of the lowest frequency, 1.17 for V = 5 %, however wide the band.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array, ReadOnly
from armdesign.errors import ArmDesignError
from armdesign.short_repr import short_repr

if TYPE_CHECKING:
    from armdesign.plots.canvas import Axes

TOLERATED = 0.05  # residual vibration, over the vibration after a step
MOST_IMPULSES = 200
SEARCHED = 4001  # frequencies at which a residual over a band is looked at
ROUNDING = 1e-9  # of the sum of amplitudes
WITHIN = 1.01  # of a residual: the hump of a damped EI is a little beside its frequency
TRIES = 40  # to bring the residual of a damped band below its limit
TIGHTER = 0.97  # step by which it is lowered


@dataclass(frozen=True, eq=False, kw_only=True)
class Shaper(ReadOnly):
    """Impulses with which commands are convolved; arrays are read-only.

    Attributes:
        times: of the impulses, ascending from 0 (n,) [s].
        amplitudes: of the impulses, positive, of sum 1 (n,).
        name: of its kind.
        low: lowest frequency that it is made for [Hz].
        high: highest frequency that it is made for [Hz].
        damping: ratio that it is made for, of several modes the least.
        parts: shapers of single modes of which it is made; none where it is one.
    """

    __repr__ = short_repr

    times: Array
    amplitudes: Array
    name: str
    low: float
    high: float
    damping: float = 0.0
    parts: tuple[Shaper, ...] = field(default=(), repr=False)

    def __post_init__(self) -> None:
        for name in ("times", "amplitudes"):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=float))
        times, sizes = self.times, self.amplitudes
        if times.ndim != 1 or times.shape != sizes.shape or not np.isfinite([times, sizes]).all():
            fault, remedy = "times and amplitudes are not of one length", "give one each"
            raise ArmDesignError(f"shaper {self.name}", fault, remedy)
        if not (len(times) and times[0] == 0 and np.all(np.diff(times) >= 0)):
            raise ArmDesignError(f"shaper {self.name}", "times do not ascend from 0", "sort them")
        if sizes.min() <= 0 or abs(sizes.sum() - 1) > ROUNDING:
            fault = f"amplitudes of sum {sizes.sum():g} are not positive ones of sum 1"
            raise ArmDesignError(f"shaper {self.name}", fault, "divide them by their sum")
        super().__post_init__()

    @classmethod
    def none(cls) -> Shaper:
        """A shaper that leaves the command as it is."""
        return cls(times=np.zeros(1), amplitudes=np.ones(1), name="none", low=0.0, high=0.0)

    @classmethod
    def zv(cls, frequency: float, damping: float = 0.0) -> Shaper:
        """Zero vibration at one frequency [Hz]: [1, K]/(1 + K) at [0, T_d/2].

        Raises:
            ArmDesignError: a frequency or damping ratio that is not allowed.
        """
        return cls._of_powers("zv", frequency, damping, np.array([1.0, 1.0]))

    @classmethod
    def zvd(cls, frequency: float, damping: float = 0.0) -> Shaper:
        """Zero vibration and derivative: [1, 2K, K²]/(1 + K)² at [0, T_d/2, T_d].

        Raises:
            ArmDesignError: a frequency or damping ratio that is not allowed.
        """
        return cls._of_powers("zvd", frequency, damping, np.array([1.0, 2.0, 1.0]))

    @classmethod
    def ei(cls, frequency: float, damping: float = 0.0, residual: float = TOLERATED) -> Shaper:
        """Extra-insensitive: V = ``residual`` at the frequency [Hz], 0 on both sides of it.

        [1 + W, 2(1 − W)K, (1 + W)K²]/N at [0, T_d/2, T_d], as of Singhose, Seering and Singer
        (1994), W = V without damping. With it W = V (1 + K)²/(4K² − V(1 − K)²) makes V exact at
        the frequency. With V = 0 it is ZVD.

        Raises:
            ArmDesignError: a frequency, damping ratio or residual that is not allowed.
        """
        _refuse_residual("ei", residual)
        decay = _half_period_decay("ei", frequency, damping)
        w = residual * (1 + decay) ** 2 / (4 * decay**2 - residual * (1 - decay) ** 2)
        if not 0 <= w < 1:
            fault = f"damping {damping:g} leaves no {100 * residual:g} % to tolerate"
            raise ArmDesignError("shaper ei", fault, "give a lower damping or residual, or zvd")
        return cls._of_powers("ei", frequency, damping, np.array([1 + w, 2 * (1 - w), 1 + w]))

    @classmethod
    def band(
        cls, low: float, high: float, damping: float = 0.0, residual: float = TOLERATED
    ) -> Shaper:
        """Impulses at equal distances, the residual below a limit over a band, and short.

        By Dolph and Chebyshev: n + 1 impulses at distances τ have V = |T_n(x0 cos πfτ)|/T_n(x0)
        with T_n(x0) = 1/V_max, which is at most V_max from f = arccos(1/x0)/πτ to 1/τ less that.
        The least n whose band is as wide is taken. Damping turns A_i into A_i e^{−σt_i}, σ at
        the lowest frequency, as faster modes forget the first impulses anyhow. Where one forgets
        so much of them that more is left of it, V_max is lowered until all of the band is kept.
        It is the shortest without damping. Modes with less than the given damping keep more.

        Args:
            low: lowest frequency [Hz].
            high: highest frequency [Hz].
            damping: ratio of all modes in the band.
            residual: most that may be left.

        Raises:
            ArmDesignError: no such band, or no shaper keeps it.
        """
        _refuse("band", low, damping)
        _refuse("band", high, damping)
        _refuse_residual("band", residual, least=1e-4)
        if high < low:
            raise ArmDesignError("shaper band", f"{high:g} Hz is below {low:g} Hz", "swap them")
        limit = residual
        for _ in range(TRIES):
            shaper = cls._chebyshev(low, high, damping, limit)
            if shaper.worst_residual() <= residual * (1 + 1e-9):
                return shaper
            limit *= TIGHTER
        fault = f"none keeps {100 * residual:g} % from {low:g} to {high:g} Hz at ζ = {damping:g}"
        raise ArmDesignError("shaper band", fault, "narrow the band, or tolerate more")

    @classmethod
    def _chebyshev(cls, low: float, high: float, damping: float, limit: float) -> Shaper:
        from scipy.special import eval_chebyt

        for n in range(1, MOST_IMPULSES):
            x0 = math.cosh(math.acosh(1 / limit) / n)
            edge = math.acos(1 / x0) / math.pi  # of the band, f τ
            distance = edge / low
            if 1 / distance >= (low + high) * (1 - 1e-12):
                break
        else:
            fault = f"{low:g} to {high:g} Hz needs more than {MOST_IMPULSES} impulses"
            raise ArmDesignError("shaper band", fault, "narrow the band")
        phase = 2 * math.pi * np.arange(n + 1) / (n + 1)
        polynomial = eval_chebyt(n, x0 * np.cos(phase / 2)) * np.exp(0.5j * n * phase)
        powers = np.fft.fft(polynomial).real
        decay = 2 * math.pi * damping * low  # σ [1/s]
        times = distance / math.sqrt(1 - damping**2) * np.arange(n + 1)
        sizes = powers * np.exp(-decay * times)
        if sizes.min() <= 0:
            fault = f"{low:g} to {high:g} Hz would need negative impulses"
            raise ArmDesignError("shaper band", fault, "widen the band, or tolerate less")
        return cls(
            times=times,
            amplitudes=sizes / sizes.sum(),
            name=f"band of {n + 1} impulses",
            low=low,
            high=high,
            damping=damping,
        )

    @classmethod
    def _of_powers(cls, name: str, frequency: float, damping: float, powers: Array) -> Shaper:
        """Impulses at half periods with amplitudes in the proportions of powers_i K^i."""
        decay = _half_period_decay(name, frequency, damping)
        half = 0.5 / (frequency * math.sqrt(1 - damping**2))
        sizes = powers * decay ** np.arange(len(powers))
        return cls(
            times=half * np.arange(len(powers)),
            amplitudes=sizes / sizes.sum(),
            name=name,
            low=frequency,
            high=frequency,
            damping=damping,
        )

    def __mul__(self, other: Shaper) -> Shaper:
        """Both convolved, for two modes: every impulse of one at every impulse of the other."""
        if not (self.delay and other.delay):
            return self if self.delay else other
        times = np.add.outer(self.times, other.times).ravel()
        sizes = np.multiply.outer(self.amplitudes, other.amplitudes).ravel()
        order = np.argsort(times, kind="stable")
        parts = (*(self.parts or (self,)), *(other.parts or (other,)))
        return Shaper(
            times=times[order],
            amplitudes=sizes[order],
            name=" × ".join(part.name for part in parts),
            low=min(part.low for part in parts),
            high=max(part.high for part in parts),
            damping=min(part.damping for part in parts),
            parts=parts,
        )

    @property
    def delay(self) -> float:
        """Time of the last impulse, by which a shaped command ends later [s]."""
        return float(self.times[-1])

    @property
    def of_lowest(self) -> Shaper:
        """The part of it that is made for its lowest frequency; itself where it has no parts."""
        return min(self.parts or (self,), key=lambda part: part.low)

    @property
    def words(self) -> str:
        """Kind, what it is made for, and delay in seconds and periods of the lowest frequency."""
        if not self.delay:
            return "none"
        made_for = (
            f"{self.low:.3g} Hz"
            if self.low == self.high
            else (f"{self.low:.3g} to {self.high:.3g} Hz")
        )
        if self.parts:
            made_for = " and ".join(f"{part.low:.3g} Hz" for part in self.parts)
        periods = self.delay * self.low * math.sqrt(1 - self.of_lowest.damping**2)
        many = "s" if round(periods, 2) > 1 else ""
        delay = f"delay {self.delay:.3g} s, {periods:.3g} period{many}"
        of = f" of {self.low:.3g} Hz" if self.low < self.high and not self.parts else ""
        return f"{self.name} for {made_for}: {delay}{of}"

    def residual(self, frequency: ArrayLike, damping: ArrayLike | None = None) -> Array:
        """V(ω, ζ), what is left of the vibration that a step makes, at frequencies [Hz].

        Args:
            frequency: of any shape [Hz].
            damping: ratio, or one for each frequency; None: the one that the shaper is made for,
                of several modes that of the nearest.

        Raises:
            ArmDesignError: a damping ratio that is not allowed.
        """
        ratio = self._damping_near(frequency) if damping is None else damping
        for worst in np.min(ratio, initial=0.0), np.max(ratio, initial=0.0):
            _refuse_damping(self.name, float(worst))
        zeta = np.asarray(ratio, dtype=float)[..., None]
        omega = 2 * math.pi * np.asarray(frequency, dtype=float)[..., None]
        # e^{−ζω(t_n − t_i)}: as above, but without overflow
        sizes = self.amplitudes * np.exp(-zeta * omega * (self.delay - self.times))
        phase = omega * np.sqrt(1 - zeta**2) * self.times
        return np.asarray(np.abs((sizes * np.exp(1j * phase)).sum(axis=-1)))

    def _damping_near(self, frequency: ArrayLike) -> Array:
        """Damping ratio of the mode nearest to each frequency [Hz], of those it is made for."""
        modes, ratios = self._modes
        with np.errstate(divide="ignore", invalid="ignore"):  # 0 Hz is nearest to the lowest
            nearest = np.abs(np.log(np.asarray(frequency)[..., None] / modes)).argmin(axis=-1)
        return np.asarray(ratios[nearest])

    @property
    def _modes(self) -> Array:
        """Frequencies [Hz] of the modes that it is made for, and their damping ratios (2, n)."""
        parts = sorted(self.parts or (self,), key=lambda part: part.low)
        return np.array([((one.low + one.high) / 2, one.damping) for one in parts]).T

    def worst_residual(
        self, low: float | None = None, high: float | None = None, damping: float | None = None
    ) -> float:
        """Largest residual from ``low`` to ``high`` [Hz]; None: of what it is made for."""
        ends = self.low if low is None else low, self.high if high is None else high
        return float(self.residual(np.linspace(*ends, SEARCHED), damping).max())

    def insensitivity(self, residual: float = TOLERATED) -> float:
        """Width of the band about its frequency with at most this residual, over that frequency.

        At 5 % and without damping 0.06 of ZV, 0.29 of ZVD and 0.40 of EI (Singhose 2009). Of one
        that is made for several modes the frequencies of all err by one share, and of each mode at
        most this residual is left.
        """
        modes, ratios = self._modes
        share = np.linspace(0.0, 1.0, SEARCHED)[:, None]
        above, below = (
            self.residual(modes * (1 + sign * share), ratios).max(axis=1) > residual * WITHIN
            for sign in (1, -1)
        )
        if not self.delay or above[0]:
            return 0.0
        widths = (share[np.argmax(one), 0] if one.any() else 1.0 for one in (above, below))
        return float(sum(widths))

    def shaped(self, times: Array, values: Array, at: Array) -> Array:
        """A command after it has been shaped, at times ``at`` (m,) [s]: Σ A_i c(t − t_i).

        Args:
            times: of the command (n,) [s]; before and after them it stays at its ends.
            values: of the command (n, k).
            at: (m,) [s].
        """
        columns = [
            sum(
                size * np.interp(at - late, times, column)
                for size, late in zip(self.amplitudes, self.times, strict=True)
            )
            for column in values.T
        ]
        return np.stack(columns, axis=-1)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw residual vibration against frequency."""
        from armdesign import plots

        return plots.sensitivity_curves([self], ax)


def _refuse(name: str, frequency: float, damping: float) -> None:
    if not (math.isfinite(frequency) and frequency > 0):
        fault = f"{frequency:g} Hz is no frequency"
        raise ArmDesignError(f"shaper {name}", fault, "give a positive one")
    _refuse_damping(name, damping)


def _refuse_damping(name: str, damping: float) -> None:
    if not 0 <= damping < 1:
        fault = f"damping ratio {damping:g} is not in [0, 1)"
        raise ArmDesignError(f"shaper {name}", fault, "give 0.02")


def _refuse_residual(name: str, residual: float, least: float = 0.0) -> None:
    if not least <= residual < 1:
        fault = f"residual {residual:g} is not in [{least:g}, 1)"
        raise ArmDesignError(f"shaper {name}", fault, "give 0.05")


def _half_period_decay(name: str, frequency: float, damping: float) -> float:
    """K = exp(−ζπ/√(1 − ζ²)): what half a period leaves of a free vibration."""
    _refuse(name, frequency, damping)
    return math.exp(-damping * math.pi / math.sqrt(1 - damping**2))
