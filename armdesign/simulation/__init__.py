"""The nonlinear model of a machine in time, its linearisation, and measurements in it against the linear answer."""
