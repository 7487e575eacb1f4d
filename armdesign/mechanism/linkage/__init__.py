"""Linkages, one file per kind: how an actuator is joined to the links."""
