"""The search: sequential semidefinite programming from several starts, rounding, and why nothing was found."""
