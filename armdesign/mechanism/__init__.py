"""Links, joints and linkages: what a URDF describes, and how pins turn joint positions into lengths."""
