"""Requirements: what a design must keep, and the check of a machine against it."""
