"""Design: cylinder sizes and pin places that raise the worst frequency within limits."""
