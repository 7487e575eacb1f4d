"""Sweeps: one question asked of many machines, in this process, several or a cluster."""
