"""Pictures. The only door to matplotlib."""
