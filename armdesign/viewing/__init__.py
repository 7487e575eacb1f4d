"""Machines in space, to be looked at and moved: what `armdesign view` shows."""
