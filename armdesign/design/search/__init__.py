"""The search: sequential semidefinite programming, rounding, and why nothing was found."""
