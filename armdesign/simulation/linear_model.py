"""Linear models of a machine: ẋ = A x + B u, y = C x + D u about operating points, by name.

States, inputs and outputs are deviations from the operating point, in SI. Their names are told in
groups, ``"cap pressures"`` or ``"tool force"``, so that a controller takes what it measures and
moves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from armdesign.arrays import Array, Flags, ReadOnly, read_only
from armdesign.errors import SimulationError, choose
from armdesign.machine.machine import Machine
from armdesign.short_repr import short_repr
from armdesign.simulation.damped_modes import DampedModes, damped_modes_of, damping_of, oscillatory
from armdesign.simulation.signals import Groups
from armdesign.units import bar

if TYPE_CHECKING:
    from armdesign.plots.canvas import Axes, Figure


def pressure_units(names: Sequence[str]) -> Array:
    """A bar [Pa] for each pressure of states or outputs, 1 for the rest."""
    return np.array([bar if name.endswith("pressure") else 1.0 for name in names])


@dataclass(frozen=True, eq=False, kw_only=True)
class StateSpace(ReadOnly):
    """Base of one linear model and of a stack, whose arrays have axis 0 = pose.

    Attributes:
        A: over the states (…, ns, ns).
        B: by the inputs (…, ns, nu): spool commands −1…1, then the force at the tool along x, y
            and z of the root link [N].
        C: to the outputs (…, ny, ns).
        D: from inputs straight to outputs (…, ny, nu): a force accelerates the tool at once.
        states: names (ns,).
        inputs: names (nu,); a spool's command has the name of its actuator.
        outputs: names (ny,).
        state_groups: slices of the states by the name of their group.
        input_groups: slices of the inputs: "commands", "tool force".
        output_groups: slices of the outputs; positions of pistons come first.
        equilibrium: the state at the operating point (…, ns).
        capacities: C of cap and annulus chambers there (…, 2, nc) [m³/Pa].
        mass_matrix: M there (…, k, k), over joints and springs.
        tool_jacobian: J there (…, 3, k), of the tool in the root link.
        machine: with its load case at work.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    state_groups: Groups
    input_groups: Groups
    output_groups: Groups
    equilibrium: Array
    capacities: Array
    mass_matrix: Array
    tool_jacobian: Array
    machine: Machine

    @cached_property
    @read_only
    def state_matrix_in_bar(self) -> Array:
        """A with pressures in bar, all else SI (…, ns, ns).

        Its numbers are of one order and need no balancing by slycot.
        """
        unit = pressure_units(self.states)
        return np.asarray(self.A * unit / unit[:, None])

    def select(
        self, inputs: str | Sequence[str] | None = None, outputs: str | Sequence[str] | None = None
    ) -> Self:
        """The same with some inputs and outputs only, in the order asked for.

        Args:
            inputs: names or groups, one or several; None: all.
            outputs: the same of the outputs.

        Raises:
            SimulationError: there is no such name.
        """
        columns, input_groups = _chosen("input", inputs, self.inputs, self.input_groups)
        rows, output_groups = _chosen("output", outputs, self.outputs, self.output_groups)
        return replace(
            self,
            B=self.B[..., columns],
            C=self.C[..., rows, :],
            D=self.D[..., rows, :][..., columns],
            inputs=tuple(self.inputs[k] for k in columns),
            outputs=tuple(self.outputs[k] for k in rows),
            input_groups=input_groups,
            output_groups=output_groups,
        )


def _chosen(
    kind: str, wanted: str | Sequence[str] | None, names: Sequence[str], groups: Groups
) -> tuple[list[int], Groups]:
    """Indices of names or groups, and where each group that was asked for stands among them."""
    wanted = tuple(groups) if wanted is None else (wanted,) if isinstance(wanted, str) else wanted
    indices, places = list[int](), dict[str, slice]()
    for word in wanted:
        if word not in groups and word not in names:
            fault, known = f'no {kind} or group of {kind}s "{word}"', (*groups, *names)
            raise SimulationError("linear model", fault, choose(word, known))
        own = groups.get(word)
        own = slice(names.index(word), names.index(word) + 1) if own is None else own
        chosen = range(*own.indices(len(names)))
        places[word] = slice(len(indices), len(indices) + len(chosen))
        indices += chosen
    return indices, places


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearModels(StateSpace):
    """Linear models at n operating points: axis 0 of every array is the pose.

    A (n, ns, ns), B (n, ns, nu), C (n, ny, ns), D (n, ny, nu), equilibrium (n, ns).
    """

    __repr__ = short_repr

    stable: Flags  # (n,): whether trapped oil and springs alone hold the pose, K ≻ 0

    def __len__(self) -> int:
        return len(self.A)

    @property
    def headline(self) -> str:
        """Machine, number of poses, and how many of them trapped oil holds."""
        return f"of {self.machine.name}: {len(self)} poses, {int(self.stable.sum())} stable"

    def plot(self, ax: Axes | None = None) -> Axes:
        """Damping ratio over frequency of the modes of all poses; returns the axes."""
        from armdesign import plots

        return plots.linear_modes(self, ax)

    def __getitem__(self, rows: Any) -> Any:
        """One ``LinearModel`` for an index, ``LinearModels`` for a slice, mask or indices."""
        values = {name: getattr(self, name) for name in self.__dataclass_fields__}
        arrays = {k: v[rows] for k, v in values.items() if isinstance(v, np.ndarray)}
        if np.ndim(arrays["A"]) == 2:
            stable = {"stable": bool(arrays.pop("stable"))}
            return LinearModel(**values | arrays | stable)
        return LinearModels(**values | arrays)


@dataclass(frozen=True, eq=False, kw_only=True)
class LinearModel(StateSpace):
    """State space about one operating point; arrays are read-only, SI.

    A (ns, ns), B (ns, nu), C (ny, ns), D (ny, nu), equilibrium (ns,).
    """

    __repr__ = short_repr

    stable: bool  # whether trapped oil and springs alone hold the pose, K ≻ 0

    @cached_property
    @read_only
    def poles(self) -> Array:
        """All eigenvalues of A (ns,) [rad/s], slow ones first."""
        poles = np.linalg.eigvals(self.A)
        return np.asarray(poles[np.argsort(np.abs(poles), kind="stable")])

    @cached_property
    @read_only
    def modes(self) -> Array:
        """Oscillatory poles of arm and oil above the real axis [rad/s], slow ones first.

        The spools' own are left out: spools drive the other states and feel nothing of them, so
        the poles are the eigenvalues of these states' block of A. At most one pair per joint
        and spring: slower pairs are creep under leakage.
        """
        size = self.state_groups["spools"].start
        poles = np.linalg.eigvals(self.A[:size, :size])
        return np.asarray(poles[oscillatory(poles, len(self.mass_matrix))])

    @cached_property
    def damped_modes(self) -> DampedModes:
        """These modes with their shapes, and the shares of actuators, springs and states."""
        return damped_modes_of(self)

    @property
    def natural_frequencies(self) -> Array:
        """|λ|/2π of ``modes`` [Hz]."""
        return np.abs(self.modes) / (2 * math.pi)

    @property
    def damping_ratios(self) -> Array:
        """ζ = −Re λ/|λ| of ``modes``."""
        return damping_of(self.modes)

    @property
    def headline(self) -> str:
        """Machine, natural frequencies and damping ratios."""
        pairs = zip(self.natural_frequencies, self.damping_ratios, strict=True)
        modes = ", ".join(f"{f:.4g} Hz (ζ {damping:.2g})" for f, damping in pairs)
        held = "" if self.stable else "; trapped oil does not hold it"
        return f"of {self.machine.name}: {modes or 'no mode rings'}{held}"

    def frequency_response(self, frequencies: ArrayLike) -> Array:
        """G = C (jω − A)⁻¹ B + D at frequencies (f,) [Hz]: complex (f, ny, nu)."""
        s = 2j * math.pi * np.atleast_1d(np.asarray(frequencies, dtype=float))[:, None, None]
        states = np.linalg.solve(s * np.eye(len(self.A)) - self.A, self.B + 0j)
        return np.asarray(self.C @ states + self.D)

    def plot(self) -> Figure:
        """Speed of each piston over its own command, and the phase; returns the figure."""
        from armdesign import plots

        return plots.linear_response(self)

    def to_control(self) -> Any:
        """The model as a ``StateSpace`` of python-control, with names of states, inputs, outputs.

        Pressures are in bar there, as in ``state_matrix_in_bar``.

        Raises:
            SimulationError: python-control is not installed.
        """
        try:
            import control
        except ImportError:
            fault, remedy = "needs the package python-control", "pip install 'armdesign[control]'"
            raise SimulationError("to_control", fault, remedy) from None
        unit, outer = pressure_units(self.states), pressure_units(self.outputs)
        return control.ss(
            self.state_matrix_in_bar,
            self.B / unit[:, None],
            self.C * unit / outer[:, None],
            self.D / outer[:, None],
            states=list(self.states),
            inputs=list(self.inputs),
            outputs=list(self.outputs),
        )
