"""The plant ẏ = f(y, u): bodies, linkages, chambers, valves and pump, compiled."""
