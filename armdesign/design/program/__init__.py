"""The optimisation problem in arrays: variables, dynamics and constraints with exact derivatives."""
