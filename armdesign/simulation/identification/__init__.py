"""Natural frequency and damping from recordings: frequency responses and ring-downs."""
