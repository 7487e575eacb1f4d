"""Requirements: what a design must keep and what else is asked of it, and the check of a machine against them."""
