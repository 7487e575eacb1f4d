"""The optimisation problem in arrays: variables, dynamics, constraints and derivatives."""
