"""Motion: plans of moves that the pump, the valves and the structure can follow."""
