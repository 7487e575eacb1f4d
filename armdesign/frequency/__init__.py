"""Natural frequencies: modes at poses, workspaces, load cases, maps, and bands of what is not known exactly."""
