"""Arguments of formulas: numbers or arrays, each within the interval that its name allows."""

from __future__ import annotations

from typing import Any

import numpy as np

from armdesign.errors import ArmDesignError

SIGNED = {"link_length", "angle", "static_force"}  # may be negative; all others are sizes
MAY_VANISH = {"mass", "load_mass", "joint_inertia", "length", "leakage", "valve_gain"}
MAY_VANISH |= {"supply_pressure"}


def numbers(part: str, *, above_zero: str = "", **values: Any) -> list[Any]:
    """Arrays of floats [SI], each within the interval of its name, all of shapes that go together.

    Args:
        part: whose arguments they are, for messages.
        above_zero: an argument that may vanish elsewhere, but not here.
        values: arguments by name.

    Raises:
        ArmDesignError: no number, one out of its interval, or shapes that numpy cannot broadcast.
    """
    arrays = []
    for name, value in values.items():
        try:
            array = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            fault, remedy = f"{value!r} is no number", "give numbers in SI units"
            raise ArmDesignError(f"{part}: {name}", fault, remedy) from None
        interval, low = "(0, ∞)", array <= 0
        if name in SIGNED:
            interval, low = "(−∞, ∞)", np.zeros(array.shape, dtype=bool)
        elif name in MAY_VANISH and name != above_zero:
            interval, low = "[0, ∞)", array < 0
        if np.any(wrong := ~np.isfinite(array) | low):
            fault = f"{array[wrong].flat[0]:g} is not allowed"
            raise ArmDesignError(f"{part}: {name}", fault, f"give it in {interval}")
        arrays.append(array)
    try:
        np.broadcast_shapes(*(array.shape for array in arrays))
    except ValueError:
        shapes = (f"{name} {array.shape}" for name, array in zip(values, arrays, strict=True))
        fault = f"the shapes do not go together: {', '.join(shapes)}"
        raise ArmDesignError(part, fault, "give scalars or one shape") from None
    return arrays
