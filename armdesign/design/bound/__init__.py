"""The proof: an upper bound on the worst frequency that no pins and areas can exceed."""
