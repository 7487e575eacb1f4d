"""The pump that feeds the valves."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Supply:
    """Pump pressure and return pressure [Pa], flow [m³/s].

    The pump gives no more than its flow: it cuts off linearly within the last share ``cut_off`` of
    its pressure and fills a line of ``line_volume`` [m³]. An ideal one, not ``flow_limited``,
    holds its pressure whatever the actuators take.
    """

    pressure: float
    return_pressure: float
    flow: float
    flow_limited: bool = True
    cut_off: float = 0.05
    line_volume: float = 5e-3
