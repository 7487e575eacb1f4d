"""Natural frequencies of hydraulic booms, and the cylinders and pins that raise them.

    import armdesign as ad

    machine = ad.load("excavator_20t")
    workspace = ad.Workspace.grid(machine)
    print(ad.frequency_map(machine, workspace).worst)
    design = ad.optimize(machine, workspace)

Names load on first use, so that importing the package costs next to nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from armdesign import formulas as formulas
    from armdesign.bands import Bands as Bands
    from armdesign.bands import FrequencyBand as FrequencyBand
    from armdesign.bands import frequency_band as frequency_band
    from armdesign.design.least import least as least
    from armdesign.design.optimum import Design as Design
    from armdesign.design.optimum import optimize as optimize
    from armdesign.design.optimum import size_cylinders as size_cylinders
    from armdesign.design.pareto import Pareto as Pareto
    from armdesign.design.pareto import pareto as pareto
    from armdesign.design.requirements import Requirements as Requirements
    from armdesign.errors import ArmDesignError as ArmDesignError
    from armdesign.errors import InfeasibleError as InfeasibleError
    from armdesign.linearization import LinearModel as LinearModel
    from armdesign.linearization import linearize as linearize
    from armdesign.machine import Machine as Machine
    from armdesign.machine import load as load
    from armdesign.maps import FrequencyMap as FrequencyMap
    from armdesign.maps import ReachMap as ReachMap
    from armdesign.maps import WorstPose as WorstPose
    from armdesign.maps import frequency_map as frequency_map
    from armdesign.modes import Modes as Modes
    from armdesign.modes import natural_modes as natural_modes
    from armdesign.poses import Poses as Poses
    from armdesign.simulation.excitation import Step as Step
    from armdesign.simulation.excitation import Table as Table
    from armdesign.simulation.motion import Simulation as Simulation
    from armdesign.simulation.motion import simulate as simulate
    from armdesign.simulation.validation import Validation as Validation
    from armdesign.simulation.validation import validate as validate
    from armdesign.workspace import Workspace as Workspace

_HOME = {
    "ArmDesignError": "errors",
    "InfeasibleError": "errors",
    "Machine": "machine",
    "load": "machine",
    "Modes": "modes",
    "natural_modes": "modes",
    "Poses": "poses",
    "Workspace": "workspace",
    "FrequencyMap": "maps",
    "ReachMap": "maps",
    "WorstPose": "maps",
    "frequency_map": "maps",
    "Bands": "bands",
    "FrequencyBand": "bands",
    "frequency_band": "bands",
    "Requirements": "design.requirements",
    "Design": "design.optimum",
    "optimize": "design.optimum",
    "size_cylinders": "design.optimum",
    "Pareto": "design.pareto",
    "pareto": "design.pareto",
    "least": "design.least",
    "Step": "simulation.excitation",
    "Table": "simulation.excitation",
    "Simulation": "simulation.motion",
    "simulate": "simulation.motion",
    "Validation": "simulation.validation",
    "validate": "simulation.validation",
    "LinearModel": "linearization",
    "linearize": "linearization",
}

__all__ = [*_HOME, "formulas"]
__version__ = "0.1.0"


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(importlib.import_module(f"armdesign.{_HOME[name]}"), name)
    if name == "formulas":
        return importlib.import_module("armdesign.formulas")
    raise AttributeError(f"module 'armdesign' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*__all__, *(name for name in globals() if name.startswith("__"))])
