"""The source paper: its equations, and its 40 configurations, simulated."""
