"""The energy book of a plant, compiled: what is supplied, stored and dissipated at one instant.

Booked is what pumps supply (less what returns to the tank under return pressure), what compresses
oil (Σ p C ṗ), and what edges, leakage, friction and stops dissipate. The balance is exact for the
plant's equations, as p Q = p C ṗ + p V̇ at every port.

Compression inside is not all that the oil's own energy V ε changes by: with ρ'/ρ = 1/β, oil at p
holds ε = ρ ∫ p dρ/ρ² in each m³, about p²/2β, and (V ε)˙ = ε Q + p C ṗ. What crosses a port brings
or takes ε Q, about p/2β of its work p Q. Valve laws and pumps count volumes and know nothing of
it, so it is left out of what is supplied and of what is stored alike.
"""

from __future__ import annotations

from armdesign.arrays import Array
from armdesign.simulation.plant.compiled import Record, Records, within


@within
def book_powers(
    actuators: Records,
    system: Record,
    pressures: Array,
    outputs: Records,
    supply: tuple[float, float, float],
    power: Array,
) -> float:
    """Energy in end stops and compliances, ½ k δ² + ½ c (A1 p1 − A2 p2 − k δ)² [J].

    Args:
        actuators: records ``ACTUATOR`` (nc,).
        system: record ``SYSTEM``.
        pressures: of caps, then of annuli (2 nc,) [Pa].
        outputs: of the actuators, records ``OUTPUT`` (nc,).
        supply: pressure [Pa], flow of the pump and flow into the valves [m³/s].
        power: supplied, into oil compression, dissipated (3,) [W]; written.
    """
    returned, passed, oil, rubbed, springs = 0.0, 0.0, 0.0, 0.0, 0.0
    pressure, pump, taken = supply
    for i in range(len(actuators)):
        actuator, output = actuators[i], outputs[i]
        p1, p2 = pressures[i], pressures[len(actuators) + i]
        q1 = output.supplied[0] - output.returned[0] + output.leaked[0]
        q2 = output.supplied[1] - output.returned[1] + output.leaked[1]
        leaked = actuator.tank_leakage * (p1 + p2 - 2 * system.return_pressure)
        returned = returned + output.returned[0] + output.returned[1] + leaked
        passed = passed + p1 * q1 + p2 * q2
        oil = oil + p1 * output.compressed[0] + p2 * output.compressed[1]
        pressed, stiffness = output.pressed, actuator.stop
        spring_force = -stiffness * pressed
        rubbed += (output.friction - output.stop + spring_force) * output.speed
        carried = actuator.areas[0] * p1 + actuator.areas[1] * p2 + spring_force
        springs += (stiffness * pressed**2 + actuator.compliance * carried**2) / 2
    stored = pressure * (pump - taken)
    power[0] = pressure * pump - system.return_pressure * returned
    power[1] = oil + stored
    power[2] = power[0] - stored - passed + rubbed  # edges dissipate what enters less what leaves
    return springs
