"""Oil, valves, cylinders and motors, buckling: formulas of single parts, without a machine around them."""
