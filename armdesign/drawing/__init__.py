"""Drawings of machines as geometry: polygons and points, known to no plotting library."""
