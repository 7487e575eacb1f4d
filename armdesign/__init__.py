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
import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from armdesign import units as units
    from armdesign.calibration.calibrate import Calibration as Calibration
    from armdesign.calibration.calibrate import calibrate as calibrate
    from armdesign.control.bandwidth_map import BandwidthMap as BandwidthMap
    from armdesign.control.bandwidth_map import bandwidth_map as bandwidth_map
    from armdesign.control.controller import Controller as Controller
    from armdesign.control.gain_schedule import GainSchedule as GainSchedule
    from armdesign.control.gain_schedule import gain_schedule as gain_schedule
    from armdesign.design.design import Design as Design
    from armdesign.design.least import least as least
    from armdesign.design.optimize import size_cylinders as size_cylinders
    from armdesign.design.pareto import Pareto as Pareto
    from armdesign.design.requirements.settings import Requirements as Requirements
    from armdesign.design.steps import DesignStep as DesignStep
    from armdesign.design.steps import Steps as Steps
    from armdesign.design.steps import steps as steps
    from armdesign.errors import ArmDesignError as ArmDesignError
    from armdesign.errors import InfeasibleError as InfeasibleError
    from armdesign.exchange.files import export as export
    from armdesign.exchange.pin_table import pin_table as pin_table
    from armdesign.exchange.urdf import robot_positions as robot_positions
    from armdesign.frequency.bands import Bands as Bands
    from armdesign.frequency.frequency_band import FrequencyBand as FrequencyBand
    from armdesign.frequency.frequency_band import frequency_band as frequency_band
    from armdesign.frequency.maps import FrequencyMap as FrequencyMap
    from armdesign.frequency.maps import frequency_map as frequency_map
    from armdesign.frequency.modes import Modes as Modes
    from armdesign.frequency.modes import natural_modes as natural_modes
    from armdesign.frequency.reach_map import ReachMap as ReachMap
    from armdesign.frequency.workspace import Workspace as Workspace
    from armdesign.frequency.worst_frequency import WorstPose as WorstPose
    from armdesign.influence.sensitivity import Sensitivity as Sensitivity
    from armdesign.influence.sensitivity import sensitivity as sensitivity
    from armdesign.influence.tolerances import Tolerances as Tolerances
    from armdesign.influence.tolerances import tolerances as tolerances
    from armdesign.influence.what_if import WhatIf as WhatIf
    from armdesign.influence.what_if import what_if as what_if
    from armdesign.machine.lift_chart import LiftChart as LiftChart
    from armdesign.machine.lift_chart import lift_chart as lift_chart
    from armdesign.machine.loading import load as load
    from armdesign.machine.machine import Machine as Machine
    from armdesign.machine.poses import Poses as Poses
    from armdesign.motion.move import Move as Move
    from armdesign.motion.outcome import MoveRun as MoveRun
    from armdesign.motion.plan import plan_move as plan_move
    from armdesign.motion.shapers import Shaper as Shaper
    from armdesign.motion.shaping import workspace_shaper as workspace_shaper
    from armdesign.paper import formulas as formulas
    from armdesign.simulation.excitation import Step as Step
    from armdesign.simulation.excitation import SweptSine as SweptSine
    from armdesign.simulation.excitation import Table as Table
    from armdesign.simulation.identification.frequency_response import (
        FrequencyResponse as FrequencyResponse,
    )
    from armdesign.simulation.identification.frequency_response import (
        frequency_response as frequency_response,
    )
    from armdesign.simulation.identification.modal_fit import ModalFit as ModalFit
    from armdesign.simulation.identification.modal_fit import (
        identify_forced_response as identify_forced_response,
    )
    from armdesign.simulation.identification.modal_fit import (
        identify_frequency_response as identify_frequency_response,
    )
    from armdesign.simulation.identification.ringdown import Ringdown as Ringdown
    from armdesign.simulation.identification.ringdown import identify_ringdown as identify_ringdown
    from armdesign.simulation.identified import Identified as Identified
    from armdesign.simulation.identify import identify as identify
    from armdesign.simulation.linear_model import LinearModel as LinearModel
    from armdesign.simulation.linear_model import LinearModels as LinearModels
    from armdesign.simulation.linearization import linear_models as linear_models
    from armdesign.simulation.linearization import linearize as linearize
    from armdesign.simulation.run import Simulation as Simulation
    from armdesign.simulation.simulate import SimulationCase as SimulationCase
    from armdesign.simulation.simulate import simulate as simulate
    from armdesign.simulation.simulate import simulate_all as simulate_all
    from armdesign.simulation.validation import Validation as Validation
    from armdesign.simulation.validation import validate as validate
    from armdesign.sweeps.answers import Sweep as Sweep
    from armdesign.sweeps.sweep import sweep as sweep
    from armdesign.sweeps.trade_offs import pareto as pareto

_NAMES = {  # public names by the module that has them
    "errors": "ArmDesignError InfeasibleError",
    "machine.machine": "Machine",
    "machine.loading": "load",
    "frequency.modes": "Modes natural_modes",
    "machine.poses": "Poses",
    "machine.lift_chart": "LiftChart lift_chart",
    "frequency.workspace": "Workspace",
    "frequency.maps": "FrequencyMap frequency_map",
    "frequency.reach_map": "ReachMap",
    "frequency.worst_frequency": "WorstPose",
    "frequency.bands": "Bands",
    "frequency.frequency_band": "FrequencyBand frequency_band",
    "design.requirements.settings": "Requirements",
    "design.design": "Design",
    "design.optimize": "size_cylinders",
    "optimization": "optimize",
    "design.pareto": "Pareto",
    "design.steps": "DesignStep Steps steps",
    "design.least": "least",
    "simulation.excitation": "Step SweptSine Table",
    "simulation.run": "Simulation",
    "simulation.simulate": "SimulationCase simulate simulate_all",
    "simulation.validation": "Validation validate",
    "simulation.linear_model": "LinearModel LinearModels",
    "simulation.linearization": "linear_models linearize",
    "simulation.identified": "Identified",
    "simulation.identify": "identify",
    "simulation.identification.ringdown": "Ringdown identify_ringdown",
    "simulation.identification.modal_fit": (
        "ModalFit identify_forced_response identify_frequency_response"
    ),
    "control.bandwidth_map": "BandwidthMap bandwidth_map",
    "control.controller": "Controller",
    "control.gain_schedule": "GainSchedule gain_schedule",
    "motion.shapers": "Shaper",
    "motion.shaping": "workspace_shaper",
    "motion.plan": "plan_move",
    "motion.move": "Move",
    "motion.outcome": "MoveRun",
    "calibration.calibrate": "Calibration calibrate",
    "exchange.files": "export",
    "exchange.pin_table": "pin_table",
    "exchange.urdf": "robot_positions",
    "influence.sensitivity": "Sensitivity sensitivity",
    "influence.tolerances": "Tolerances tolerances",
    "influence.what_if": "WhatIf what_if",
    "sweeps.answers": "Sweep",
    "sweeps.sweep": "sweep",
    "sweeps.trade_offs": "pareto",
    "simulation.identification.frequency_response": "FrequencyResponse frequency_response",
}
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = [*_HOME, "formulas", "units"]
__version__ = "0.1.0"
_BEGAN = time.time()  # files written later may differ from what was loaded


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(importlib.import_module(f"armdesign.{_HOME[name]}"), name)
    if name == "formulas":
        return importlib.import_module("armdesign.paper.formulas")
    if name == "units":
        return importlib.import_module("armdesign.units")
    raise AttributeError(f"module 'armdesign' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*__all__, *(name for name in globals() if name.startswith("__"))])
