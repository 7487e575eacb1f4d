"""Links, joints, linkages: what a URDF describes, and how pins turn joints into lengths."""
