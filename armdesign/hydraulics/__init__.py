"""Single parts: oil, valves, cylinders and motors, buckling. No machine around them."""
