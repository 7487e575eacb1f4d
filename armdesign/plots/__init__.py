"""Pictures of results; ``canvas``, the door to matplotlib, opens with the first figure."""

from armdesign.plots.bandwidths import bandwidth_map, bandwidth_maps, gain_schedule
from armdesign.plots.calibrations import calibration_figure
from armdesign.plots.canvas import COMPUTED, INK, MARK, figure, save, title_of
from armdesign.plots.charts import chart_figure
from armdesign.plots.designs import (
    before_after,
    design_steps,
    moment_arm_curves,
    moment_arms,
    trade_off,
)
from armdesign.plots.lift_charts import lift_chart, lift_charts
from armdesign.plots.machine_overlays import machine_overlay
from armdesign.plots.machines import machine_drawing
from armdesign.plots.maps import (
    drawn_joints,
    frequency_map,
    holding_pressure,
    joint_plane,
    map_figure,
    reach_map,
    side_by_side,
)
from armdesign.plots.mode_shapes import mode_shapes
from armdesign.plots.moves import (
    move_figure,
    residual_oscillation,
    sensitivity_curves,
    shaper_figure,
)
from armdesign.plots.poses import corners_of_bands, forces_by_pose, modes_by_pose
from armdesign.plots.recordings import identified_figure, ringdown
from armdesign.plots.responses import (
    frequency_responses,
    linear_modes,
    linear_response,
    measured_response,
    modal_fit,
)
from armdesign.plots.sensitivities import distribution, linear_against_exact, tornado
from armdesign.plots.simulations import simulation_figure
from armdesign.plots.sweeps import sweep_answers

__all__ = [
    "COMPUTED",
    "INK",
    "MARK",
    "bandwidth_map",
    "bandwidth_maps",
    "before_after",
    "calibration_figure",
    "chart_figure",
    "corners_of_bands",
    "design_steps",
    "distribution",
    "drawn_joints",
    "figure",
    "forces_by_pose",
    "frequency_map",
    "frequency_responses",
    "gain_schedule",
    "holding_pressure",
    "identified_figure",
    "joint_plane",
    "lift_chart",
    "lift_charts",
    "linear_against_exact",
    "linear_modes",
    "linear_response",
    "machine_drawing",
    "machine_overlay",
    "map_figure",
    "measured_response",
    "modal_fit",
    "mode_shapes",
    "modes_by_pose",
    "moment_arm_curves",
    "moment_arms",
    "move_figure",
    "reach_map",
    "residual_oscillation",
    "ringdown",
    "save",
    "sensitivity_curves",
    "shaper_figure",
    "side_by_side",
    "simulation_figure",
    "sweep_answers",
    "title_of",
    "tornado",
    "trade_off",
]
