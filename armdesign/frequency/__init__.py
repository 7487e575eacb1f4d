"""Natural frequencies: modes, workspaces, load cases, maps, and bands of uncertain data."""
