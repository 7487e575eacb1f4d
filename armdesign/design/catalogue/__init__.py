"""Sizes that can be bought: the best combination for given pins, and sizes and pins in turn."""
