"""The nonlinear model in time, its linearisation, and measurements in it."""
