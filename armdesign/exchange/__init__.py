"""The machine for other programs: pin tables, drawings and robot descriptions."""
