"""The nonlinear model of a machine, its motion in time, and what is measured in it against the linear answer."""
