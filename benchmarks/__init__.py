"""Measured figures: time, accuracy, and other optimisers and engines beside ours."""
